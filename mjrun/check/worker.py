"""A process that checks models or tasks, and may hang, explode or crash: `worker_pool` starts and ends it."""

import gc
import math
import os
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco

from mjrun.check import rule_runner
from mjrun.check.context import CheckContext
from mjrun.check.finding import Finding
from mjrun.check.rule_catalogue import Thresholds
from mjrun.check.rules import check_itself, compile_errors, simulation
from mjrun.check.rules.check_itself import IgnoreComments
from mjrun.check.worker_pool import FIX_TIME, MEMORY_REMEDY, MIB, TASK_MARK, CheckRequest
from mjrun.child_process import limit_this_process, resident_memory
from mjrun.errors import ModelError
from mjrun.formats.user_cache import UserCache
from mjrun.model.mujoco_globals import collected_warnings, keep_assets, without_timers
from mjrun.model.source import checked_arrays
from mjrun.model.xml_source import XmlSource, read_xml
from mjrun.platform import system
from mjrun.worker import StreamingServer

ARENAS = 20  # the number of MjData that a check makes; their arenas are hardly ever filled
KEPT_MEMORY = 0.25  # part of the maximum memory per model that a process may hold when it begins the next one
GRACE = 10  # [s] after which the process ends itself if its parent has not


class CheckServer(StreamingServer):
    """A server that checks models or tasks, until one crashes or affects what follows.

    Where the system can fork, forks of the process check them: starting one takes milliseconds. The process ends as its
    fork did, unless that succeeded.
    """

    def __init__(self) -> None:
        checked_arrays()  # cached for all models
        keep_assets()
        self._is_checking = not system.CAN_FORK_LATE

    def check(self, request: Mapping[str, Any]) -> None:
        """Checks the model or task of the fields of a `CheckRequest`.

        The items of the reply are objects: `pid`, the process that checks the next models; `stage` before each stage,
        so that the reader knows the stage in which the process ended, with `is_slow` if it is a fix that computes for
        minutes; `finding`; `loaded`; `suppressed`; `changes`; `done` at the end.
        """
        try:
            if not self._is_checking:
                if fork := os.fork():
                    _end_as(os.waitstatus_to_exitcode(os.waitpid(fork, 0)[1]))
                    return
                self._is_checking = sys.dont_write_bytecode = True
                self.send_item({"pid": os.getpid()})
            sys.stderr.write(TASK_MARK)
            sys.stderr.flush()
            task = CheckRequest(**request)
            check(task, self.send_item)
            gc.collect()
            # Tasks run the user's code, and fixes change files whose meshes MuJoCo keeps; the next model is compiled in
            # memory that is mapped already.
            if task.reader or task.root or not 0 < resident_memory(os.getpid()) < KEPT_MEMORY * task.memory * MIB:
                os._exit(0)
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)


def _end_as(code: int) -> None:
    """Ends this process as a fork that ended with `code`, unless that is 0."""
    if code < 0:
        os.kill(os.getpid(), -code)
    if code:
        os._exit(code & 255)


def check(task: CheckRequest, send: Callable[[dict[str, Any]], object]) -> None:
    """Checks a model or a task."""
    with system.end_after(int(task.timeout + FIX_TIME * task.unsafe) + GRACE):
        # These limit addresses; the parent watches the memory in use, and reports it.
        limit_this_process(memory=task.memory * MIB, file_size=0, core=0)
        if task.reader:
            from mjrun.check.task_checker import TaskChecker  # which imports the modules of tasks and policies

            TaskChecker(task, send).run()
        else:
            ModelChecker(task, send).run()


