"""`mjrun examples`: a copy of the models and documents that the documentation uses."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from mjrun.cli.commands import examples
from mjrun.cli.main import run
from mjrun.platform.installation import scene_folder

pytestmark = pytest.mark.usefixtures("own_signals")


def test_a_copy_has_the_same_files_and_its_documents_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["examples", "new/scenes"]) == 0
    copy = tmp_path / "new/scenes"
    for path in copy.rglob("*"):
        if path.is_file():
            assert path.read_bytes() == (scene_folder() / path.relative_to(copy)).read_bytes()
    assert {*copy.glob("*.xml")} == {copy / path.name for path in scene_folder().glob("*.xml")}
    assert not any(path.match(pattern) for path in copy.rglob("*") for pattern in examples.LEFT_OUT)
    assert [path.name for path in copy.parent.iterdir()] == ["scenes"]
    assert run(["run", "new/scenes/pendulum.yaml", "--dry-run"]) == 0


def test_an_existing_folder_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["examples", str(tmp_path)]) == 7
    assert "exists already; name a new folder" in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


def test_a_full_disk_is_reported_once_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(shutil, "copy2", fail)
    assert run(["examples", str(tmp_path / "scenes")]) == 7
    message = f"mjrun: error: {tmp_path}/scenes: cannot be written: {os.strerror(errno.ENOSPC)}\n"
    assert capsys.readouterr().err == message
    assert not [*tmp_path.iterdir()]


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert run(["examples", str(tmp_path / "file/scenes")]) == 7
    assert "file/scenes: " in capsys.readouterr().err
