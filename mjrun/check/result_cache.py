"""Results of earlier checks, in the user's cache folder: a model is checked again only if something has changed.

The name of an entry is a hash of everything that a result depends on: the content of all files that MuJoCo may open
for the model, and which of them are missing; the settings; the versions of mjrun, MuJoCo and NumPy.
"""

import hashlib
import json
import os
import platform
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from mjrun.check.rules.process_failures import CRASH, INTERNAL_ERROR, OUT_OF_MEMORY, TIMEOUT
from mjrun.check.worker_pool import PACKAGE, WorkerTask
from mjrun.confinement.confinement import confinement
from mjrun.model.archive_paths import main_text
from mjrun.model.named_files import places_of_files
from mjrun.platform import system
from mjrun.suffixes import ARCHIVES
from mjrun.version import __version__

VARIABLE = "MJRUN_CACHE"  # the environment variable with the folder, in place of the user's cache folder
LARGEST = 2**26  # bytes of all entries; the oldest are removed
LIMITS = {"timeout", "memory"}  # of a task, which do not affect a result that is complete
DISTURBED = {rule.code for rule in (CRASH, INTERNAL_ERROR, OUT_OF_MEMORY, TIMEOUT)}  # may differ the next time
FRESH = 86400  # [s] for which the use of an entry is not recorded again

Messages = Sequence[Mapping[str, Any]]


class ResultCache:
    """A cache of the results of checks, which several processes may share.

    Args:
      versions: the versions of packages by name.
    """

    def __init__(self, versions: Mapping[str, str]) -> None:
        self.folder = _folder()
        self._versions = versions
        self._digests: dict[tuple[object, ...], str] = {}
        self._has_grown = False

    def key(self, task: WorkerTask) -> str:
        """Returns the name of the entry for a check; empty if the result depends on more than files and settings."""
        if confinement() is not None or task.reader:  # tasks run code
            return ""
        path = Path(task.path)
        text, main = main_text(path)
        files = places_of_files(path, text, main)
        if files is None:
            return ""
        states = {place: self._digest(place) for places in files for place in places}
        # A remedy for a missing file names others, which may come and go.
        if path.suffix not in ARCHIVES and not all(any(states[place] for place in places) for places in files):
            return ""
        settings = {name: value for name, value in asdict(task).items() if name not in LIMITS}
        facts = [self._origin, settings, self._digest(task.path), states]
        return hashlib.sha256(json.dumps(facts).encode()).hexdigest()

    def read(self, key: str) -> Messages | None:
        """Returns the messages of an earlier check; None without one."""
        if not key:
            return None
        path = self.folder / key
        try:
            messages: Messages = json.loads(path.read_bytes())
            if time.time() - path.stat().st_mtime > FRESH:
                os.utime(path)
        except (OSError, ValueError):
            return None
        return messages

    def write(self, key: str, task: WorkerTask, messages: Messages) -> None:
        """Stores the messages of a check that is complete, unless its files have changed since it began."""
        codes = {message["finding"]["code"] for message in messages if "finding" in message}
        is_complete = any("done" in message for message in messages) and not codes & DISTURBED
        if not key or not is_complete or self.key(task) != key:
            return
        kept = [message for message in messages if message.keys().isdisjoint({"pid", "stage"})]
        with suppress(OSError):  # a full disk or a folder without permission: nothing is stored
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.folder, delete=False) as file:
                file.write(json.dumps(kept).encode())
            Path(file.name).replace(self.folder / key)
            self._has_grown = True

    def trim(self) -> None:
        """Removes the entries that have not been used for the longest time, if this process has added some."""
        if not self._has_grown:
            return
        entries: list[tuple[float, int, str]] = []
        with suppress(OSError), os.scandir(self.folder) as files:
            for file in files:
                with suppress(OSError):  # another process has removed it
                    entries.append((file.stat().st_mtime, file.stat().st_size, file.path))
        excess = sum(size for _, size, _ in entries) - LARGEST
        for _, size, path in sorted(entries):
            if excess <= 0:
                return
            with suppress(OSError):
                Path(path).unlink()
            excess -= size

    @cached_property
    def _origin(self) -> list[object]:
        """The program and the machine that results depend on, and the folder that relative paths start from."""
        sources = sorted(_source_files(f"{PACKAGE}/mjrun"))
        machine = [sys.platform, platform.machine(), sys.version]
        return [__version__, dict(self._versions), sources, machine, str(Path.cwd())]

    def _digest(self, place: str) -> str:
        """Returns a hash of a regular file; an empty text if it is missing."""
        try:
            status = os.stat(place)  # noqa: PTH116 – of thousands; pathlib takes longer
            if not stat.S_ISREG(status.st_mode):
                return ""
            version = (place, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)
            if version not in self._digests:
                with open(place, "rb") as file:  # noqa: PTH123
                    self._digests[version] = hashlib.file_digest(file, "sha256").hexdigest()
        except (OSError, ValueError):
            return ""
        return self._digests[version]


def _folder() -> Path:
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return Path(chosen)
    home = system.cache_home()
    return home / "mjrun" / "check" if home.is_absolute() else Path(os.devnull)  # a user without a home stores nothing


def _source_files(folder: str) -> Iterator[tuple[str, int, int]]:
    """Yields the path, size and time of each source file, which may change without the version."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                status = entry.stat()
                yield entry.path, status.st_size, status.st_mtime_ns
            elif entry.is_dir() and entry.name != "__pycache__":
                yield from _source_files(entry.path)
