"""Opening of files that a command has made, with a program that writes down what it is asked to open."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

import pytest

from mjrun.cli.console import _files_in

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
