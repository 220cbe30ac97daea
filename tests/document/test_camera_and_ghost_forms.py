"""Cameras, ghosts and pushes may be written where they are used."""

from pathlib import Path
from typing import Any

import pytest

from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, Shot
from mjrun.document.camera_and_ghost_forms import DocumentCameraKind, InlineGhost, ghost_text
from mjrun.errors import DocumentError
from mjrun.options.kinds import ReadingContext
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.document.run_documents import jobs, problems


def test_a_ghost_cannot_go_through_a_file_in_a_folder_with_a_comma() -> None:
    Path("a,b").mkdir()
    with pytest.raises(
        DocumentError, match=r"^a,b/d.yaml:1:48: videos\[0\].ghost: 'a,b/g.csv': the path of a ghost's file cannot"
    ):
        jobs("{model: m.xml, videos: [{output: a.mp4, ghost: {trace: g.csv}}]}", name="a,b/d.yaml")


@cases("mapping, text")
def test_a_ghost_in_a_mapping_is_that_of_the_command_line(mapping: dict[str, Any], text: str) -> None:
    ghost = InlineGhost(**mapping)
    assert ghost_text(ghost.text(), lambda path: f"study/{path}") == text


def test_the_files_of_a_ghost_in_a_text_are_resolved_too() -> None:
    assert ghost_text("opacity=.3,trace=a.csv,key=a", str.upper) == "opacity=.3,trace=A.CSV,key=a"


def test_an_inline_camera_has_a_name_of_its_own() -> None:
    shots = [{"camera": "top"}]
    camera = DocumentCameraKind().read({"name": "fly", "shots": shots}, ReadingContext())
    assert camera == CameraScript("fly", [Shot(ModelRig("top"))])
    assert DocumentCameraKind().read({"shots": shots}, ReadingContext()) == CameraScript(
        "script", [Shot(ModelRig("top"))]
    )


@cases("written, texts")
def test_a_push_in_a_document_is_that_of_the_command_line(written: str, texts: list[str]) -> None:
    (trace,) = jobs(f"{{model: m.xml, push: {written}, traces: [a.csv]}}")
    assert trace.simulation == Simulation("m.xml", push=texts)


@cases("written, problem")
def test_a_push_that_cannot_be_is_refused_at_its_place(written: str, problem: str) -> None:
    (line,) = problems(f"{{model: m.xml, push: {written}, traces: [a.csv]}}")
    assert line.startswith(problem)
