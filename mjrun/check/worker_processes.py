"""The processes in which models are looked at: started, watched, listened to, ended."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

MIB = 2**20
MOST_SAID = 16 * MIB  # bytes that are read of what one process says
MOST_TOLD = 2**16  # bytes that are kept of what libraries print in it
LOOK = 0.05  # [s] between two looks at a process
CODE = "import sys; sys.path.append(sys.argv[1]); from mjrun.check.worker import main; main()"


@dataclass(frozen=True)
class Said:
    """What came of a process.

    Attributes:
      lines: the objects it wrote.
      code: its exit code; None when it was ended from here.
      printed: what libraries printed in it.
      starved: whether it was ended because of its memory.
    """

    lines: Sequence[dict[str, Any]] = ()
    code: int | None = None
    printed: bytes = b""
    starved: bool = False


class Children:
    """Processes that look at models; all are ended together."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._ended = False

    def run(self, asked: str, timeout: float, memory: int) -> Said:
        """Runs one for at most `timeout` [s] in at most `memory` [MiB]."""
        with self._lock:
            if self._ended:
                return Said()
            child = _started(asked)
            self._running.add(child)
        assert child.stdout
        assert child.stderr
        with child.stdout, child.stderr:
            said, printed = Drain(child.stdout, MOST_SAID), Drain(child.stderr, MOST_TOLD)
            try:
                code, starved = _watched(child, timeout, memory)
            finally:
                with self._lock:
                    self._running.discard(child)
                child.kill()
                child.wait()
            return Said(_lines(said.result()), code, printed.result(), starved)

    def end(self) -> None:
        """Ends those that run, and lets none start."""
        with self._lock:
            self._ended = True
            for child in self._running:
                child.kill()


def _watched(child: subprocess.Popen[bytes], timeout: float, memory: int) -> tuple[int | None, bool]:
    """The exit code of `child`, or None when its time or memory [MiB] is up, and whether it was the memory."""
    deadline = time.monotonic() + timeout
    while (left := deadline - time.monotonic()) > 0:
        with suppress(subprocess.TimeoutExpired):
            return child.wait(min(LOOK, left)), False
        if _resident(child.pid) > memory * MIB:
            return None, True
    return None, False


def _resident(pid: int) -> int:
    """The memory that a process fills [bytes]; 0 where that cannot be told."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0


def _started(asked: str) -> subprocess.Popen[bytes]:
    package = str(Path(__file__).parents[2])
    quiet = {"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
    return subprocess.Popen(
        [sys.executable, "-P", "-B", "-c", CODE, package, asked],  # -P: the models' folder is no place for modules
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, **quiet},
        start_new_session=True,
    )


class Drain(threading.Thread):
    """Reads a pipe to its end, and keeps the beginning."""

    def __init__(self, pipe: IO[bytes], most: int) -> None:
        super().__init__(daemon=True)
        self._pipe, self._most, self._kept = pipe, most, bytearray()
        self.start()

    def run(self) -> None:
        while chunk := os.read(self._pipe.fileno(), 2**16):
            self._kept += chunk[: self._most - len(self._kept)]

    def result(self) -> bytes:
        """What was kept, when the pipe has ended."""
        self.join()
        return bytes(self._kept)


def _lines(said: bytes) -> list[dict[str, Any]]:
    """The JSON objects of `said`; a last line that was broken off is left out."""
    found = []
    for line in said.splitlines():
        with suppress(ValueError):
            found.append(json.loads(line))
    return found
