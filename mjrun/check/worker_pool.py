"""The processes that check models within limits of time and memory, several at once.

Each process loads its modules once and checks any number of models. Where the system can fork, forks of it do, so that
another one continues after a model that crashes one or fills its memory; elsewhere, the process then ends.
"""

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, field
from pathlib import Path
from types import NoneType
from typing import Any, cast

from mjrun.child_process import ENVIRONMENT, POLL_INTERVAL, ExitStatus, resident_memory
from mjrun.dataclass import dataclass
from mjrun.errors import clean, option
from mjrun.worker import Worker, WorkerEndedError

MIB = 2**20
MEMORY_REMEDY = f"raise {option('memory')}, or look for a size that is too large"
PACKAGE = str(Path(__file__).parents[2])
FIX_TIME = 600.0  # [s] in addition to the time limit of a check, for fixes that compute for minutes
# glibc keeps what one model has freed for the next one, as the system maps and clears memory page by page.
MALLOC = {"MALLOC_ARENA_MAX": "2", "MALLOC_MMAP_THRESHOLD_": str(2**30), "MALLOC_TRIM_THRESHOLD_": str(2**30)}
TRIAL = 0.1  # [s] of checking from which the time of other models is estimated
END_GRACE = 1.0  # [s] for an idle process to end, so that its computing time is counted
TASK_MARK = "\0\n"  # on standard error, before the messages of each task
# The types in messages of a process, by name.
MESSAGE_TYPES: Mapping[str, type | tuple[type, ...]] = {
    "pid": int,
    "stage": str,
    "is_slow": bool,
    "finding": dict,
    "loaded": bool,
    "suppressed": int,
    "changes": (list, NoneType),
    "done": bool,
}


@dataclass(frozen=True)
class CheckRequest:
    """A request of a check by one process.

    Attributes:
      path: the path of the model.
      codes: the codes of the rules to apply.
      steps: the number of steps to simulate.
      timeout: the time limit [s].
      memory: the limit of memory in addition to that of mjrun itself [MiB].
      reader: the function that reads tasks, `package.module:name`; empty if `path` is a model.
      policy: the policy for a task, in addition to random actions; empty for none.
      normalize, trust: the options for loading it.
      model: the path of the model as given, if `path` is that of a copy.
      root: the folder with the copy, which mirrors absolute paths; empty if it is the model itself.
      original: the path of the model to compare a copy with.
      unsafe: whether to propose fixes that need a look.
      cache: whether to store what takes minutes to compute.
      thresholds: the fields of `Thresholds` that differ from their defaults.
    """

    path: str
    codes: Sequence[str]
    steps: int
    timeout: float
    memory: int
    reader: str = ""
    policy: str = ""
    normalize: str | None = None
    trust: bool = False
    model: str = ""
    root: str = ""
    original: str = ""
    unsafe: bool = False
    cache: bool = False
    thresholds: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True)
class CheckProcessOutput:
    """The output of a process, and its end.

    Attributes:
      messages: the items that `mjrun.check.worker.CheckServer` sent.
      exit: the exit status of the process.
      stderr: the output of libraries.
    """

    messages: Sequence[Mapping[str, Any]]
    exit: ExitStatus
    stderr: str


class CheckQueue:
    """The queue of the requests that are left, for use from any thread.

    Models in one folder often share meshes, which the process of a thread still holds after the first of them.
    """

    def __init__(self, tasks: Sequence[CheckRequest]) -> None:
        self._left: dict[str, deque[tuple[int, CheckRequest]]] = {}
        for i, task in enumerate(tasks):
            self._left.setdefault(os.path.dirname(task.path), deque()).append((i, task))  # noqa: PTH120
        self._lock, self._folders = threading.Lock(), dict[int, str]()

    def take(self) -> tuple[int, CheckRequest]:
        """Returns a task with its number: one in the folder of this thread's last one, or in one of no other thread."""
        with self._lock:
            folder = self._folders.pop(threading.get_ident(), None)
            if folder is None or folder not in self._left:
                others = set(self._folders.values())
                folder = next((each for each in self._left if each not in others), next(iter(self._left)))
            self._folders[threading.get_ident()] = folder
            taken = self._left[folder].popleft()
            if not self._left[folder]:
                del self._left[folder]
            return taken


