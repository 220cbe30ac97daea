"""Theorems about referenced files: the list is what MuJoCo opens beside the main file."""

import os
from pathlib import Path

import mujoco
import pytest

from mjrun.model.description.referenced_files import referenced_files


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


def relative(folder: Path, main: str) -> list[tuple[str, str]]:
    return [(file.kind, os.path.relpath(file.path, folder)) for file in referenced_files(str(folder / main))]


def test_includes_are_followed_and_each_must_be_there_for_mujoco(tmp_path: Path) -> None:
    files = {
        "main.xml": '<mujoco><include file="parts/a.xml"/></mujoco>',
        "parts/a.xml": '<mujocoinclude><include file="b.xml"/></mujocoinclude>',
        "parts/b.xml": '<mujocoinclude><worldbody><geom size="1"/></worldbody></mujocoinclude>',
    }
    write(tmp_path, files)
    assert relative(tmp_path, "main.xml") == [("include", "parts/a.xml"), ("include", "parts/b.xml")]
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "main.xml")).ngeom == 1
    for _, name in relative(tmp_path, "main.xml"):
        (tmp_path / name).rename(tmp_path / "away")
        with pytest.raises(ValueError, match=Path(name).name):
            mujoco.MjModel.from_xml_path(str(tmp_path / "main.xml"))
        (tmp_path / "away").rename(tmp_path / name)


def test_a_circle_of_includes_ends(tmp_path: Path) -> None:
    write(tmp_path, {"main.xml": '<mujoco><include file="main.xml"/></mujoco>'})
    assert relative(tmp_path, "main.xml") == [("include", "main.xml")]


def test_faces_of_a_cube_are_found_in_the_folder_that_the_compiler_element_sets(tmp_path: Path) -> None:
    texture = '<texture name="t" type="cube" fileright="a.png" fileleft="a.png"/>'
    text = f'<mujoco><compiler texturedir="tex"/><asset>{texture}</asset></mujoco>'
    write(tmp_path, {"main.xml": text, "tex/a.png": "", "b.png": ""})
    (texture,) = referenced_files(str(tmp_path / "main.xml"))
    assert (texture.kind, texture.name, texture.path) == ("texture", "t", str(tmp_path / "tex/a.png"))


def test_what_is_missing_or_not_xml_names_nothing(tmp_path: Path) -> None:
    write(tmp_path, {"main.xml": '<mujoco><include file="no.xml"/></mujoco>', "text.xml": "hello"})
    assert relative(tmp_path, "main.xml") == relative(tmp_path, "text.xml") == relative(tmp_path, "gone.xml") == []


@pytest.mark.parametrize("encoding", ["rot13", "zlib", "nobody", "x" * 5000])
def test_an_encoding_that_is_none_names_nothing(tmp_path: Path, encoding: str) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?><mujoco><include file="no.xml"/></mujoco>'
    write(tmp_path, {"main.xml": text})
    assert relative(tmp_path, "main.xml") == []
