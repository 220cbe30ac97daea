"""Theorems about where parts of a task are written."""

from pathlib import Path

import mujoco
import pytest

from mjrun.check.rule import Place
from mjrun.check.task_episodes import TaskPlaces, place_of
from mjrun.document.task import read_task
from mjrun.errors import Problem
from mjrun.task.task import Action, Observation, Task
from mjrun.task.worlds import TaskWorlds
from tests.check.tasks import HEAD, SLIDER


def test_parts_are_found_at_their_lines() -> None:
    Path("slider.xml").write_text(SLIDER)
    Path("t.yaml").write_text(HEAD + "rewards:\n  near: 1\n  far: {value: time}\n")
    task = read_task("t.yaml")
    places = TaskPlaces(task, Path("t.yaml"))
    lines = {path: places.at(*path).line for path in [("model",), ("observations", 1), ("rewards", "far", "value")]}
    assert lines == {("model",): 1, ("observations", 1): 6, ("rewards", "far", "value"): 11}
    assert list(places.numbers_of_actions(TaskWorlds(task, 1))) == [[0]]


def test_a_task_without_a_document_is_at_the_file_as_a_whole() -> None:
    model = mujoco.MjModel.from_xml_string(SLIDER)
    seen, acts = [Observation(name="a", probe="qpos/rail")], [Action(actuators="push")]
    places = TaskPlaces(Task(model, control_dt=0.02, duration=1, observations=seen, actions=acts), Path("t.py"))
    assert places.at("observations", 0) == Place(Path("t.py"))


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("t.yaml:3:7", Place(Path("t.yaml"), 3)),
        ("a:b/t.yaml:3:7", Place(Path("a:b/t.yaml"), 3)),
        ("duration=2", Place(Path("own.yaml"))),
        ("a:b:c", Place(Path("own.yaml"))),
        ("", Place(Path("own.yaml"))),
    ],
)
def test_the_place_of_a_problem_is_its_file_and_line(place: str, expected: Place) -> None:
    assert place_of(Problem(place, "", "lost"), Path("own.yaml")) == expected
