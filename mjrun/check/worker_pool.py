"""The processes that check models: one for each model, several at once, within limits of time and memory."""

import json
import os
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mjrun.child_process import ChildProcess, ExitStatus, python_call
from mjrun.dataclass import dataclass
from mjrun.errors import option

MIB = 2**20
MEMORY_REMEDY = f"raise {option('memory')}, or look for a size that is too large"
PACKAGE = str(Path(__file__).parents[2])
ENVIRONMENT = {
    "MUJOCO_GL": "disable",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
    "PYTHONDONTWRITEBYTECODE": "1",
}


@dataclass(frozen=True)
class WorkerTask:
    """A check for one process.

    Attributes:
      path: the path of the model.
      codes: the codes of the rules to apply.
      steps: the number of steps to simulate.
      timeout: the time limit [s].
      memory: the limit of memory in addition to that of mjrun itself [MiB].
      reader: the function that reads tasks, `package.module:name`; empty if `path` is a model.
      policy: the policy for a task, in addition to random actions; empty for none.
      normalize, trust: the options for loading it.
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


@dataclass(frozen=True)
class WorkerOutput:
    """The output of a process, and its end.

    Attributes:
      messages: the objects that `mjrun.check.worker` wrote.
      exit: the exit status of the process.
      stderr: the output of libraries.
    """

    messages: Sequence[dict[str, Any]]
    exit: ExitStatus
    stderr: str


class CheckProcesses:
    """A starter of processes, from any thread, which can end all of them at once."""

    def __init__(self) -> None:
        self._running: set[ChildProcess] = set()
        self._lock = threading.Lock()
        self._ended = False

    def run(self, task: WorkerTask) -> WorkerOutput:
        """Runs a process that checks one model, and waits for it."""
        with self._lock:
            if self._ended:
                return WorkerOutput((), ExitStatus(0, "ended"), "")
            process = _start(task)
            self._running.add(process)
        with process:
            try:
                ended = process.wait(task.timeout, task.memory * MIB)
            finally:
                with self._lock:
                    self._running.discard(process)
            return WorkerOutput(_messages(process.stdout), ended, process.stderr.decode(errors="replace"))

    def end(self) -> None:
        """Kills the running processes, and starts no more."""
        with self._lock:
            self._ended = True
            for process in self._running:
                process.kill()


def _start(task: WorkerTask) -> ChildProcess:
    # A folder of models may contain files that are named like modules.
    path = [folder for folder in sys.path if os.path.realpath(folder) != os.path.realpath("")]
    command = python_call("mjrun.check.worker:main", json.dumps(asdict(task)), path=[*path, PACKAGE])
    return ChildProcess(command, environment=ENVIRONMENT, stdout="capture", stderr="capture")


def _messages(stdout: bytes) -> list[dict[str, Any]]:
    """Returns the JSON objects in `stdout`, one per line; an incomplete last line is skipped."""
    messages = list[dict[str, Any]]()
    for line in stdout.splitlines():
        with suppress(ValueError):
            messages.append(json.loads(line))
    return messages
