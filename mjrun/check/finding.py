"""Findings, violations of rules, and their places in files."""

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

SEVERITIES = ("note", "warning", "error")  # in ascending order


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a model, or worth knowing.

    Attributes:
      code: of the rule, such as `MJ301`; stable.
      severity: `error`, `warning` or `note`.
      message: what is wrong, in one line.
      file: the model, or a file that it includes. For a model that it attaches, this is where it is attached.
      line: in `file`, counted from 1, if known.
      object: what the finding is about, such as `joint 'knee'`; empty if it is about the whole model.
      remedy: what to do about it.

    All texts but `code` and `severity` may hold names from the model unescaped.
    """

    code: str
    severity: str
    message: str
    file: str
    line: int | None = None
    object: str = ""
    remedy: str = ""


class Place(NamedTuple):
    """A line of a file.

    Attributes:
      line: counted from 1, if known.
      origin: file and line in the model that is attached at this place.
    """

    file: Path
    line: int | None = None
    origin: tuple[Path, int] | None = None


class Violation(NamedTuple):
    """What the function of a rule yields.

    Attributes:
      severity: overrides the severity of the rule, if not empty.
    """

    message: str
    remedy: str
    place: Place
    object: str = ""
    severity: str = ""


def short_path(path: Path) -> str:
    """`path` without detours such as `arm/../hand/hand.xml`, if that is still the same file."""
    short = Path(os.path.normpath(path))
    with suppress(OSError, ValueError):
        if short != path and short.samefile(path):
            return str(short)
    return str(path)
