"""The user's cache folder: results that can be made again, and the facts that decide whether they still hold."""

import hashlib
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from mjrun.file_version import file_version, is_settled
from mjrun.platform import system
from mjrun.version import __version__

VARIABLE = "MJRUN_CACHE"  # the environment variable with the folder, in place of the user's cache folder
LARGEST = 2**26  # bytes of all entries; the oldest are removed
FRESH = 86400  # [s] for which the use of an entry is not recorded again
PACKAGE = Path(__file__).parents[1]


class UserCache:
    """Entries in a folder of the user's cache, which several processes may share.

    Args:
      name: the part of mjrun that the entries belong to.
    """

    def __init__(self, name: str) -> None:
        self.folder = _folder(name)
        self._has_grown = False

    def read(self, key: str) -> Any | None:
        """Returns the value of an entry; None without one, or if it is damaged."""
        path = self.folder / key
        try:
            digest, _, text = path.read_bytes().partition(b"\n")
            is_fresh = time.time() - path.stat().st_mtime <= FRESH
        except OSError:
            return None
        if not is_fresh:
            with suppress(OSError):  # in a read-only folder, or of another user
                os.utime(path)
        return json.loads(text) if digest == _digest(text) else None

    def write(self, key: str, value: object) -> None:
        """Stores a value for JSON; nothing on a full disk, or in a folder without permission."""
        text = json.dumps(value).encode()
        with suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.folder, delete=False) as file:
                path = Path(file.name)
            try:
                path.write_bytes(_digest(text) + b"\n" + text)
                path.replace(self.folder / key)
            except OSError:
                path.unlink(missing_ok=True)
                raise
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


class FileDigestCache:
    """A cache of the hashes of files in memory: one that has neither been replaced nor written is read only once."""

    def __init__(self) -> None:
        self._digests: dict[tuple[object, ...], str] = {}

    def of(self, place: str) -> str:
        """Returns the SHA-256 of a regular file; an empty text if it is missing."""
        since, version = time.time_ns(), file_version(place)
        if version is None:
            return ""
        digest = self._digests.get((place, *version))
        if digest is None:
            try:
                with open(place, "rb") as file:  # noqa: PTH123 – of thousands; pathlib takes longer
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
            except OSError:
                return ""
            if is_settled(version, since):
                self._digests[place, *version] = digest
        return digest


@cache
def program_facts() -> Mapping[str, object]:
    """Returns the facts about the program and the machine that results depend on."""
    return {
        "version": __version__,
        "sources": hashlib.sha256(repr(sorted(_source_files(str(PACKAGE)))).encode()).hexdigest(),
        "machine": [sys.platform, platform.machine(), sys.version],
    }


def _digest(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode()


def _folder(name: str) -> Path:
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return Path(chosen) / name
    home = system.cache_home()
    return home / "mjrun" / name if home.is_absolute() else Path(os.devnull)  # a user without a home stores nothing


def _source_files(folder: str) -> Iterator[tuple[str, int, int]]:
    """Yields the path, size and time of each source file, which may change without the version."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                status = entry.stat()
                yield entry.path, status.st_size, status.st_mtime_ns
            elif entry.is_dir() and entry.name != "__pycache__":
                yield from _source_files(entry.path)
