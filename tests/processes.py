"""Processes in tests: those that a process has started, and waiting for them on a machine of any load."""

import contextlib
import re
import resource
import subprocess
import time
from collections.abc import Callable, Generator
from pathlib import Path

PATIENCE = 1800  # [s] that a test waits for what must come: no figure of speed, but the end of a test that hangs


PROGRESS = re.compile(rb"^mjrun: \d+ of \d+ (?!.* are )[a-z ]+(, \d+ failed)?\n", re.MULTILINE)


def without_progress(messages: bytes) -> bytes:
    """Returns messages without the lines of progress that a slow command prints."""
    return PROGRESS.sub(b"", messages)


def wait_until(condition: Callable[[], object], while_running: "subprocess.Popen[bytes] | None" = None) -> None:
    """Waits until a condition holds, as long as it takes; fails if the process that is to bring it about ends."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert while_running is None or while_running.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)


def command_line_of(pid: int) -> bytes:
    """Returns the command line of a process; empty once it has ended, even as a zombie."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def children(parent: int) -> list[int]:
    """Returns the process ids of its children, including zombies."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            above = (folder / "stat").read_text().rpartition(")")[2].split()[1]
            if int(above) == parent:
                found.append(int(folder.name))
    return found


def worker(command: "subprocess.Popen[bytes]") -> int:
    """Returns the process that does the work of a started `mjrun`: its only child, which it watches."""
    while not (found := children(command.pid)):
        assert command.poll() is None
        time.sleep(0.01)
    (process,) = found
    return process


@contextlib.contextmanager
def largest_file(size: int) -> Generator[None]:
    """Refuses to let files of this process grow beyond `size` bytes in the `with` block, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextlib.contextmanager
def memory_limit_restored() -> Generator[None]:
    """Lifts the limit of memory that the `with` block sets for this process, as a check of a model does."""
    limit = resource.getrlimit(resource.RLIMIT_AS)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limit)
