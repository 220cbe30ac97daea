"""The files of a pass: no two outputs share a file, and no output overwrites an input."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from mjrun.errors import UsageError, clean

_NUMBER = re.compile(r"%[0-9]*d")  # the frame number in a pattern such as frame_%04d.png


def named_files(**paths: str | None) -> list[tuple[str, str]]:
    """Returns pairs of role and path, without files that are not requested."""
    return [(name, path) for name, path in paths.items() if path is not None]


class ReservedFiles:
    """Paths that are already read or written."""

    def __init__(self) -> None:
        self._owners: dict[Path, str] = {}  # by file
        self._below: dict[Path, str] = {}  # owners of a file below each folder
        self._patterns: list[tuple[re.Pattern[str], str]] = []

    def reserve(self, path: str | Path, owner: str) -> None:
        """Reserves a file, a folder or a frame pattern; messages call it `owner`. `-` is ignored.

        Raises:
          UsageError: it is reserved, lies in a frame folder, or is a folder that contains a reserved file.
        """
        if path == "-":
            return
        file = Path(os.path.realpath(path))
        other = next(self._conflicts(file), None)
        if other:
            raise UsageError(f"{clean(str(path))} clashes with {other}; each output needs a separate file")
        self._add(file, owner)
        if frame := _frame(file):
            self._patterns.append((frame, owner))

    def reserve_input(self, path: str | Path, owner: str) -> None:
        """Reserves a file that is read, resolving links."""
        self._add(Path(os.path.realpath(path)), owner)

    def _add(self, file: Path, owner: str) -> None:
        self._owners.setdefault(file, owner)
        self._below.update(dict.fromkeys(file.parents, owner))

    def _conflicts(self, file: Path) -> Iterator[str]:
        """Yields the owners of `file`, of files below it, and of the folders that contain it."""
        if file in self._below:
            yield self._below[file]
        yield from (self._owners[path] for path in (file, *file.parents) if path in self._owners)
        yield from (owner for frame, owner in self._patterns if frame.fullmatch(_first(file)))
        if frame := _frame(file):
            yield from (owner for other, owner in self._owners.items() if frame.fullmatch(_first(other)))


def _first(file: Path) -> str:
    """Returns the path of a file; for a frame pattern, that of its first frame."""
    return str(file.parent / _NUMBER.sub("0", file.name, count=1))


def _frame(file: Path) -> re.Pattern[str] | None:
    """Returns the expression that matches the frames of a pattern; None if the path is not a pattern."""
    if not _NUMBER.search(file.name):
        return None
    before, after = (re.escape(part) for part in _NUMBER.split(file.name, maxsplit=1))
    return re.compile(f"{re.escape(str(file.parent))}/{before}[0-9]+{after}")
