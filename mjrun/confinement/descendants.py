"""The descendants of a process, found by the system, whatever they do to escape."""

import ctypes
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

SUBREAPER = 36  # of prctl
PURSUIT = 10.0  # [s] after which processes that fork faster than they are killed are left alone


def adopt() -> bool:
    """Makes this process the parent of all descendants whose own parents end; returns whether that is supported."""
    return sys.platform == "linux" and ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0) == 0


def kill() -> None:
    """Kills the children of this process, and the orphans that become its children."""
    deadline = time.monotonic() + PURSUIT
    while time.monotonic() < deadline:
        for pid in _children():
            with suppress(ProcessLookupError):  # it may belong to another user, or have been reaped
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:  # none are left
            return
        os.sched_yield()


def _children() -> list[int]:
    own = os.getpid()
    with suppress(OSError):
        return [int(pid) for pid in Path(f"/proc/{own}/task/{own}/children").read_text().split()]
    parents: dict[int, int] = {}  # of all processes, for kernels that do not list children
    for process in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            parents[int(process.parent.name)] = int(process.read_text(errors="replace").rpartition(")")[2].split()[1])
    return [pid for pid, parent in parents.items() if parent == own]
