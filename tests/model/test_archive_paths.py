"""Theorems about files: one inside an archive is read as the same file on disk."""

import os
import zipfile
from pathlib import Path

import pytest

from mjrun.model import archive_paths
from mjrun.model.archive_paths import file_content, file_size, main_mjcf, unpacked_size


def archive(path: Path, *names: str) -> Path:
    with zipfile.ZipFile(path, "w") as target:
        for name in names:
            target.writestr(name, name * 2)
    return path


@pytest.mark.parametrize("suffix", ["mjz", "zip"])
def test_a_file_in_an_archive_is_what_was_packed(tmp_path: Path, suffix: str) -> None:
    packed = archive(tmp_path / f"robot.{suffix}", "model.xml", "meshes/arm.obj")
    inner = f"{packed}/meshes/arm.obj"
    assert (file_size(inner), file_content(inner)) == (28, b"meshes/arm.objmeshes/arm.obj")
    assert (file_size(f"{packed}/no.obj"), file_content(f"{packed}/no.obj")) == (None, None)


def test_a_file_on_disk_is_itself_and_a_folder_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(b"v 1 2 3")
    assert (file_size(str(tmp_path / "a.obj")), file_content(str(tmp_path / "a.obj"))) == (7, b"v 1 2 3")
    assert (file_size(str(tmp_path)), file_content(str(tmp_path))) == (None, None)


def test_a_file_beyond_what_anybody_writes_by_hand_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.xml").write_bytes(b"12345678")
    monkeypatch.setattr(archive_paths, "MOST", 7)
    assert file_size(str(tmp_path / "a.xml")) == 8
    assert file_content(str(tmp_path / "a.xml")) is None


@pytest.mark.parametrize(
    ("names", "main"),
    [
        (("robot.xml", "model.xml"), "robot.xml"),
        (("model.xml", "part.xml"), "model.xml"),
        (("robot/robot.xml", "part.xml"), "robot/robot.xml"),
        (("anything.xml", "arm.obj"), "anything.xml"),
        (("one.xml", "two.xml"), None),
        ((), None),
    ],
)
def test_the_main_mjcf_of_an_archive_is_the_one_that_mujoco_reads(
    tmp_path: Path, names: tuple[str, ...], main: str | None
) -> None:
    path = archive(tmp_path / "robot.zip", *names)
    assert main_mjcf(path) == (f"{path}/{main}" if main else None)


def test_mjcf_is_its_own_main_file_and_nothing_else_has_one(tmp_path: Path) -> None:
    assert main_mjcf(Path("a.xml")) == "a.xml"
    assert main_mjcf(Path("a.mjb")) is None
    (tmp_path / "bad.zip").write_bytes(b"no archive")
    assert main_mjcf(tmp_path / "bad.zip") is None


def test_a_pipe_is_no_archive_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.zip")
    assert main_mjcf(tmp_path / "a.zip") is None


def test_the_size_of_an_archive_is_that_of_its_files(tmp_path: Path) -> None:
    assert unpacked_size(archive(tmp_path / "a.zip", "model.xml", "arm.obj")) == 2 * len("model.xml" + "arm.obj")
    (tmp_path / "b.zip").write_bytes(b"no archive")
    assert unpacked_size(tmp_path / "b.zip") == unpacked_size(tmp_path / "c.zip") == 0
