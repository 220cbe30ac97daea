"""Processes in tests: those that a process has started, and waiting for them on a machine of any load."""

import contextlib
import re
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

PATIENCE = 1800  # [s] that a test waits for what must come: no figure of speed, but the end of a test that hangs


PROGRESS = re.compile(rb"^mjrun: \d+ of \d+ (?!.* are )[a-z ]+(, \d+ failed)?\n", re.MULTILINE)


def without_progress(messages: bytes) -> bytes:
    """Messages without the lines of progress that a command prints now and then where it takes its time."""
    return PROGRESS.sub(b"", messages)


def wait_until(condition: Callable[[], object], while_running: "subprocess.Popen[bytes] | None" = None) -> None:
    """Waits until a condition holds, as long as it takes; fails if the process that is to bring it about ends."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert while_running is None or while_running.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)


def command_line_of(pid: int) -> bytes:
    """The command line of a process; empty once it has ended, even if nobody has waited for it."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def children(parent: int) -> list[int]:
    """Process ids of its children, ended ones that nobody waited for included."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            above = (folder / "stat").read_text().rpartition(")")[2].split()[1]
            if int(above) == parent:
                found.append(int(folder.name))
    return found


def worker(command: "subprocess.Popen[bytes]") -> int:
    """The process that does the work of a `mjrun` that was started: its only child, which it watches."""
    while not (found := children(command.pid)):
        assert command.poll() is None
        time.sleep(0.01)
    (process,) = found
    return process
