"""Theorems about checking one task."""

from pathlib import Path

import pytest

from mjrun.check.rule import Finding
from mjrun.errors import spelled
from tests.check.tasks import HEAD, SLIDER, checked


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


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


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("qvel/rail", "qvel/rial", 6, "observations[1].probe: no column 'qvel/rial' (did you mean 'qvel/rail'?)"),
        ("push", "pull", 8, "actions[0].actuators: no actuator 'pull'"),
        ("0.02", "0.025", 2, "control_dt: 0.025 s is 2.5 timesteps of 0.01 s; it must be a whole number of them"),
        ("[-1, 1]", "[[-1, 0], 1]", 8, "actions[0].clip: "),
        ("probe: qvel/rail", "joints: rial, of: qvel", 6, "observations[1].joints: no joint 'rial'"),
    ],
)
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
    assert "actions must be finite: push is nan" in finding.message
    (finding,) = checked(policy="none.onnx")
    assert finding.code == "MJ802"
    assert finding.message.startswith("none.onnx: no such file")


def test_no_steps_are_taken_where_none_are_wanted() -> None:
    assert checked("rewards: {bad: log(-1 - abs(qpos/rail))}", steps=0) == []
