"""Cameras and ghosts may be written where they are used."""

from pathlib import Path

import pytest

from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, Shot
from mjrun.document.inline_values import InlineCamera, InlineGhost, ghost_text
from mjrun.errors import DocumentError
from tests.document.run_documents import jobs


def test_a_ghost_cannot_go_through_a_file_in_a_folder_with_a_comma() -> None:
    Path("a,b").mkdir()
    with pytest.raises(
        DocumentError, match=r"^a,b/d.yaml:1:48: videos\[0\].ghost: 'a,b/g.csv': the path of what a ghost goes"
    ):
        jobs("{model: m.xml, videos: [{output: a.mp4, ghost: {trace: g.csv}}]}", name="a,b/d.yaml")


@pytest.mark.parametrize(
    ("mapping", "text"),
    [
        ({}, ""),
        ({"offset": [0, 0.5, -1]}, "offset=0/0.5/-1"),
        ({"opacity": 0.25, "key": 0}, "opacity=0.25,key=0"),
        ({"offset": [0, 0, 0], "trace": "a.csv"}, "trace=study/a.csv"),
        ({"recording": "a.npz", "opacity": 1}, "opacity=1.0,recording=study/a.npz"),
    ],
)
def test_a_ghost_in_a_mapping_is_that_of_the_command_line(mapping: dict[str, object], text: str) -> None:
    ghost = InlineGhost.model_validate(mapping)
    assert ghost_text(ghost, lambda path: f"study/{path}") == text


def test_the_files_of_a_ghost_in_a_text_are_resolved_too() -> None:
    assert ghost_text("opacity=.3,trace=a.csv,key=a", str.upper) == "opacity=.3,trace=A.CSV,key=a"


def test_an_inline_camera_has_a_name_of_its_own() -> None:
    camera = InlineCamera.model_validate({"name": "fly", "shots": [{"camera": "top"}]})
    assert camera.script(camera.name) == CameraScript("fly", [Shot(ModelRig("top"))])
    assert InlineCamera.model_validate({"shots": [{"camera": "top"}]}).name == "script"
