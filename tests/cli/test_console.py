"""Theorems about the streams of a command: the payload on stdout, everything else on stderr."""

import io
import json
import os
import re
import subprocess
import sys

import pytest

from mjrun.cli import console as module
from mjrun.cli.console import Console, flag
from mjrun.errors import option


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
