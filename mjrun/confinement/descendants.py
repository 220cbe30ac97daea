"""The processes that a process has started, and those have started: found by the system, whatever they do."""

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
    """Makes this process the parent of all its descendants whose own parents end; returns whether the system can."""
    return sys.platform == "linux" and ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0) == 0


def kill() -> None:
    """Kills the children of this process, and what becomes its children when they have ended."""
    deadline = time.monotonic() + PURSUIT
    while time.monotonic() < deadline:
        for pid in _children():
            with suppress(ProcessLookupError):  # it may have been one of another user's, or reaped meanwhile
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:  # there are none any more
            return
        os.sched_yield()


def _children() -> list[int]:
    own = os.getpid()
    with suppress(OSError):
        return [int(pid) for pid in Path(f"/proc/{own}/task/{own}/children").read_text().split()]
    parents: dict[int, int] = {}  # by process, where the kernel does not list children
    for process in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            parents[int(process.parent.name)] = int(process.read_text(errors="replace").rpartition(")")[2].split()[1])
    return [pid for pid, parent in parents.items() if parent == own]
