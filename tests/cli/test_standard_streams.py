"""Streams that the caller has closed, or that are full: what may be lost, and what may not."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests import prepared_interpreters

if TYPE_CHECKING:
    from pathlib import Path


PRINTING = ("--help", "info swing.xml", "trace swing.xml --steps 2")
IMAGE = "image swing.xml -o - --size 32x32"


def redirected(folder: Path, line: str) -> subprocess.CompletedProcess[bytes]:
    """`mjrun` with the arguments and redirections in `line`, by a shell."""
    # Only a new interpreter finds a stream closed.
    program = f"'{sys.executable}' -m mjrun" if ">&-" in line else prepared_interpreters.program()
    command = f"exec {program} {line}"
    return subprocess.run(["/bin/sh", "-c", command], capture_output=True, cwd=folder)


# What is printed is written in one place, and an image in another.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "redirection"),
    [
        *((line, "> /dev/full") for line in (*PRINTING, IMAGE)),
        *((line, redirection) for line in ("info swing.xml", IMAGE) for redirection in (">&-", "<&- >&-")),
    ],
)
def test_a_payload_that_cannot_be_written_is_an_unwritable_output(swing: Path, line: str, redirection: str) -> None:
    done = redirected(swing.parent, f"{line} {redirection}")
    assert done.returncode == 7, done.stderr
    assert b"No space left on device" in done.stderr or b"is closed" in done.stderr
    assert done.stderr.count(b"\n") <= 2
    assert done.stdout == b""


@pytest.mark.slow
@pytest.mark.parametrize(("line", "code"), [("info swing.xml", 0), ("info swing", 3), ("info --no-such", 2)])
def test_lost_messages_change_nothing(swing: Path, line: str, code: int) -> None:
    plain = redirected(swing.parent, line)
    for redirection in ("2> /dev/full", "<&- 2>&-"):
        lost = redirected(swing.parent, f"{line} {redirection}")
        assert (lost.returncode, lost.stdout, lost.stderr) == (code, plain.stdout, b""), redirection


def test_what_was_made_stays_when_its_summary_cannot_be_printed(swing: Path) -> None:
    done = redirected(swing.parent, "trace swing.xml --steps 2 -o made.csv > /dev/full")
    assert done.returncode == 7
    assert (swing.parent / "made.csv").read_text().count("\n") == 4


def test_closed_streams_are_not_mistaken_for_files(swing: Path) -> None:
    """The numbers of closed streams are the first that the system gives to files opened later."""
    done = redirected(swing.parent, "trace swing.xml --steps 2 -o made.csv <&- >&- 2>&-")
    assert done.returncode == 7
    assert (swing.parent / "made.csv").read_text().startswith("time,")
