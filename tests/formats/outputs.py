"""Outputs of tests, with and without an exchange of names by the system."""

from pathlib import Path

import pytest

from mjrun.formats import temporary_output
from mjrun.formats.output_writer import Destination


def names(folder: Path) -> list[str]:
    """What is in a folder, hidden files too."""
    return sorted(path.name for path in folder.iterdir())


def fill(target: Destination, count: int, text: str) -> None:
    """Writes what an encoder would: numbered frames, or one file."""
    if "%06d" in target.path:
        for index in range(count):
            Path(target.path % index).write_text(f"{text} {index}")
    else:
        Path(target.path).write_text(text)


def no_exchange(*_: object) -> bool:
    """Stands in for a system that cannot exchange two names in one step."""
    return False


both_ways = pytest.mark.parametrize("exchange", [temporary_output.exchange, no_exchange])
