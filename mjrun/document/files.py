"""The files that a run document asks for: all inside one folder, no two the same."""

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated

from pydantic import AfterValidator

from mjrun.document.form import ComplaintError, Name
from mjrun.errors import UsageError, clean, quoted

WRITTEN = ("output", "contacts", "calibration", "pointcloud", "manifest")  # what names outputs, of jobs and documents

_NUMBER = re.compile(r"%[0-9]*d")  # of a frame, in a pattern such as frame_%04d.png


def refusal(text: str) -> str:
    """Why a document may not write to `text`; empty if it may, as far as the text tells."""
    parts = PurePosixPath(text).parts
    depths = [sum(-1 if part == ".." else 1 for part in parts[:end]) for end in range(1, len(parts) + 1)]
    if text == "-":
        return "- is standard output, and a document writes files"
    if "\0" in text:
        return f"{quoted(text)} holds a character that no path has"
    if text.startswith(("/", "~")):
        return f"{quoted(text)} is no path inside the folder of outputs"
    if min(depths, default=0) < 0:
        return f"{quoted(text)} leaves the folder of outputs"
    return "" if depths and depths[-1] > 0 else f"{quoted(text)} is the folder of outputs itself"


def _inside(text: str) -> str:
    if reason := refusal(text):
        raise ComplaintError.saying(reason)
    return text


Inside = Annotated[Name, AfterValidator(_inside)]  # a path that a document may write to, as far as the text tells


class Files:
    """The outputs of a run, inside `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._takers: dict[Path, str] = {}  # of files
        self._below: dict[Path, str] = {}  # of folders with files in them
        self._patterns: list[tuple[re.Pattern[str], str]] = []

    def path(self, text: str) -> str:
        """Where the output `text`, an `Inside`, is; a folder of frames ends in a slash as before.

        Raises:
          UsageError: a link leads out of the folder.
        """
        path = self._folder / text
        self._resolved(path)
        return f"{path}/" if text.endswith("/") else str(path)

    def take(self, path: str, taker: str) -> None:
        """Reserves a file for one output; `taker` says of which, and where it is asked for.

        Raises:
          UsageError: it is another's too, or a link leads out of the folder.
        """
        file = self._resolved(Path(path))
        other = next(self._conflicts(file), None)
        if other:
            raise UsageError(f"{clean(path)} clashes with {other}; each output needs a file of its own")
        self._takers[file] = taker
        self._below.update(dict.fromkeys(file.parents, taker))
        if frame := _frame(file):
            self._patterns.append((frame, taker))

    def _conflicts(self, file: Path) -> Iterator[str]:
        """Who else writes `file`, something in it as in a folder, or the folder that it is in."""
        if file in self._below:
            yield self._below[file]
        yield from (self._takers[path] for path in (file, *file.parents) if path in self._takers)
        yield from (taker for frame, taker in self._patterns if frame.fullmatch(_first(file)))
        if frame := _frame(file):
            yield from (taker for other, taker in self._takers.items() if frame.fullmatch(_first(other)))

    def _resolved(self, path: Path) -> Path:
        """`path` with all links followed."""
        try:
            file, folder = path.resolve(), self._folder.resolve()
        except (OSError, RuntimeError) as error:  # links in a circle
            raise UsageError(f"{clean(str(path))} cannot be reached: {clean(str(error))}") from None
        if folder not in file.parents:
            raise UsageError(f"{clean(str(path))} leads out of the folder of outputs, by a link")
        return file


def _first(file: Path) -> str:
    """The path of a file, or of a frame if it is a pattern."""
    return str(file.parent / _NUMBER.sub("0", file.name, count=1))


def _frame(file: Path) -> re.Pattern[str] | None:
    """What fits the frames of a pattern."""
    if not _NUMBER.search(file.name):
        return None
    before, after = (re.escape(part) for part in _NUMBER.split(file.name, maxsplit=1))
    return re.compile(f"{re.escape(str(file.parent))}/{before}[0-9]+{after}")
