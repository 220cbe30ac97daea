"""`mjrun check`: what is wrong with models, each looked at in a process of its own."""

import json
import math
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mjrun.check.finding import SEVERITIES, Finding, Sighting
from mjrun.check.model_files import found_models
from mjrun.check.rule_table import CRASHED, FAILED, MEMORY, RULES, TIMED_OUT, finding
from mjrun.check.worker_processes import Children, Said
from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.rendering.process_count import available_cores
from mjrun.reporter import QuietReporter, Reporter

AUTO = "auto"
CRASHES = (
    "MuJoCo crashes on models that attach each other in a circle, thousands of nested elements or includes, "
    "SDF plugins of infinite size, and damaged .mjb files"
)


@dataclass(frozen=True)
class Checked:
    """One model.

    Attributes:
      model: as it was given.
      loads: whether it loads, and lives through everything that was done to it.
      findings: those selected, in the order in which they were found.
    """

    model: str
    loads: bool
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class CheckResult:
    """All models, in the order given.

    Attributes:
      models: what was found in each.
      skipped: files that are no models by themselves, such as those that models include.
      code: the exit code: 3 if a model does not load, 1 if something is at or above `fail_on`, else 0.
    """

    models: tuple[Checked, ...]
    skipped: int
    code: int

    def count(self, severity: str) -> int:
        """How many findings are of this severity."""
        return sum(f.severity == severity for model in self.models for f in model.findings)


@dataclass(frozen=True)
class Check:
    """Which models to look at, and for what.

    Args:
      models: files, and folders: these mean all models below them.
      select: codes or beginnings of codes to look for; all when empty.
      ignore: codes or beginnings of codes to leave out. That a model does not load is always told.
      fail_on: the least severity that makes the answer no: `error`, `warning` or `note`.
      steps: how many to take, from the model's own start; none when 0.
      timeout: for one model [s].
      memory: for one model, beyond what mjrun itself needs [MiB].
      jobs: models at once, or `auto`: as many as there are cores.

    Raises:
      UsageError: a code, severity or number that cannot be.
    """

    models: Sequence[str | Path]
    select: Sequence[str] = ()
    ignore: Sequence[str] = ()
    fail_on: str = "error"
    steps: int = 200
    timeout: float = 60.0
    memory: int = 4096
    jobs: int | str = AUTO

    def __post_init__(self) -> None:
        if self.fail_on not in SEVERITIES:
            raise UnknownNameError("severity", self.fail_on, SEVERITIES, plural="severities")
        for flag, value, least in (("--steps", self.steps, 0), ("--memory", self.memory, 1)):
            if not isinstance(value, int) or value < least:
                raise BadValueError(flag, value, f"a whole number from {least} on")
        if not 0 < self.timeout < math.inf:
            raise BadValueError("--timeout", self.timeout, "a positive number of seconds")
        if self.jobs != AUTO and not (isinstance(self.jobs, int) and self.jobs > 0):
            raise BadValueError("--jobs", self.jobs, f"a number of processes from 1 on, or {AUTO}")
        _ = self.codes

    @cached_property
    def codes(self) -> frozenset[str]:
        """The codes that are looked for."""
        chosen = matching(self.select) if self.select else frozenset(RULES)
        return chosen - matching(self.ignore)

    def run(self, reporter: Reporter | None = None) -> CheckResult:
        """Looks at all models.

        Raises:
          UsageError: there is no model in what was given.
        """
        reporter = reporter or QuietReporter()
        paths, skipped = found_models(self.models)
        if not paths and all(Path(given).is_dir() for given in self.models):
            raise UsageError("there is no model to check: give model files, or folders that hold some")
        checked = []
        for model in self._examined(paths):
            checked.append(model)
            reporter.progress("models", len(checked), len(paths))
        return CheckResult(tuple(checked), skipped, self._code(checked))

    def _examined(self, paths: Sequence[str]) -> Iterator[Checked]:
        """What is found in each of `paths`, several at once, in their order."""
        jobs = min(available_cores() if self.jobs == AUTO else int(self.jobs), max(1, len(paths)))
        children = Children()
        with ThreadPoolExecutor(jobs) as pool:
            try:
                yield from pool.map(lambda path: self._examine(path, children), paths)
            finally:
                children.end()
                pool.shutdown(cancel_futures=True)

    def _examine(self, path: str, children: Children) -> Checked:
        asked = {"path": path, "codes": sorted(self.codes), "steps": self.steps}
        asked |= {"seconds": self.timeout, "memory": self.memory}
        said = children.run(json.dumps(asked), self.timeout, self.memory)
        loads, findings = self._understood(path, said)
        kept = tuple(f for f in findings if f.code in self.codes or (f.severity == "error" and not loads))
        return Checked(path, loads, kept)

    def _understood(self, path: str, said: Said) -> tuple[bool, list[Finding]]:
        """Whether the model in `path` loads and all went well with it, and what was found."""
        findings = [Finding(**line["finding"]) for line in said.lines if "finding" in line]
        if any(line.get("done") for line in said.lines):
            starved = any(found.code == MEMORY for found in findings)
            return any(line.get("loaded") for line in said.lines) and not starved, findings
        doing = next((line["doing"] for line in reversed(said.lines) if "doing" in line), "starting")
        return False, [*findings, finding(*self._ended(doing, said), Path(path))]

    def _ended(self, doing: str, said: Said) -> tuple[str, Sighting]:
        """Why a process ended before it was done."""
        if said.starved or b"bad_alloc" in said.printed or b"MemoryError" in said.printed:
            message = f"it needs more memory than {self.memory} MiB, while {doing}"
            return MEMORY, Sighting(message, "give it more with --memory, or look for a size that is too large")
        if said.code is None:
            message = f"not done after {self.timeout:g} s, while {doing}"
            remedy = "give it more with --timeout, or take fewer --steps; a pipe among its files never ends"
            return TIMED_OUT, Sighting(message, remedy)
        last = said.printed.decode(errors="replace").strip().rpartition("\n")[2]
        said_last = f": {last}" if last else ""
        if said.code >= 0:
            return FAILED, Sighting(f"mjrun fails while {doing}{said_last}", "please report it")
        return CRASHED, Sighting(f"its process ended by {_signal_name(-said.code)} while {doing}{said_last}", CRASHES)

    def _code(self, checked: Sequence[Checked]) -> int:
        if not all(model.loads for model in checked):
            return 3
        least = SEVERITIES.index(self.fail_on)
        failing = (f for model in checked for f in model.findings if SEVERITIES.index(f.severity) >= least)
        return 1 if any(failing) else 0


def matching(beginnings: Sequence[str]) -> frozenset[str]:
    """The codes that begin with one of `beginnings`, in any case.

    Raises:
      UnknownNameError: one begins no code.
    """
    found: set[str] = set()
    for beginning in beginnings:
        codes = {code for code in RULES if beginning and code.startswith(beginning.upper())}
        if not codes:
            raise UnknownNameError("code", beginning, list(RULES))
        found |= codes
    return frozenset(found)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
