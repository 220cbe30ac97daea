"""One model, looked at in a process that may hang, explode or crash: `mjrun.check.check` starts it, and ends it.

Writes JSON to what was standard output, one object on a line: `doing` before each piece of work, so that whoever reads
knows what was going on when the process ended; `finding`; `loaded`; `done`.
"""

import json
import math
import os
import resource
import signal
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import mujoco

from mjrun.check import rule_table, simulation_rules
from mjrun.check.context import LintContext
from mjrun.check.finding import Finding, Sighting
from mjrun.check.xml_source import Source, read
from mjrun.errors import ModelError
from mjrun.model.mujoco_globals import collected_warnings, without_timers

MIB = 2**20
ARENAS = 20  # MjData that are made, each with an arena that is hardly ever filled
GRACE = 10  # [s] after which the process ends itself, if whoever started it has not
STATUS = Path("/proc/self/statm")


def main() -> None:
    """Looks at the model that the last argument describes as JSON: path, codes, steps, seconds, memory."""
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="surrogateescape")
    os.dup2(2, 1)  # MuJoCo and its plugins print to stdout
    job = json.loads(sys.argv[-1])
    confine(job["memory"], job["seconds"])
    Examination(job, channel).run()


def confine(memory: int, seconds: float) -> None:
    """Gives this process `memory` [MiB] more than it has, `seconds` [s], and no file to write to."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(int(seconds) + GRACE)
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_FSIZE, 0)
    give(memory * MIB)


def give(memory: float) -> None:
    """Lets this process have `memory` bytes more than it has now.

    These are addresses: whoever started it watches what is filled, and it has to be alive to say what happened.
    """
    used = int(STATUS.read_text().split()[0]) * resource.getpagesize() if STATUS.exists() else 0
    _limit(resource.RLIMIT_AS, used + memory)


def _limit(what: int, most: float) -> None:
    """Sets a soft limit, which the process can lift to say that it was met."""
    with suppress(OSError, ValueError):
        hard = resource.getrlimit(what)[1]
        soft = hard if most == math.inf else most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(what, (int(soft), hard))


class Examination:
    """One model being looked at."""

    def __init__(self, job: dict[str, Any], channel: TextIO) -> None:
        self.path, self.codes, self.steps = Path(job["path"]), set(job["codes"]), int(job["steps"])
        self.memory, self.channel = int(job["memory"]), channel
        self.gave_up = False

    def run(self) -> None:
        """Looks at everything, and tells of what it finds as it goes."""
        try:
            self._look()
        except (MemoryError, mujoco.FatalError) as error:
            if isinstance(error, mujoco.FatalError) and "allocate" not in str(error):
                raise
            give(math.inf)
            self._tell([rule_table.finding(rule_table.MEMORY, Sighting(*OUT_OF_MEMORY), self.path)])
        self._say(done=True)

    def _look(self) -> None:
        self._doing("reading its XML")
        source = read(self.path)
        self._tell(rule_table.dangers(source))
        self._doing("loading it")
        subject = self._loaded(source)
        if subject is None:
            return
        self._say(loaded=True)
        give(self.memory * MIB + ARENAS * subject.model.narena)
        self._tell(rule_table.ignored(source))
        with collected_warnings():
            for code, rule in rule_table.RULES.items():
                if rule.find and code in self.codes:
                    self._doing(f"looking for {code}, {rule.title}")
                    self._guarded(code, subject)
        if self.codes.intersection(simulation_rules.CODES):
            self._doing(f"taking {self.steps} steps")
            with without_timers():
                found = simulation_rules.sightings(subject, self.steps)
                self._tell(rule_table.finding(code, sighting, self.path) for code, sighting in found)

    def _loaded(self, source: Source) -> LintContext | None:
        try:
            with collected_warnings() as heard:
                subject = LintContext.load(self.path, source)
        except ModelError as error:
            give(math.inf)
            self._tell(rule_table.refusals(error, source))
            return None
        texts = ("; ".join(text.split("\n")) for text in heard)
        self._tell(
            rule_table.finding(rule_table.WARNED, Sighting(f"MuJoCo warns: {text}", ""), self.path) for text in texts
        )
        return subject

    def _guarded(self, code: str, subject: LintContext) -> None:
        """Tells what one rule finds; one that MuJoCo or a fault of mjrun breaks off does not stop the others."""
        try:
            self._tell(rule_table.seen(code, subject))
        except MemoryError:
            raise
        except mujoco.FatalError as error:
            if "allocate" in str(error):
                raise
            sighting = Sighting(f"MuJoCo gives up at the start: {error}", "give it more memory: <size memory=…>")
            if not self.gave_up:
                self._tell([rule_table.finding(rule_table.GAVE_UP, sighting, self.path)])
            self.gave_up = True
        except Exception as error:
            sighting = Sighting(f"the rule {code} fails: {type(error).__name__}: {error}", "please report it")
            self._tell([rule_table.finding(rule_table.FAILED, sighting, self.path)])

    def _tell(self, findings: Iterable[Finding]) -> None:
        for finding in findings:
            self._say(finding=asdict(finding))

    def _doing(self, what: str) -> None:
        self._say(doing=what)

    def _say(self, **facts: Any) -> None:
        self.channel.write(json.dumps(facts) + "\n")
        self.channel.flush()


OUT_OF_MEMORY = (
    "it needs more memory than it may have",
    "give it more with --memory, or look for a size that is too large",
)
