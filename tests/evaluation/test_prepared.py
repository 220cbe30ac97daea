"""What is checked before the first episode."""

from pathlib import Path

import pytest

from mjrun.errors import UsageError
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.options.evaluation import EvaluationOptions
from tests.evaluation.tasks import cart_task, write_policies


def prepare(folder: Path, **given: object) -> PreparedEvaluation:
    task = cart_task(folder)
    return PreparedEvaluation(EvaluationOptions(task, "out", **given), task, None)  # type: ignore[arg-type]


def test_groups_are_by_policies_and_then_by_points(tmp_path: Path) -> None:
    found = prepare(tmp_path, policy="random", compare="zero", vary={"opt.timestep": "0.005,0.01"}, timestep="0.002")
    assert [(group.policy, group.name, group.point) for group in found.groups] == [
        (0, "random", 0),
        (0, "random", 1),
        (1, "zero", 0),
        (1, "zero", 1),
    ]
    assert [group.spec.task.load().opt.timestep for group in found.groups] == [0.005, 0.01] * 2
    assert [group.spec.chosen.policy for group in found.groups] == ["random", "random", "zero", "zero"]
    assert found.values(1) == {"opt.timestep": "0.01"}


def test_two_policies_of_one_name_are_told_apart(tmp_path: Path) -> None:
    found = prepare(tmp_path, policy="random", compare="random")
    assert [group.name for group in found.groups] == ["random (1)", "random (2)"]


@pytest.mark.parametrize(
    ("given", "match", "path"),
    [
        ({}, "who plays", ("policy",)),
        ({"policy": "no_such.onnx"}, "no_such.onnx", None),
        ({"policy": "zero", "compare_normalize": "none"}, "goes with", ("compare_normalize",)),
        ({"policy": "zero", "vary": {"policy": "zero,random"}}, "both say who plays", ("policy",)),
        ({"compare": "zero", "vary": {"policy": "zero,random"}}, "both say who plays", ("compare",)),
        ({"policy": "zero", "metric": {"seed": "max(time)"}}, "cannot be the name of a metric", ("metric", "seed")),
        ({"policy": "zero", "metric": {"home": "max(time)"}}, "cannot be the name of a metric", ("metric", "home")),
        ({"policy": "zero", "metric": {"a b": "max(time)"}}, "cannot be the name of a metric", ("metric", "a b")),
        ({"policy": "zero", "metric": {"m": "max(qpos/knee)"}}, "qpos/knee", ("metric", "m")),
        ({"policy": "zero", "require": ["share(flown) < 1"]}, "flown", ("require", 0)),
    ],
)
def test_what_cannot_be_is_told(
    tmp_path: Path, given: dict[str, object], match: str, path: tuple[object, ...] | None
) -> None:
    with pytest.raises(Exception, match=match) as found:
        prepare(tmp_path, **given)
    if path is not None:
        assert isinstance(found.value, UsageError)
        assert found.value.path == path


def test_the_other_policy_is_checked_too(tmp_path: Path) -> None:
    policies = write_policies(tmp_path)
    with pytest.raises(UsageError, match="nobody"):
        prepare(tmp_path, policy="zero", compare=f"{policies}:nobody")


def test_a_missing_library_is_told_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"mjrun\[eval\]"):
        prepare(tmp_path, policy="zero")
