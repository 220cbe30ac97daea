"""Wall time, CPU time and peak memory of a process."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Run:
    """Wall time [s] and peak resident memory [bytes] of one process, and CPU time [s] of it and of its children."""

    wall: float
    peak: int
    cpu: float


def run(*command: str, accepted: Sequence[int] = (0,)) -> Run:
    """Runs a command without its standard output; ends the benchmark unless its exit code is accepted."""
    start = time.perf_counter()
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        try:
            os.execvp(command[0], command)
        finally:
            os._exit(127)  # the program is missing
    _, status, usage = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status) not in accepted:
        raise SystemExit(f"{' '.join(command[:5])} failed")
    wall = time.perf_counter() - start
    return Run(wall, usage.ru_maxrss * 1024, usage.ru_utime + usage.ru_stime)
