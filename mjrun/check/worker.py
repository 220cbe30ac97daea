"""Checks one model in a process that may hang, explode or crash: `mjrun.check.worker_pool` starts and ends it.

Writes JSON to standard output, one object on a line: `stage` before each stage, so that the reader knows what was
going on if the process ends; `finding`; `loaded`; `done`.
"""

import json
import math
import os
import signal
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import mujoco

from mjrun.check import rule_table
from mjrun.check.context import LintContext
from mjrun.check.finding import Finding
from mjrun.check.rules import compile_errors, process_failures, simulation
from mjrun.check.worker_pool import MIB, WorkerTask
from mjrun.child_process import limit_this_process
from mjrun.errors import ModelError, option
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.model.xml_source import XmlSource, read_xml

ARENAS = 20  # MjData that are made, each with an arena that is hardly ever filled
GRACE = 10  # [s] after which the process ends itself, if its parent has not
MEMORY_REMEDY = f"raise {option('memory')}, or look for a size that is too large"


def main(task: str) -> None:
    """Checks the model of a `WorkerTask`, which is given as JSON."""
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="surrogateescape")
    os.dup2(2, 1)  # MuJoCo and its plugins print to stdout
    worker = ModelChecker(WorkerTask(**json.loads(task)), channel)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(int(worker.task.timeout) + GRACE)
    # These limit addresses; the parent watches the memory that is filled, and reports it.
    limit_this_process(memory=worker.task.memory * MIB, file_size=0, core=0)
    worker.run()


class ModelChecker:
    """Checks one model, and writes what it finds to `channel`."""

    def __init__(self, task: WorkerTask, channel: TextIO) -> None:
        self.task, self.channel = task, channel
        self.path = Path(task.path)
        self.mujoco_failed = False

    def run(self) -> None:
        """Checks the model, and writes each finding at once."""
        try:
            self._check()
        except (MemoryError, mujoco.FatalError) as error:
            if isinstance(error, mujoco.FatalError) and "allocate" not in str(error):
                raise
            limit_this_process(memory=math.inf)
            message = "it needs more memory than it may use"
            self._write_findings([process_failures.OUT_OF_MEMORY.in_model(self.path, message, MEMORY_REMEDY)])
        self._write(done=True)

    def _check(self) -> None:
        self._write(stage="reading its XML")
        source = read_xml(self.path)
        self._write_findings(rule_table.unsafe_files(source))

        self._write(stage="loading it")
        context = self._load(source)
        if context is None:
            return
        self._write(loaded=True)
        limit_this_process(memory=self.task.memory * MIB + ARENAS * context.model.narena)
        self._write_findings(rule_table.ignored_xml(source))

        with collected_warnings():
            for code, rule in rule_table.RULES.items():
                if rule.violations and code in self.task.codes:
                    self._write(stage=f"applying {code}, {rule.title}")
                    self._apply(code, context)

        if simulation.CODES.intersection(self.task.codes):
            self._write(stage=f"taking {self.task.steps} steps")
            with without_timers():
                self._write_findings(simulation.simulate(context, self.task.steps))

    def _load(self, source: XmlSource) -> LintContext | None:
        try:
            with collected_warnings() as warnings:
                context = LintContext.load(self.path, source)
        except ModelError as error:
            limit_this_process(memory=math.inf)
            self._write_findings(rule_table.explain(error, source))
            return None
        lines = ("; ".join(text.split("\n")) for text in warnings)
        self._write_findings(compile_errors.WARNING.in_model(self.path, f"MuJoCo warns: {line}") for line in lines)
        return context

    def _apply(self, code: str, context: LintContext) -> None:
        """Applies one rule; if MuJoCo or a bug in mjrun aborts it, the others are applied all the same."""
        try:
            self._write_findings(rule_table.apply(code, context))
        except MemoryError:
            raise
        except mujoco.FatalError as error:
            if "allocate" in str(error):
                raise
            if not self.mujoco_failed:
                message = f"MuJoCo gives up at the start: {error}"
                remedy = "give it more memory: <size memory=…>"
                self._write_findings([simulation.FAILED_STEP.in_model(self.path, message, remedy)])
            self.mujoco_failed = True
        except Exception as error:
            message = f"the rule {code} fails: {type(error).__name__}: {error}"
            self._write_findings([process_failures.INTERNAL_ERROR.in_model(self.path, message, "please report it")])

    def _write_findings(self, findings: Iterable[Finding]) -> None:
        for finding in findings:
            self._write(finding=asdict(finding))

    def _write(self, **message: Any) -> None:
        self.channel.write(json.dumps(message) + "\n")
        self.channel.flush()
