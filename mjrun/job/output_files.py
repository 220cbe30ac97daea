"""The files of jobs: no two outputs are the same one, and none is what is read."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from mjrun.errors import UsageError, clean

_NUMBER = re.compile(r"%[0-9]*d")  # of a frame, in a pattern such as frame_%04d.png


def named(job: object, *keys: str) -> list[tuple[str, str]]:
    """The files that these fields of a job name, each with the field; without those that are None."""
    return [(key, path) for key in keys if (path := getattr(job, key)) is not None]


class ReservedFiles:
    """Files that are spoken for."""

    def __init__(self) -> None:
        self._takers: dict[Path, str] = {}  # of files
        self._below: dict[Path, str] = {}  # of folders with files in them
        self._patterns: list[tuple[re.Pattern[str], str]] = []

    def take(self, path: str | Path, taker: str) -> None:
        """Reserves a file, a folder or a pattern of frames for `taker`, which names it in errors; `-` is no file.

        Raises:
          UsageError: it is another's too, lies in a folder of frames, or is a folder with another's file in it.
        """
        if path == "-":
            return
        file = Path(os.path.realpath(path))
        other = next(self._conflicts(file), None)
        if other:
            raise UsageError(f"{clean(str(path))} clashes with {other}; each output needs a file of its own")
        self._takers[file] = taker
        self._below.update(dict.fromkeys(file.parents, taker))
        if frame := _frame(file):
            self._patterns.append((frame, taker))

    def _conflicts(self, file: Path) -> Iterator[str]:
        """Who else has `file`, something in it as in a folder, or the folder that it is in."""
        if file in self._below:
            yield self._below[file]
        yield from (self._takers[path] for path in (file, *file.parents) if path in self._takers)
        yield from (taker for frame, taker in self._patterns if frame.fullmatch(_first(file)))
        if frame := _frame(file):
            yield from (taker for other, taker in self._takers.items() if frame.fullmatch(_first(other)))


def _first(file: Path) -> str:
    """The path of a file, or of a frame if it is a pattern."""
    return str(file.parent / _NUMBER.sub("0", file.name, count=1))


def _frame(file: Path) -> re.Pattern[str] | None:
    """What fits the frames of a pattern."""
    if not _NUMBER.search(file.name):
        return None
    before, after = (re.escape(part) for part in _NUMBER.split(file.name, maxsplit=1))
    return re.compile(f"{re.escape(str(file.parent))}/{before}[0-9]+{after}")
