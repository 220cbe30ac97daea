"""A process that checks models or tasks, and may hang, explode or crash: `worker_pool` starts and ends it.

It reads each task as a line of JSON, and writes JSON to standard output, one object per line: `pid`, the process that
checks the next models; `stage` before each stage, so that the reader knows the stage in which the process ended, with
`is_slow` if it is a fix that computes for minutes; `finding`; `loaded`; `done`; `exit` at the end of a task, 0 or the
exit code of that process.
"""

import gc
import json
import math
import os
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any, NoReturn, TextIO

import mujoco

from mjrun.check import rule_runner
from mjrun.check.context import CheckContext
from mjrun.check.rule import Finding
from mjrun.check.rule_catalogue import Thresholds
from mjrun.check.rules import check_itself, compile_errors, simulation
from mjrun.check.rules.check_itself import IgnoreComments
from mjrun.check.worker_pool import FIX_TIME, MEMORY_REMEDY, MIB, TASK_MARK, CheckRequest
from mjrun.child_process import limit_this_process, resident_memory
from mjrun.errors import ModelError
from mjrun.formats.user_cache import UserCache
from mjrun.model.compilation import checked_arrays
from mjrun.model.mujoco_globals import collected_warnings, keep_assets, without_timers
from mjrun.model.xml_source import XmlSource, read_xml
from mjrun.platform import system

ARENAS = 20  # the number of MjData that a check makes; their arenas are hardly ever filled
KEPT_MEMORY = 0.25  # part of the maximum memory per model that a process may hold when it begins the next one
GRACE = 10  # [s] after which the process ends itself if its parent has not


def serve() -> NoReturn:
    """Checks the model or task of each `CheckRequest` on standard input, until one crashes or the input ends.

    Where the system can fork, forks of this process check them: starting one takes milliseconds.
    """
    output = os.dup(1)
    os.dup2(2, 1)  # MuJoCo and its plugins print to stdout
    tasks = os.fdopen(os.dup(0), "rb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    checked_arrays()  # cached for all models
    keep_assets()
    gc.freeze()
    if not system.CAN_FORK_LATE:
        _check_all(tasks, output)
        os._exit(0)
    for task in tasks:
        code = _forked(chain([task], tasks), output)
        _write(output, exit=code)
        if code:
            break
    os._exit(0)  # shutting down an interpreter takes time


def _forked(tasks: Iterable[bytes], output: int) -> int:
    """Checks models in a fork of this process, and returns the exit code of the fork."""
    pid = os.fork()
    if pid:
        _write(output, pid=pid)
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    code = 1
    try:
        sys.dont_write_bytecode = True
        _check_all(tasks, output)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(OSError):
            sys.stderr.flush()
        os._exit(code)


def _check_all(tasks: Iterable[bytes], output: int) -> None:
    """Checks models until the input ends, or this process may affect what follows; `exit` is then left out.

    The next model is compiled in memory that is mapped already, and MuJoCo keeps the meshes that models share.
    """
    for line in tasks:
        sys.stderr.write(TASK_MARK)
        sys.stderr.flush()
        task = CheckRequest(**json.loads(line))
        check(task, output)
        if task.reader or task.root:  # which run the user's code, or change the content of files
            return
        gc.collect()
        if not 0 < resident_memory(os.getpid()) < KEPT_MEMORY * task.memory * MIB:
            return
        _write(output, exit=0)


def _write(output: int, **message: int) -> None:
    os.write(output, f"{json.dumps(message)}\n".encode())


def check(task: CheckRequest, output: int) -> None:
    """Checks a model or a task."""
    channel = os.fdopen(output, "w", encoding="utf-8", errors="surrogateescape", closefd=False)
    with system.end_after(int(task.timeout + FIX_TIME * task.unsafe) + GRACE):
        # These limit addresses; the parent watches the memory in use, and reports it.
        limit_this_process(memory=task.memory * MIB, file_size=0, core=0)
        _checker(task, channel).run()


def _checker(task: CheckRequest, channel: TextIO) -> "Checker":
    """Returns the check of a model or a task; only a task needs the modules of tasks and policies."""
    if not task.reader:
        return ModelChecker(task, channel)
    from mjrun.check.task_checker import TaskChecker

    return TaskChecker(task, channel)


class Checker(ABC):
    """A checker of one model or task, which writes its findings to `channel`."""

    def __init__(self, task: CheckRequest, channel: TextIO) -> None:
        self.task, self.channel = task, channel
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
        self.channel.write(json.dumps(message) + "\n")
        self.channel.flush()


class ModelChecker(Checker):
    """A checker of one model."""

    def __init__(self, task: CheckRequest, channel: TextIO) -> None:
        super().__init__(task, channel)
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
