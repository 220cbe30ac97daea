"""The instructions for coding agents: every command in them is executed."""

import shlex
from pathlib import Path

import pytest

from tests.conftest import Command
from tests.documentation import ROOT, commands

TEXT = (ROOT / "mjrun/SKILL.md").read_text("utf-8")
DRAFT = ["--quality", "draft"]
SMALL = {
    "video": ["--size", "64x48", "--duration", "0.2", "--fps", "10", *DRAFT],
    "image": ["--size", "64x48", *DRAFT],
    "sweep": ["--jobs", "1"],
    "dataset": ["--size", "32x24", "--jobs", "1", *DRAFT],
}
EXIT_CODES = {"diff": 1}  # the results that it compares differ


def test_the_command_prints_the_file(mjrun_here: Command) -> None:
    assert mjrun_here("skill").stdout.decode() == TEXT
    assert len(TEXT.splitlines()) <= 60


@pytest.mark.gl
@pytest.mark.slow
def test_every_command_works(mjrun_here: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    lines = [shlex.split(line, comments=True) for line in commands(TEXT)]
    assert len(lines) >= 12
    for _, name, *arguments in lines:
        done = mjrun_here(name, *arguments, *SMALL.get(name, []))
        assert done.returncode == EXIT_CODES.get(name, 0), (name, arguments, done.stderr)

    outputs = {
        "car.png",
        "views.png",
        "car.mp4",
        "run.csv",
        "path.png",
        "before.csv",
        "after.csv",
        "study",
        "work",
        "images",
    }
    assert {path.name for path in tmp_path.iterdir()} == outputs
