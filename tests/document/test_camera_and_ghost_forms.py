"""Cameras, ghosts and pushes may be written where they are used."""

from pathlib import Path
from typing import Any

import pytest

from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, Shot
from mjrun.document.camera_and_ghost_forms import CameraForm, InlineGhost, ghost_text
from mjrun.errors import DocumentError
from mjrun.options.kinds import ReadingContext
from mjrun.simulation.simulation import Simulation
from tests.document.run_documents import jobs, problems


def test_a_ghost_cannot_go_through_a_file_in_a_folder_with_a_comma() -> None:
    Path("a,b").mkdir()
    with pytest.raises(
        DocumentError, match=r"^a,b/d.yaml:1:48: videos\[0\].ghost: 'a,b/g.csv': the path of a ghost's file cannot"
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
def test_a_ghost_in_a_mapping_is_that_of_the_command_line(mapping: dict[str, Any], text: str) -> None:
    ghost = InlineGhost(**mapping)
    assert ghost_text(ghost.text(), lambda path: f"study/{path}") == text


def test_the_files_of_a_ghost_in_a_text_are_resolved_too() -> None:
    assert ghost_text("opacity=.3,trace=a.csv,key=a", str.upper) == "opacity=.3,trace=A.CSV,key=a"


def test_an_inline_camera_has_a_name_of_its_own() -> None:
    shots = [{"camera": "top"}]
    camera = CameraForm().read({"name": "fly", "shots": shots}, ReadingContext())
    assert camera == CameraScript("fly", [Shot(ModelRig("top"))])
    assert CameraForm().read({"shots": shots}, ReadingContext()) == CameraScript("script", [Shot(ModelRig("top"))])


@pytest.mark.parametrize(
    ("written", "texts"),
    [
        ("{body: torso, force: [0, 100, 0], at: 1.0, duration: 0.2}", ["body:torso=0/100/0@1+0.2"]),
        ("{site: 'a=b', force: [0, -.5, 0], at: 1/3, duration: 1e-3}", ["site:a=b=0/-0.5/0@1/3+0.001"]),
        ("torso=0/100/0@1+0.2", ["torso=0/100/0@1+0.2"]),
        ("[torso=1/2/3@0+1, {body: a, force: [1, 2, 3], at: 0, duration: 1}]", ["torso=1/2/3@0+1", "body:a=1/2/3@0+1"]),
    ],
)
def test_a_push_in_a_document_is_that_of_the_command_line(written: str, texts: list[str]) -> None:
    (trace,) = jobs(f"{{model: m.xml, push: {written}, traces: [a.csv]}}")
    assert trace.simulation == Simulation("m.xml", push=texts)


@pytest.mark.parametrize(
    ("written", "problem"),
    [
        ("torso=0/1@1+1", "1:22: push: expected a push with a force of three finite numbers, FX/FY/FZ [N], got"),
        ("[a=0/0/1@0+1, a=0/0/1@0+0]", "1:36: push[1]: expected a push of a duration above 0 [s], got 'a=0/0/1@0+0'"),
        ("{force: [1, 2, 3], at: 0, duration: 1}", "1:22: push: give either body or site"),
        ("{body: a, site: b, force: [1, 2, 3], at: 0, duration: 1}", "1:38: push.site: give either body or site"),
        ("{body: a, force: [1, 2, 3], at: 0, duration: 0}", "1:67: push.duration: expected a positive number, got 0"),
        ("{body: a, force: [1, 2], at: 0, duration: 1}", "1:39: push.force: expected 3 numbers, got 2"),
        ("7", "1:22: push: expected text as in torso=0/100/0@1+0.2 or {body or site, force, at, duration}, got 7"),
    ],
)
def test_a_push_that_cannot_be_is_refused_at_its_place(written: str, problem: str) -> None:
    (line,) = problems(f"{{model: m.xml, push: {written}, traces: [a.csv]}}")
    assert line.startswith(problem)
