"""Theorems about checking tasks beside models, each in a process of its own."""

import os
from pathlib import Path

import pytest

import mjrun
from mjrun.check.check import ModelCheck
from mjrun.document.model_and_task_check import Check
from mjrun.errors import UsageError
from tests.check.tasks import HEAD, SLIDER
from tests.processes import PATIENCE


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("slider.xml").write_text(SLIDER)


@pytest.mark.slow
def test_models_and_tasks_are_checked_in_their_order_with_one_exit_code() -> None:
    Path("good.yaml").write_text(HEAD)
    Path("bad.yaml").write_text(HEAD + "terminations:\n  low: {when: qpos/rail < 1, as: failure}")
    Path("wrong.yaml").write_text(HEAD + "rewards: []")
    result = Check(["good.yaml", "slider.xml", "bad.yaml", "wrong.yaml"], steps=20).run()
    assert [model.model for model in result.models] == ["good.yaml", "slider.xml", "bad.yaml", "wrong.yaml"]
    assert [[finding.code for finding in model.findings] for model in result.models] == [[], [], ["MJ804"], ["MJ801"]]
    assert (result.code, [model.loads for model in result.models]) == (1, [True] * 4)
    assert Check(["bad.yaml"], ignore=["MJ8"]).run().code == 0


def test_a_task_whose_model_is_not_there_does_not_load() -> None:
    Path("t.yaml").write_text(HEAD.replace("slider", "none"))
    result = Check(["t.yaml"]).run()
    assert ([finding.code for finding in result.models[0].findings], result.code) == (["MJ001"], 3)


def test_a_task_that_is_no_file_does_not_load_and_nobody_waits_for_it() -> None:
    os.mkfifo("pipe.yaml")
    result = Check(["pipe.yaml", "none.yaml"], timeout=PATIENCE).run()
    told = [[(finding.code, finding.message) for finding in model.findings] for model in result.models]
    assert told == [[("MJ801", "is not a regular file")], [("MJ801", "no such file")]]
    assert (result.code, [model.loads for model in result.models]) == (3, [False, False])


def test_a_policy_is_checked_with_the_task() -> None:
    Path("t.yaml").write_text(HEAD)
    Path("p.py").write_text("import numpy as np\ndef two(obs):\n    return np.zeros(2)\n")
    (model,) = Check(["t.yaml"], policy="p.py:two").run().models
    assert [finding.code for finding in model.findings] == ["MJ802"]


def test_a_policy_that_is_no_text_is_refused() -> None:
    with pytest.raises(UsageError, match="give the policy as text"):
        Check(["t.yaml"], policy=lambda obs: obs)


def test_the_name_in_python_is_the_class_that_knows_tasks() -> None:
    assert mjrun.Check is Check
    assert issubclass(Check, ModelCheck)
