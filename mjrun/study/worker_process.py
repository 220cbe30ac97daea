"""Starts the processes that simulate points: one may start before its study is known, and mujoco is imported."""

import contextlib
from collections import deque
from multiprocessing.connection import Connection, Pipe
from pathlib import Path

from mjrun.child_process import ChildProcess, python_call

ENVIRONMENT = {"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

Process = tuple[Connection, ChildProcess]
_waiting = deque[tuple[Path, Process]]()  # for a study, and the folder from which they see relative paths


def start_early() -> None:
    """Starts a process that the next `new_process` returns; until then it imports what simulations need."""
    _waiting.append((Path.cwd(), _started()))


def new_process() -> Process:
    """A process that waits for a study, as `mjrun.study.worker` has it, and the connection to it."""
    while _waiting:
        folder, waiting = _waiting.popleft()
        if folder == Path.cwd() and waiting[1].running:
            return waiting
        waiting[0].close()
        waiting[1].end()
    return _started()


def _started() -> Process:
    ours, theirs = Pipe()
    with contextlib.closing(theirs):
        process = ChildProcess(
            python_call("mjrun.study.worker:main"),
            environment=ENVIRONMENT,
            descriptors=[theirs.fileno()],
            stderr="capture",
        )
    return ours, process
