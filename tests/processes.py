"""Which processes a process has started, as the kernel tells."""

import contextlib
import subprocess
import time
from pathlib import Path


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
