"""Evaluation documents: what they say is what a command line says, and what is wrong is told at its line."""

import re
from pathlib import Path

import numpy as np
import pytest

from mjrun.document.evaluation import evaluated_task, evaluation_text, read_evaluation
from mjrun.errors import DocumentError, MjrunError, UsageError
from mjrun.evaluation.evaluation import Evaluation
from tests.cases import cases
from tests.evaluation.tasks import XML, cart_task

TEXT = """\
task: tasks/cart.yaml
changes: {duration: 0.1, "observations[0].scale": 2}
policy: zero
episodes: 3
vary: {control_dt: [0.02, 0.04]}
fail_below: {return: -100}
"""
CART = """\
model: cart.xml
control_dt: 0.02
duration: 1.5
observations: [{name: state, probe: [qpos, qvel]}]
actions: [{actuators: [push]}]
rewards: {near: -abs(qpos/slider)}
"""


@pytest.fixture
def document(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An evaluation beside the folder of its task."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks/cart.xml").write_text(XML)
    (tmp_path / "tasks/cart.yaml").write_text(CART)
    path = tmp_path / "robust.yaml"
    path.write_text(TEXT)
    return path


def test_a_document_is_the_evaluation_that_its_options_make(document: Path) -> None:
    found = read_evaluation(document, ["episodes=2"], values={"policy": "random", "jobs": 1}).made.run()
    task, rewritten = evaluated_task("tasks/cart.yaml", ["duration=0.1", "observations[0].scale=2"])
    options = {"vary": {"control_dt": "0.02,0.04"}, "fail_below": {"return": -100}}
    expected = Evaluation(task, "other", policy="random", episodes=2, jobs=1, rewritten=rewritten, **options).run()
    assert Path("robust_eval/episodes.csv").read_bytes() == Path("other/episodes.csv").read_bytes()
    assert found.policies == expected.policies
    assert found.policies[0].lengths.max == pytest.approx(0.12)  # three periods of 0.04 s


def test_options_that_lose_their_partner_to_the_command_line_are_left_out(document: Path) -> None:
    document.write_text(f"{TEXT}videos: 3\nfps: 60\n")
    for assignments, values, fps in [([], {}, 60), (["videos=0"], {}, 30), ([], {"videos": 0}, 30)]:
        assert read_evaluation(document, assignments, values=values).made.fps == fps
    with pytest.raises(DocumentError, match=r"^fps=20: fps requires videos N, "):
        read_evaluation(document, ["videos=0", "fps=20"])
    with pytest.raises(UsageError, match=r"^fps requires videos N, "):  # at no line of the document
        read_evaluation(document, values={"videos": 0, "fps": 20})

    Path("base.yaml").write_text(document.read_text())
    document.write_text("defaults: base.yaml\nvideos: 0\n")
    assert read_evaluation(document).made.fps == 30


def test_options_without_effect_are_refused_at_their_line_unless_the_command_line_gives_their_partner(
    document: Path,
) -> None:
    document.write_text(f"{TEXT}fps: 60\n")
    with pytest.raises(DocumentError, match=r"robust.yaml:7:6: fps: fps requires videos N, "):
        read_evaluation(document)
    assert read_evaluation(document, values={"videos": 1}).made.fps == 60
    assert read_evaluation(document, ["videos=1"]).made.fps == 60


def test_what_is_written_is_read_again(document: Path) -> None:
    request = read_evaluation(document, ["output=results", "metrics.far=max(abs(qpos/slider))"])
    text = evaluation_text(request.made, request.changes, "mjrun eval")
    Path("again.yaml").write_text(text)
    again = read_evaluation("again.yaml")
    assert evaluation_text(again.made, again.changes, "mjrun eval") == text
    assert again.changes == request.changes == ["duration=0.1", "observations[0].scale=2"]
    assert "metrics: {far: max(abs(qpos/slider))}" in text
    assert "output: results" in text


@cases("line, message")
def test_what_is_wrong_is_reported(document: Path, line: str, message: str) -> None:
    key = line.split(":")[0]
    lines = [line if each.startswith(f"{key}:") else each for each in TEXT.splitlines()]
    document.write_text("\n".join(lines))
    with pytest.raises(MjrunError, match=re.escape(message)):
        read_evaluation(document)


def test_a_threshold_of_what_there_is_not_is_reported_at_its_line(document: Path) -> None:
    document.write_text(TEXT.replace("return", "wins"))
    request = read_evaluation(document)
    with pytest.raises(DocumentError, match=r"6:20: fail_below\.wins"), request.located():
        request.made.run()


def test_a_parameter_that_the_model_lacks_is_reported_at_its_line_although_the_task_has_settings(
    document: Path,
) -> None:
    (document.parent / "tasks/cart.yaml").write_text(CART + "set: {opt.cone: elliptic}\n")
    document.write_text(TEXT.replace("{control_dt: [0.02, 0.04]}", "{geom/nix.mass: [1, 2]}"))
    request = read_evaluation(document)
    with (
        pytest.raises(DocumentError, match=r"robust\.yaml:5:8: vary\.geom/nix\.mass: no geom 'nix'"),
        request.located(),
    ):
        request.made.run()


def test_only_documents_have_values_that_change(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="gym:Ant-v5 is not a document"):
        evaluated_task("gym:Ant-v5", ["duration=1"])


def test_only_what_is_not_the_default_is_written(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    text = evaluation_text(
        Evaluation(task, "out", policy="zero", episodes=7), ["duration=1", "duration=2"], "mjrun eval"
    )
    path = task.text
    assert text == f"# mjrun eval\ntask: {path}\nchanges: {{duration: 2}}\noutput: out\nepisodes: 7\npolicy: zero\n"


def test_code_is_no_part_of_a_document(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    for policy in ("act.py:act", np.zeros_like):
        with pytest.raises(UsageError, match="a document cannot contain code"):
            evaluation_text(Evaluation(task, "out", policy=policy))
