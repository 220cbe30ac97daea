"""Colours: only on terminals that want them, and never part of the text."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import click
import pytest

from mjrun.cli.console import HELP_COLUMNS, HelpContext, coloured_help, coloured_message, shows_links
from tests.cases import cases

if TYPE_CHECKING:
    from pathlib import Path

pty = pytest.importorskip("pty")


def on_terminal(arguments: list[str], folder: Path, **variables: str) -> str:
    """Returns what a terminal shows of a command."""
    parent, child = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80", **variables}
    command = [sys.executable, "-m", "mjrun", *arguments]
    process = subprocess.Popen(command, stdout=child, stderr=child, stdin=child, cwd=folder, env=environment)
    os.close(child)
    shown = b""
    while True:
        try:
            part = os.read(parent, 65536)
        except OSError:  # the last process has closed it
            break
        if not part:
            break
        shown += part
    process.wait()
    os.close(parent)
    return shown.decode().replace("\r\n", "\n")


@pytest.mark.parametrize("arguments", [["--help"], ["trace", "nothing.xml"]])
def test_colours_are_additions_to_the_same_text(arguments: list[str], tmp_path: Path) -> None:
    coloured = on_terminal(arguments, tmp_path, NO_COLOR="")
    plain = on_terminal(arguments, tmp_path, NO_COLOR="1")
    assert "\x1b[" in coloured
    assert "\x1b[" not in plain
    assert click.unstyle(coloured) == plain
    assert on_terminal(arguments, tmp_path, NO_COLOR="", TERM="dumb") == plain


def test_nothing_is_coloured_in_a_pipe(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "mjrun", "trac"], cwd=tmp_path, capture_output=True)
    assert b"\x1b" not in done.stderr + done.stdout


def test_headings_options_and_commands_stand_out() -> None:
    text = "Usage: mjrun x\n\nModel:\n  -o, --output FILE  A file: any.\n  video       A video.\n"
    styled = coloured_help(text)
    for part, style in (("Usage:", {"bold": True}), ("Model:", {"bold": True}), ("-o, --output", {"fg": "cyan"})):
        assert click.style(part, **style) in styled  # type: ignore[arg-type]
    assert click.style("video", fg="cyan") in styled
    assert "A file: any." in styled


def test_only_the_first_words_of_a_message_are_coloured() -> None:
    assert (
        coloured_message("mjrun: error: a: error: b")
        == click.style("mjrun: error:", fg="red", bold=True) + " a: error: b"
    )
    assert coloured_message("a.mp4: made") == "a.mp4: made"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@cases("variables, shown")
def test_links_are_shown_only_by_terminals_that_are_known_to(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], shown: bool
) -> None:
    monkeypatch.setattr(os, "environ", variables)
    assert shows_links(Terminal()) == shown
    assert not shows_links(io.StringIO())


@pytest.mark.parametrize("columns", [None, "0", "30", "80", "97", "300", "wide"])
def test_help_is_as_wide_as_click_makes_it(columns: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    if columns is None:
        monkeypatch.delenv("COLUMNS", raising=False)
    else:
        monkeypatch.setenv("COLUMNS", columns)
    command = click.Command("model")
    expected = click.Context(command, max_content_width=HELP_COLUMNS).make_formatter().width
    assert HelpContext(command).make_formatter().width == expected
