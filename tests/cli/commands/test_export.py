"""`mjrun export` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import Command


def test_a_model_is_enough(mjrun_here: Command, swing: Path) -> None:
    done = mjrun_here("export", swing, "--duration", "0.1", "--hide", "static")
    assert (done.returncode, done.stderr) == (0, b"")
    assert mjrun_here.files() == ["swing.glb"]
    assert done.stdout.decode().startswith("swing.glb: glb, 3 frames, 0.1 s at 30 fps, ")


def test_a_file_in_a_pipe_is_the_same_and_alone_there(mjrun_here: Command, swing: Path) -> None:
    piped = mjrun_here("export", swing, "--steps", "1", "-o", "-", "--format", "glb")
    assert piped.returncode == 0
    assert int.from_bytes(piped.stdout[8:12], "little") == len(piped.stdout)


def test_the_document_of_a_command_makes_the_same(mjrun_here: Command, swing: Path) -> None:
    printed = mjrun_here("export", swing, "--steps", "10", "-o", "a.glb", "--print-document")
    (mjrun_here.folder / "run.yaml").write_bytes(printed.stdout)
    made = mjrun_here("run", "run.yaml", "--json")
    assert made.returncode == 0
    assert json.loads(made.stdout)["results"][0]["kind"] == "Export"
    assert "a.glb" in mjrun_here.files()
