"""The files of a pass: no two outputs are the same file, and none is an input."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from mjrun.errors import UsageError, clean

_NUMBER = re.compile(r"%[0-9]*d")  # of a frame, in a pattern such as frame_%04d.png


def named_files(**paths: str | None) -> list[tuple[str, str]]:
    """Files by what they are, without those that are not asked for."""
    return [(name, path) for name, path in paths.items() if path is not None]


class ReservedFiles:
    """Files that are read or written already."""

    def __init__(self) -> None:
        self._owners: dict[Path, str] = {}  # of files
        self._below: dict[Path, str] = {}  # owners of something in these folders
        self._patterns: list[tuple[re.Pattern[str], str]] = []

    def reserve(self, path: str | Path, owner: str) -> None:
        """Reserves a file, a folder or a pattern of frames; messages call it `owner`. `-` is no file.

        Raises:
          UsageError: it is reserved, lies in a folder of frames, or is a folder with a reserved file in it.
        """
        if path == "-":
            return
        file = Path(os.path.realpath(path))
        other = next(self._conflicts(file), None)
        if other:
            raise UsageError(f"{clean(str(path))} clashes with {other}; each output needs a file of its own")
        self._add(file, owner)
        if frame := _frame(file):
            self._patterns.append((frame, owner))

    def reserve_input(self, path: str | Path, owner: str) -> None:
        """Reserves a file that is read, by another name too perhaps: a link to it, say."""
        self._add(Path(os.path.realpath(path)), owner)

    def _add(self, file: Path, owner: str) -> None:
        self._owners.setdefault(file, owner)
        self._below.update(dict.fromkeys(file.parents, owner))

    def _conflicts(self, file: Path) -> Iterator[str]:
        """Owners of `file`, of something in it as in a folder, or of the folder that it is in."""
        if file in self._below:
            yield self._below[file]
        yield from (self._owners[path] for path in (file, *file.parents) if path in self._owners)
        yield from (owner for frame, owner in self._patterns if frame.fullmatch(_first(file)))
        if frame := _frame(file):
            yield from (owner for other, owner in self._owners.items() if frame.fullmatch(_first(other)))


def _first(file: Path) -> str:
    """The path of a file, or of a frame if it is a pattern."""
    return str(file.parent / _NUMBER.sub("0", file.name, count=1))


def _frame(file: Path) -> re.Pattern[str] | None:
    """What matches the frames of a pattern."""
    if not _NUMBER.search(file.name):
        return None
    before, after = (re.escape(part) for part in _NUMBER.split(file.name, maxsplit=1))
    return re.compile(f"{re.escape(str(file.parent))}/{before}[0-9]+{after}")