class CheckProcessPool:
    """A pool of processes, for use from any thread, which can end all of them at once.

    A process takes as long to start as dozens of small models take to be checked: another one starts only if the
    models that are left are expected to take longer than that.

    Args:
      note: a function called with a sentence about each fix that computes for minutes, as it begins.

    Attributes:
      left: the number of models that are left to check, as far as known.
    """

    def __init__(self, note: Callable[[str], object] = lambda text: None) -> None:
        self.left, self._note = 0, note
        self._idle: list[CheckProcess] = []
        self._busy: set[CheckProcess] = set()
        self._changed = threading.Condition()
        self._done = 0
        self._ended = False

    def run(self, task: CheckRequest) -> CheckProcessOutput:
        """Checks one model in a process that is idle, or in a new one if that pays."""
        with self._changed:
            while not (self._ended or self._idle or self._another_pays()):
                self._changed.wait(POLL_INTERVAL)
            if self._ended:
                return CheckProcessOutput((), ExitStatus(0, "ended"), "")
            process = self._idle.pop() if self._idle else CheckProcess()
            self._busy.add(process)
        try:
            return process.run(task, self._note)
        finally:
            with self._changed:
                self._busy.discard(process)
                self._done += 1
                self.left -= 1
                if process.is_reusable and not self._ended:
                    self._idle.append(process)
                else:
                    process.end()
                self._changed.notify_all()

    def _another_pays(self) -> bool:
        """Returns whether the models that are left are worth the start of another process."""
        if not self._busy:
            return True
        first = min((process for process in self._busy if process.ready), key=lambda each: each.ready, default=None)
        checking = time.monotonic() - first.ready if first else 0.0
        if first is None or checking < TRIAL:
            return False
        return not self._done or self.left * checking / self._done > len(self._busy) * (first.ready - first.created)

    def end(self) -> None:
        """Ends all processes, and starts no more."""
        with self._changed:
            self._ended = True
            for process in self._busy:
                process.kill()
            while self._idle:
                self._idle.pop().end()


class CheckProcess:
    """A process with a `mjrun.check.worker.CheckServer`, and a watchdog that kills it if a model exceeds its limits.

    Attributes:
      is_reusable: it can check another model.
      created: the time at which it was created [s].
      ready: the time at which it had loaded its modules [s]; 0 before.
    """

    def __init__(self) -> None:
        self.created, self.ready = time.monotonic(), 0.0
        # A folder of models may contain files that are named like modules.
        path = [folder for folder in sys.path if os.path.realpath(folder) != os.path.realpath("")]
        environment = ENVIRONMENT | MALLOC
        server = "mjrun.check.worker:CheckServer"
        # A hostile model may control the process.
        self._worker = Worker(server, environment=environment, encoding="json", path=[*path, PACKAGE])
        self.is_reusable = True
        self._checking, self._deadline = self._worker.process.pid, math.inf

    def run(self, task: CheckRequest, note: Callable[[str], object] = lambda text: None) -> CheckProcessOutput:
        """Checks one model, and ends the process if that exceeds a limit; `note` is that of `CheckProcessPool`."""
        self.is_reusable = False
        deadline = time.monotonic() + task.timeout
        self._deadline = deadline
        messages: list[dict[str, Any]] = []
        has_ended = threading.Event()
        threading.Thread(target=self._watch, args=(task.memory * MIB, has_ended), daemon=True).start()
        try:
            self._worker.send("check", asdict(task))
            while not (reply := self._worker.receive()).is_last:
                message = reply.value
                if not _is_message(message):
                    return CheckProcessOutput(messages, ExitStatus(1), "its process sent an invalid message")
                self.ready = self.ready or time.monotonic()
                self._checking = message.get("pid", self._checking)
                messages.append(message)
                if message.get("is_slow"):
                    self._deadline = deadline + FIX_TIME
                    note(f"{clean(task.model)}: {message['stage']}")
        except WorkerEndedError as error:
            stderr = self._worker.process.stderr.decode(errors="replace").rpartition(TASK_MARK)[2]
            return CheckProcessOutput(messages, error.ending, stderr)
        finally:
            has_ended.set()
        self.is_reusable = True
        return CheckProcessOutput(messages, ExitStatus(0), "")

    def kill(self) -> None:
        """Kills the process, from any thread; `run` returns."""
        self._worker.kill()

    def end(self) -> None:
        """Ends the process, which ends by itself when it is idle."""
        self._worker.connection.close()
        self._worker.process.wait(END_GRACE)
        self._worker.close()

    def _watch(self, memory: int, has_ended: threading.Event) -> None:
        """Kills the process when its time is over or it holds more than `memory` [bytes], until a check has ended."""
        while not has_ended.wait(max(0.0, min(self._deadline - time.monotonic(), POLL_INTERVAL))):
            is_late = time.monotonic() > self._deadline
            if is_late or resident_memory(self._checking) > memory:
                self._worker.process.kill("time" if is_late else "memory")
                return


def _is_message(value: object) -> bool:
    """Returns whether a process sent what `mjrun.check.worker.CheckServer` sends."""
    if not isinstance(value, dict):
        return False
    items = cast("dict[str, object]", value).items()
    return all(isinstance(each, MESSAGE_TYPES.get(name, ())) for name, each in items)
