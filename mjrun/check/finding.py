"""What a rule finds, and where."""

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

SEVERITIES = ("note", "warning", "error")  # from the least


@dataclass(frozen=True)
class Finding:
    """One thing wrong, or worth knowing.

    Attributes:
      code: of the rule, such as `MJ301`; stable.
      severity: `error`, `warning` or `note`.
      message: what is wrong, one line.
      file: where; the model, or a file that it includes. What a model attaches is told where it attaches it.
      line: of `file`, from 1 on, if it is known.
      object: what it is about, as in `joint 'knee'`; empty when it is about the whole.
      remedy: what to do about it.

    All texts but `code` and `severity` may hold foreign names as they are.
    """

    code: str
    severity: str
    message: str
    file: str
    line: int | None = None
    object: str = ""
    remedy: str = ""


class Place(NamedTuple):
    """Where something is said.

    Attributes:
      line: of `file`, from 1 on, if it is known.
      origin: file and line in a model that is attached at this place.
    """

    file: Path
    line: int | None = None
    origin: tuple[Path, int] | None = None


class Sighting(NamedTuple):
    """What a rule function yields; the registry knows the rest of the finding.

    Attributes:
      place: file and line, and an origin where there is one; the model itself when None.
      severity: instead of the rule's own.
    """

    message: str
    remedy: str
    object: str = ""
    place: Place | tuple[Path, int | None] | None = None
    severity: str = ""

    def finding(self, code: str, severity: str, path: Path) -> Finding:
        """The finding of the rule `code` in the model `path`."""
        file, line, origin = self.place if isinstance(self.place, Place) else Place(*(self.place or (path, None)))
        message = f"{self.message} (attached from {tidy(origin[0])}:{origin[1]})" if origin else self.message
        return Finding(code, self.severity or severity, message, tidy(file), line, self.object, self.remedy)


def tidy(path: Path) -> str:
    """`path` without detours, as in `arm/../hand/hand.xml`, if that is still the same file."""
    short = Path(os.path.normpath(path))
    with suppress(OSError, ValueError):
        if short != path and short.samefile(path):
            return str(short)
    return str(path)


class Rule(NamedTuple):
    """Something to look for.

    Attributes:
      severity: of its findings as a rule.
      title: a few words.
      find: yields what it sees in a `LintContext`; None for what is found while loading or stepping.
    """

    severity: str
    title: str
    find: Callable[[Any], Iterator[Sighting]] | None = None
