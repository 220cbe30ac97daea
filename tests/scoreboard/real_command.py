"""mjrun run as users run it: an interpreter that starts, with a session, a temporary folder and a mark of its own.

Whatever a run starts inherits its mark, by which it is found later, wherever it has gone.
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tests.scoreboard.command import ROOT, Ended

MARK = "MJRUN_SCOREBOARD_RUN"
FOR_ONLOOKERS = {"COLUMNS": "120", "NO_COLOR": "1", "PYTHONPATH": str(ROOT)}
NOISE = ("Traceback (most recent call last)", "Exception ignored", "KeyboardInterrupt", "Fatal Python error")


@dataclass
class RealCommand:
    """One run of mjrun, which starts at once.

    Attributes:
      arguments: after `mjrun`.
      folder: the working folder.
      environment: variables to set.
      temporary: its folder for temporary files, which it is to leave empty.
    """

    arguments: tuple[str | bytes, ...]
    folder: Path
    environment: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._mark = uuid.uuid4().hex
        self._home = tempfile.TemporaryDirectory()
        self.temporary = Path(self._home.name, "tmp")
        self.temporary.mkdir()
        variables = {**os.environ, **FOR_ONLOOKERS, "TMPDIR": str(self.temporary), MARK: self._mark}
        self._began = time.monotonic()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is signal.SIG_IGN:  # as in the background of a shell; runs would inherit it
                signal.signal(number, signal.SIG_DFL)
        with self._stream("stdout").open("wb") as stdout, self._stream("stderr").open("wb") as stderr:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "mjrun", *self.arguments],
                cwd=self.folder,
                env={**variables, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                start_new_session=True,
            )

    def __enter__(self) -> "RealCommand":
        return self

    def __exit__(self, *_: object) -> None:
        """Kills what still runs."""
        for pid in self.running():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
        self._home.cleanup()

    def wait(self, limit: float) -> Ended:
        """How it ended, within `limit` [s]."""
        try:
            code: int | None = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
        out, err = (self._stream(name).read_bytes() for name in ("stdout", "stderr"))
        line = tuple(os.fsdecode(argument) for argument in self.arguments)
        return Ended(line, code, out, err, time.monotonic() - self._began)

    def running(self) -> list[int]:
        """The processes of this run that have not ended."""
        mark, found = f"{MARK}={self._mark}".encode(), list[int]()
        for environment in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                if mark in environment.read_bytes():
                    found.append(int(environment.parent.name))
        return found

    def leftovers(self, grace: float) -> list[str]:
        """What it has left behind, though it has ended: processes after `grace` [s], temporary files, hidden files."""
        deadline = time.monotonic() + grace
        while self.running() and time.monotonic() < deadline:
            time.sleep(0.02)
        found = [f"process {pid}: {_command_line(pid)}" for pid in self.running()]
        found += [f"temporary file {path.name}" for path in self.temporary.iterdir()]
        found += [f"file {path.relative_to(self.folder)}" for path in self.folder.rglob(".*.part")]
        return found

    def _stream(self, name: str) -> Path:
        return Path(self._home.name, name)


def contents(folder: Path) -> dict[str, bytes]:
    """The files under a folder, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def noise(ended: Ended) -> list[str]:
    """What of Python's own words nobody may see."""
    return [word for word in NOISE if word in ended.message]


def _command_line(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")[:200]
    except OSError:
        return "(gone)"
