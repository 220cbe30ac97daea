"""Theorems about the streams of a command, about colours on terminals, and about opening what it has made."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import click
import pytest

from mjrun.cli import console as module
from mjrun.cli.console import (
    HELP_COLUMNS,
    Console,
    HelpContext,
    _files_in,
    coloured_help,
    coloured_message,
    flag,
    shows_links,
)
from mjrun.errors import option
from tests.cases import cases


@pytest.fixture
def console() -> Console:
    return Console()


def test_an_option_is_spelled_as_a_flag() -> None:
    assert flag("trail_span") == "--trail-span"
    assert flag("fps") == "--fps"


def test_the_answer_goes_to_stdout_and_messages_to_stderr(console: Console, capsys: pytest.CaptureFixture[str]) -> None:
    console.result("answer")
    console.document({"a": [1]})
    console.finish()
    console.say("said")
    for _ in range(2):  # as two outputs of a document do
        console.note(f"{option('trail_span')} noted")
    console.warn("warned")
    console.error(f"{option('fps')}: wrong\nvalid: 30")
    out, err = capsys.readouterr()
    first, _, document = out.partition("\n")
    assert (first, json.loads(document)) == ("answer", {"a": [1]})
    assert err.splitlines() == [
        "said",
        "mjrun: --trail-span noted",
        "mjrun: warning: warned",
        "mjrun: error: --fps: wrong",
        "  valid: 30",
    ]


def test_a_quiet_console_has_only_answers_and_errors(console: Console, capsys: pytest.CaptureFixture[str]) -> None:
    console.verbosity = -1
    for speak in (console.say, console.note, console.warn, console.result, console.error):
        speak("text")
    console.progress("models", 1, 2)
    assert capsys.readouterr() == ("text\n", "mjrun: error: text\n")


def test_without_a_terminal_progress_is_a_line_now_and_then_and_none_at_the_end(
    console: Console, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    console = Console()
    for done in range(1, 101):
        clock[0] += 1
        console.progress("frames", done, 100)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "mjrun: 11 of 100 frames"
    assert len(lines) == 9


def test_on_a_terminal_progress_is_a_bar_that_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    console = Console()
    console.progress("frames", 1, 100)
    console.warn("meanwhile")
    console.progress("frames", 77, 100)
    assert console._progress
    console.progress("frames", 78, 100)  # a pace needs two intervals
    console._progress.refresh()
    assert "78/100" in screen.getvalue()
    assert re.search(r"\d/s", screen.getvalue())
    console.progress("frames", 100, 100)
    assert console._progress is None
    assert sys.stderr is screen
    assert "meanwhile" in screen.getvalue()


def test_what_native_libraries_print_goes_to_stderr_while_stdout_is_guarded() -> None:
    code = (
        "import os; from mjrun.cli.console import Console; console = Console(); console.guard_stdout();"
        "os.write(1, b'native\\n'); console.result('answer'); console.release_stdout(); os.write(1, b'after\\n')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=os.environ)
    assert (done.stdout, done.stderr) == (b"answer\nafter\n", b"native\n")


def test_debug_shows_the_traceback(console: Console, capsys: pytest.CaptureFixture[str]) -> None:
    console.debug = True
    try:
        raise KeyError("planted")
    except KeyError:
        console.error("failed")
    err = capsys.readouterr().err
    assert err.startswith("Traceback")
    assert err.endswith("mjrun: error: failed\n")


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


if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import Command


PATIENCE = 60  # [s], on a busy machine


@pytest.fixture
def desktop(tmp_path: Path) -> dict[str, str]:
    """An environment with a display and a program that opens files."""
    program = tmp_path / "bin/xdg-open"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\necho "$1" > {tmp_path}/opened.part\nmv {tmp_path}/opened.part {tmp_path}/opened\n')
    program.chmod(0o755)
    return {**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}", "DISPLAY": ":9"}


def opened(folder: Path) -> str:
    """Returns the file that was opened, once the program has written it down."""
    end = time.monotonic() + PATIENCE
    while not (folder / "opened").exists() and time.monotonic() < end:
        time.sleep(0.01)
    return (folder / "opened").read_text().strip()


TRACED = ("trace", "scene:pendulum", "--steps", "2", "-o", "a.csv")


def test_the_file_that_was_made_is_opened(mjrun: Command, desktop: dict[str, str], tmp_path: Path) -> None:
    done = mjrun(*TRACED, "--open", env=desktop)
    assert (done.returncode, done.stderr) == (0, b"")
    assert opened(tmp_path) == "a.csv"


def test_a_page_is_opened_rather_than_tables(mjrun: Command, desktop: dict[str, str], tmp_path: Path) -> None:
    vary = ("--vary", "seed=1,2", "--metric", "m=max(time)", "--jobs", "1")
    done = mjrun("sweep", "scene:pendulum", "--steps", "2", *vary, "--html", "p.html", "-o", "s", "--open", env=desktop)
    assert done.returncode == 0
    assert opened(tmp_path) == "p.html"


def test_without_a_display_a_warning_names_the_file(mjrun: Command, desktop: dict[str, str]) -> None:
    done = mjrun(*TRACED, "--open", env={**desktop, "DISPLAY": "", "WAYLAND_DISPLAY": ""})
    assert done.returncode == 0
    assert done.stderr == b"mjrun: warning: --open: a.csv is not shown: this session has no display\n"


def test_nothing_is_opened_if_no_file_was_made_or_no_program_may_start(mjrun_here: Command) -> None:
    done = mjrun_here("trace", "scene:pendulum", "--steps", "2", "--csv", "--open")
    assert (done.returncode, done.stderr) == (0, b"mjrun: warning: --open: no file was made\n")
    done = mjrun_here(*TRACED, "--open", "--untrusted")
    assert done.returncode == 2
    assert b"--open starts another program, which --untrusted prevents" in done.stderr


def test_paths_are_found_anywhere_in_a_report() -> None:
    document = {"results": [{"path": "a", "size": [1, 2]}, {"paths": ["b", "c"]}], "html": None, "name": "d"}
    assert list(_files_in(document)) == ["a", "b", "c"]
