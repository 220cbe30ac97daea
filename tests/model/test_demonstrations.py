"""Files of demonstrations are opened and listed, and old ones name the files of their models."""

import json
import os
from dataclasses import asdict
from pathlib import Path

import pytest

from mjrun.confinement.confinement import VARIABLE, Confinement
from mjrun.errors import FileError, ModelError
from mjrun.model.demonstrations import is_demonstration_file, list_demonstrations, model_text, open_demonstrations
from tests.demonstration_files import PLAIN, recorded_states, write_demonstrations


def test_a_file_is_listed_with_its_episodes_and_cameras(tmp_path: Path) -> None:
    listed = list_demonstrations(write_demonstrations(tmp_path / "d.hdf5"))
    assert [(each.name, each.states, each.duration) for each in listed.demonstrations] == [
        ("demo_1", 5, pytest.approx(0.2)),
        ("demo_2", 4, pytest.approx(0.15)),
    ]
    assert (listed.path, listed.cameras, listed.origin.task) == (str(tmp_path / "d.hdf5"), ["agentview"], "Lift")


def test_files_without_models_are_listed_too(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", model=None)
    assert list_demonstrations(path).cameras == []
    with (
        open_demonstrations(path) as file,
        pytest.raises(FileError, match=r"contains no model\nreplay .* mjrun video MODEL.xml replay .*d.hdf5:demo_1"),
    ):
        model_text(file, "demo_1")


def test_an_old_file_names_the_file_of_each_model(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5", model="model_1.xml")
    (tmp_path / "models").mkdir()
    (tmp_path / "models/model_1.xml").write_text(PLAIN)
    with open_demonstrations(path) as file:
        assert model_text(file, "demo_1") == PLAIN.encode()


@pytest.mark.parametrize("name", ["model_2.xml", "../secret.xml", "/etc/passwd", "a\0b"])
def test_only_files_in_the_folder_of_models_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.xml").write_text(PLAIN)
    (tmp_path / "models").mkdir()
    path = write_demonstrations(tmp_path / "d.hdf5", model=name.replace("\0", " "))
    with open_demonstrations(path) as file, pytest.raises(FileError, match=r"its model .* is missing in the folder"):
        model_text(file, "demo_1")


def test_files_that_are_missing_or_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.hdf5").mkdir()
    for name, reason in [("folder.hdf5", "is not a regular file"), ("missing.hdf5", "no such file")]:
        with pytest.raises(FileError, match=f"{name}: {reason}"):
            open_demonstrations(tmp_path / name)
        with pytest.raises(ModelError, match=f"{name}: {reason}"):
            list_demonstrations(tmp_path / name)
        assert not is_demonstration_file(tmp_path / name)
    assert is_demonstration_file(write_demonstrations(tmp_path / "d.hdf5", {"demo": recorded_states()}))


def test_a_confined_process_reads_only_files_inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    monkeypatch.setenv(VARIABLE, json.dumps(asdict(Confinement((os.path.realpath(tmp_path / "inside"),)))))
    with pytest.raises(FileError, match="is outside the folder that files are read from"):
        open_demonstrations(path)
