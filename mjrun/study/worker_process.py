"""Starts the processes that simulate points: one may start before its study is known, and mujoco is imported."""

import contextlib
from collections import deque
from multiprocessing.connection import Connection, Pipe

from mjrun.child_process import ChildProcess, python_call

ENVIRONMENT = {"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

Process = tuple[Connection, ChildProcess]
_waiting = deque[Process]()  # for a study


def start_early() -> None:
    """Starts a process that the next `new_process` returns; until then it imports what simulations need."""
    _waiting.append(_started())


def new_process() -> Process:
    """A process that waits for a study, as `mjrun.study.worker` has it, and the connection to it."""
    try:
        return _waiting.popleft()
    except IndexError:
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
