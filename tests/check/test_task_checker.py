"""Theorems about checking one task: where its parts are written, and what is seen in its episodes."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.check.finding import Finding, Place
from mjrun.check.task_checker import COUNT, NonFiniteOccurrence, TaskPlaces, place_of, watch
from mjrun.document.task import read_task
from mjrun.errors import DocumentProblem, spelled
from mjrun.policy.load import load_policy
from mjrun.task.task import Action, Observation, Task
from mjrun.task.worlds import TaskWorlds
from tests.cases import cases
from tests.check.tasks import HEAD, SLIDER, checked


def places(findings: list[Finding]) -> list[tuple[str, int | None]]:
    return [(finding.code, finding.line) for finding in findings]


def test_a_task_that_is_well_is_found_well() -> None:
    text = "rewards: {near: exp(-qpos/rail^2)}\nterminations: {far: {when: abs(qpos/rail) > 9, as: failure}}"
    assert checked(text) == []


def test_all_mistakes_in_the_document_are_found_at_their_lines() -> None:
    found = checked("reward: {}\nderived: late")
    assert places(found) == [("MJ801", 9), ("MJ801", 10)]
    assert found[0].message.startswith("unknown key 'reward' (did you mean 'rewards'?)")
    assert found[1].message == "derived: expected 'current' or 'lagged', got 'late' (did you mean 'lagged'?)"
    assert {finding.file for finding in found} == {"t.yaml"}


@cases("old, new, line, message")
def test_what_does_not_fit_the_model_is_found_at_its_line(old: str, new: str, line: int, message: str) -> None:
    (finding,) = checked(head=HEAD.replace(old, new))
    assert (finding.code, finding.line) == ("MJ801", line)
    assert finding.message.startswith(message)


@pytest.mark.parametrize(
    "name",
    ["reward/near", "return", "obs/place"],
)
def test_terms_that_would_be_made_of_themselves_are_found(name: str) -> None:
    (finding,) = checked(f"rewards: {{near: {name} + 1}}")
    assert (finding.code, finding.line) == ("MJ801", 9)
    assert finding.message.startswith(f"rewards.near: '{name}' is derived from the task, which therefore cannot use it")


def test_a_task_that_is_its_own_model_is_found() -> None:
    (finding,) = checked(head=HEAD.replace("slider.xml", "t.yaml"))
    assert (finding.code, finding.line) == ("MJ801", 1)
    assert finding.message == "model: 't.yaml' is a document; a task requires a model"


def test_a_model_that_does_not_load_is_found_in_its_own_file() -> None:
    Path("bad.xml").write_text(SLIDER.replace("slide", "slid", 2))
    (finding,) = checked(head=HEAD.replace("slider.xml", "bad.xml"))
    assert (finding.code, finding.file, finding.line) == ("MJ110", "bad.xml", 1)
    (missing,) = checked(head=HEAD.replace("slider.xml", "none.xml"))
    assert (missing.code, missing.file) == ("MJ001", "none.xml")


def test_a_policy_of_another_size_is_found_with_both_sides() -> None:
    Path("p.py").write_text("import numpy as np\ndef three(obs):\n    return np.zeros(3)\n")
    (finding,) = checked(policy="p.py:three")
    assert (finding.code, finding.severity) == ("MJ802", "error")
    assert spelled(finding.message) == "policy p.py:three returned 3 numbers, and the task takes 1 action: push"


def test_what_random_actions_and_a_policy_bring_to_light_is_told_once() -> None:
    (finding,) = checked("terminations: {now: {when: time >= 0, as: failure}}", policy="zero")
    assert (finding.code, finding.line) == ("MJ804", 9)


def test_a_policy_that_answers_nan_or_is_not_there_is_found() -> None:
    Path("p.py").write_text("import numpy as np\ndef nan(obs):\n    return np.full(1, np.nan)\n")
    (finding,) = checked(policy="p.py:nan")
    assert (finding.code, finding.severity) == ("MJ802", "error")
    assert finding.message == "policy p.py:nan returned non-finite actions at step 0, time 0 s: push = nan"
    (finding,) = checked(policy="none.onnx")
    assert finding.code == "MJ802"
    assert finding.message.startswith("none.onnx: no such file")


def test_no_steps_are_taken_where_none_are_wanted() -> None:
    assert checked("rewards: {bad: log(-1 - abs(qpos/rail))}", steps=0) == []


def worlds(text: str = "", head: str = HEAD) -> TaskWorlds:
    Path("slider.xml").write_text(SLIDER)
    Path("t.yaml").write_text(head + text)
    return TaskWorlds(read_task("t.yaml"), COUNT, threads=1)


def test_episodes_are_played_to_their_ends() -> None:
    assert watch(worlds(), load_policy("random")).periods == COUNT * 50
    ended = watch(worlds("terminations: {late: {when: time > 0.19, as: success}}"), load_policy("random"))
    assert ended.periods == COUNT * 10


def test_what_stays_the_same_depends_on_what_acts() -> None:
    text = HEAD.replace("duration: 1", "duration: 1\nset: {opt.gravity: [0, 0, 0]}")
    assert watch(worlds(head=text), load_policy("random")).constant == []
    still = watch(worlds(head=text), load_policy("zero"))
    assert still.constant == [("place", "place"), ("speed", "speed")]
    assert still.acting == "zero"


def test_the_first_value_that_is_not_finite_is_kept_with_its_instant() -> None:
    """The logarithm fails where the position, which a bare simulation gives as well, is no longer positive."""
    made = worlds("rewards: {bad: log(qpos/rail + 0.01), good: 1}")
    made.reset(range(COUNT))
    period = 0
    while (made.step(np.zeros((COUNT, 1))).observations[:, 0] > -0.01).all():
        period += 1
    (fault,) = watch(made, load_policy("zero")).not_finite
    assert (fault.kind, fault.name, fault.time, fault.seed) == ("rewards", "bad", (period + 1) * 0.02, 0)
    assert np.isnan(fault.value)
    assert isinstance(fault, NonFiniteOccurrence)


def test_terminations_at_the_start_are_by_their_names_and_seeds() -> None:
    text = "reset: {set: {qpos/rail: 'uniform(-1, 1)'}}\nterminations: {far: {when: qpos/rail > 0, as: failure}}"
    made = worlds(text)
    positive = np.flatnonzero(made.reset(range(COUNT))[:, 0] > 0).tolist()
    assert watch(made, load_policy("zero")).ended_at_start == {"far": positive}


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
    assert place_of(DocumentProblem(place, "", "lost"), Path("own.yaml")) == expected