class Checker(ABC):
    """A checker of one model or task, which sends each message by `send`."""

    def __init__(self, task: CheckRequest, send: Callable[[dict[str, Any]], object]) -> None:
        self.task, self._send = task, send
        self.path = Path(task.path)

    def run(self) -> None:
        """Runs the check, and writes each finding at once."""
        try:
            self.check()
        except (MemoryError, mujoco.FatalError) as error:
            if isinstance(error, mujoco.FatalError) and "allocate" not in str(error):
                raise
            limit_this_process(memory=math.inf)
            message = "it needs more memory than allowed"
            self.write_findings([check_itself.OUT_OF_MEMORY.in_model(self.path, message, MEMORY_REMEDY)])
        self.write(done=True)

    @abstractmethod
    def check(self) -> None:
        """Runs the check."""

    def write_findings(self, findings: Iterable[Finding]) -> None:
        """Writes each of `findings`."""
        for finding in findings:
            self.write(finding=asdict(finding))

    def write(self, **message: Any) -> None:
        """Writes one message: `stage`, `finding`, `loaded`, `suppressed` or `done`."""
        self._send(message)


class ModelChecker(Checker):
    """A checker of one model."""

    def __init__(self, task: CheckRequest, send: Callable[[dict[str, Any]], object]) -> None:
        super().__init__(task, send)
        self.mujoco_failed = False
        self.comments = IgnoreComments(())

    def check(self) -> None:
        self.write(stage="reading its XML")
        source = read_xml(self.path)

        self.write(stage="loading it")
        context = self._load(source)
        if context is None:
            return
        self.write(loaded=True)
        context.unsafe = self.task.unsafe
        context.cache = UserCache("parts") if self.task.cache else None
        context.announce_slow_fix = lambda stage: self.write(stage=stage, is_slow=True)
        if self.task.root:
            from mjrun.check.fixing import changed_fields

            context.home = Path(self.task.model).absolute().parent
            self.write(stage="comparing it with the original")
            self.write(changes=changed_fields(Path(self.task.original), context.model))
        limit_this_process(memory=self.task.memory * MIB + ARENAS * context.model.narena)
        self.comments = IgnoreComments(source.comments)
        self.write_findings(rule_runner.ignored_xml(source))

        with collected_warnings():
            for code, rule in rule_runner.RULES.items():
                if rule.violations and code in self.task.codes:
                    self.write(stage=f"applying {code}, {rule.title}")
                    self._apply(code, context)

        applied = set(self.task.codes)
        if applied & simulation.CODES:
            self.write(stage=f"taking {self.task.steps} steps")
            with without_timers():
                self.write_findings(simulation.simulate(context, self.task.steps))

        self.write(suppressed=self.comments.suppressed)
        applied -= set() if self.task.steps else simulation.CODES
        self.write_findings(self.comments.unused(applied, rule_runner.RULES))

    def write_findings(self, findings: Iterable[Finding]) -> None:
        super().write_findings(self.comments.remaining(findings))

    def _load(self, source: XmlSource) -> CheckContext | None:
        try:
            with collected_warnings() as warnings:
                context = CheckContext.load(self.path, source, Thresholds(**self.task.thresholds))
        except ModelError as error:
            limit_this_process(memory=math.inf)
            self.write_findings(rule_runner.explain(error, source))
            return None
        lines = ("; ".join(text.split("\n")) for text in warnings if "'meaninertia' is deprecated" not in text)  # MJ116
        self.write_findings(compile_errors.WARNING.in_model(self.path, f"MuJoCo warns: {line}") for line in lines)
        return context

    def _apply(self, code: str, context: CheckContext) -> None:
        """Applies one rule; if MuJoCo or a bug in mjrun aborts it, the other rules still run."""
        try:
            self.write_findings(rule_runner.apply(code, context, self.comments.remaining))
        except MemoryError:
            raise
        except mujoco.FatalError as error:
            if "allocate" in str(error):
                raise
            if not self.mujoco_failed:
                message = f"MuJoCo fails at the start: {error}"
                remedy = "give it more memory: <size memory=…>"
                self.write_findings([simulation.FAILED_STEP.in_model(self.path, message, remedy)])
            self.mujoco_failed = True
        except Exception as error:
            message = f"the rule {code} fails: {type(error).__name__}: {error}"
            self.write_findings([check_itself.INTERNAL_ERROR.in_model(self.path, message, "please report it")])
