"""Variations of evaluations, and checks before the first episode."""

import pickle
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from mjrun.document.task import read_task
from mjrun.errors import UnknownNameError, UsageError
from mjrun.evaluation.episode import EpisodeGroupSpec, PolicyChoice
from mjrun.evaluation.prepared import PreparedEvaluation, distinct_ends, points_of, policy_at, task_at
from mjrun.experiment.design import Design
from mjrun.model.override import Override
from mjrun.options.evaluation import EvaluationOptions
from mjrun.task.task import Task
from tests.evaluation.tasks import cart_task, write_policies

DOCUMENT = """
model: cart.xml
control_dt: 0.02
duration: 1
observations: [{name: x, joints: [slider]}]
actions: [{actuators: [push]}]
"""


def options(**arguments: object) -> EvaluationOptions:
    return EvaluationOptions(None, "out", **arguments)  # type: ignore[arg-type]


def test_nothing_varies_as_a_rule(tmp_path: Path) -> None:
    assert points_of(options(), cart_task(tmp_path)) == Design((), [()])


def test_points_are_those_of_a_study(tmp_path: Path) -> None:
    some = points_of(options(vary={"body/cart.mass": "1,2", "control_dt": "0.02,0.04"}), cart_task(tmp_path))
    assert some.names == ("body/cart.mass", "control_dt")
    assert [*some.points] == [("1", "0.02"), ("1", "0.04"), ("2", "0.02"), ("2", "0.04")]


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"vary": {"seed": "1,2"}}, "a separate seed"),
        ({"repeats": 2}, "to repeat each point"),
        ({"vary": {"body/cart.mass": "uniform(1,2)"}, "sampler": "saltelli"}, "samplers: sobol, halton, lhs, random"),
    ],
)
def test_variations_that_only_studies_have_are_refused(
    tmp_path: Path, arguments: dict[str, object], match: str
) -> None:
    with pytest.raises(UsageError, match=match):
        points_of(options(**arguments), cart_task(tmp_path))


def test_paths_of_the_model_are_overrides_and_times_are_the_tasks_own(tmp_path: Path) -> None:
    task = replace(cart_task(tmp_path), overrides=(Override("opt.gravity", "0,0,0"),))
    values = {"scale:geom/box.mass": "2", "timestep": "0.005", "control_dt": "0.04", "policy": "zero"}
    other = task_at(task, values, None)
    assert isinstance(other, Task)
    assert other.control_dt == Fraction(1, 25)
    assert other.overrides == (*task.overrides, Override("scale:geom/box.mass", "2"), Override("opt.timestep", "0.005"))
    assert other.load().opt.timestep == 0.005
    assert other.load().body_mass[1] == pytest.approx(2 * task.load().body_mass[1])


def test_whatever_a_document_says_can_vary(tmp_path: Path) -> None:
    cart_task(tmp_path)
    (tmp_path / "task.yaml").write_text(DOCUMENT)

    def rewritten(changes: dict[str, str]) -> Task:
        return read_task(tmp_path / "task.yaml", [f"{name}={text}" for name, text in changes.items()])

    overridden = replace(rewritten({}), overrides=(Override("opt.gravity", "0,0,-1"),))
    other = task_at(overridden, {"observations[0].delay": "3", "opt.timestep": "0.01"}, rewritten)  # type: ignore[arg-type]
    assert isinstance(other, Task)
    assert other.observations[0].delay == 3
    assert other.overrides == (Override("opt.gravity", "0,0,-1"), Override("opt.timestep", "0.01"))


def test_what_no_task_has_is_reported_with_what_can_vary(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="control_dt") as caught:
        task_at(cart_task(tmp_path), {"colour": "3"}, None)
    assert caught.value.path == ("vary", "colour")
    with pytest.raises(UsageError, match="control_dt"):
        task_at(cart_task(tmp_path), {"control_dt": "soon"}, None)


def test_the_name_of_a_field_alone_suggests_its_paths_and_keys_of_the_task_vary(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'geom/\*.friction'") as caught:
        task_at(cart_task(tmp_path), {"friction": "0.3"}, lambda changes: cart_task(tmp_path))
    assert caught.value.path == ("vary", "friction")
    assert task_at(cart_task(tmp_path), {"timestep": "0.01", "duration": "2"}, lambda changes: cart_task(tmp_path))


def test_a_policy_may_vary() -> None:
    chosen = PolicyChoice(None, trust=True)
    assert policy_at(chosen, {"policy": "a.onnx"}) == PolicyChoice("a.onnx", trust=True)
    assert policy_at(chosen, {"control_dt": "1"}) == chosen


def prepare(folder: Path, **arguments: object) -> PreparedEvaluation:
    task = cart_task(folder)
    return PreparedEvaluation(EvaluationOptions(task, "out", **arguments), task, None)  # type: ignore[arg-type]


def test_what_a_policy_imports_goes_with_it(tmp_path: Path) -> None:
    (tmp_path / "gains_of_a_policy.py").write_text("K = 1.0\n")
    policy = tmp_path / "policy_with_gains.py"
    policy.write_text("import gains_of_a_policy\n\ndef act(observation):\n    return [gains_of_a_policy.K]\n")
    modules = prepare(tmp_path, policy=f"{policy}:act").modules
    assert [Path(source.path).name for source in modules] == ["gains_of_a_policy.py", policy.name]


def test_a_policy_that_was_edited_after_its_import_is_reported(tmp_path: Path) -> None:
    policy = tmp_path / "policy_that_is_edited.py"
    policy.write_text("def act(observation):\n    return [1.0]\n")
    assert [*prepare(tmp_path, policy=f"{policy}:act").remarks(0)] == []
    policy.write_text("def act(observation):\n    return [2.0]\n")
    prepared = prepare(tmp_path, policy=f"{policy}:act")
    assert b"1.0" in prepared.modules[0].content
    (remark,) = prepared.remarks(0)
    assert remark == f"{policy} was edited after Python had imported it: restart Python to use the new version"


def test_disturbances_may_vary(tmp_path: Path) -> None:
    texts = ["cart=0/0/0@0.1+0.2", "cart=5/0/0@0.1+0.2"]
    result = prepare(tmp_path, policy="random", vary={"push": ",".join(texts)})
    disturbances = [group.spec.disturbances for group in result.groups]
    assert [tuple(map(str, each.push)) for each in disturbances] == [(text,) for text in texts]
    assert [group.spec.simulation(3).disturbances for group in result.groups] == disturbances
    assert [
        str(push) for push in prepare(tmp_path, policy="zero", push=texts).groups[0].spec.disturbances.push
    ] == texts
    with pytest.raises(UsageError, match=r"vary push: 'cart=1@0' is not BODY=FX/FY/FZ@T\+DURATION") as caught:
        prepare(tmp_path, policy="random", vary={"push": "cart=1@0,cart=0/0/0@0+1"})
    assert caught.value.path[:2] == ("vary", "push")


def test_the_correlation_of_noise_requires_noise_that_may_vary_or_be_that_of_the_task(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"^ctrl_noise_time requires ctrl_noise, ") as caught:
        prepare(tmp_path, policy="zero", ctrl_noise_time=0.5)
    assert caught.value.path == ("ctrl_noise_time",)
    noisy = replace(cart_task(tmp_path), ctrl_noise=0.1)
    PreparedEvaluation(options(policy="zero", ctrl_noise_time=0.5), noisy, None)

    varied = {"policy": "zero", "ctrl_noise_time": 0.5, "vary": {"ctrl_noise": "0,0.2", "opt.timestep": "0.01,0.005"}}
    groups = prepare(tmp_path, **varied, when={"ctrl_noise": "timestep < 0.01"}).groups
    disturbances = [(each.spec.disturbances.ctrl_noise, each.spec.disturbances.ctrl_noise_time) for each in groups]
    assert disturbances == [(None, None), (0.0, 0.5), (0.2, 0.5)]


@pytest.mark.parametrize("given", [{"where": "seed > 1"}, {"when": {"a": "b > 1"}}, {"correlate": {"a,b": "0.5"}}])
def test_conditions_on_parameters_are_refused_where_nothing_varies(tmp_path: Path, given: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=r"no (column|parameter)"):
        prepare(tmp_path, policy="zero", **given)


def test_groups_are_by_policies_and_then_by_points(tmp_path: Path) -> None:
    result = prepare(tmp_path, policy="random", compare="zero", vary={"opt.timestep": "0.005,0.01"}, timestep="0.002")
    assert [(group.policy, group.name, group.point) for group in result.groups] == [
        (0, "random", 0),
        (0, "random", 1),
        (1, "zero", 0),
        (1, "zero", 1),
    ]
    assert [group.spec.task.load().opt.timestep for group in result.groups] == [0.005, 0.01] * 2
    assert [group.spec.chosen.policy for group in result.groups] == ["random", "random", "zero", "zero"]
    assert result.points.values(1) == {"opt.timestep": "0.01"}


def test_units_of_metrics_are_those_beside_their_names_and_those_of_columns(tmp_path: Path) -> None:
    metrics = (("late [min]", "last(time)/60"), ("far", "max(qpos/slider)"), ("twice", "2*max(qpos/slider)"))
    some = prepare(tmp_path, policy="random", metric=metrics, fail_below={"late": 1})
    assert some.units == {"late": "min", "far": "m", "twice": ""}
    varied = prepare(tmp_path, policy="random", vary={"joint/slider.damping": "1,2", "timestep": "0.005,0.01"})
    assert varied.units == {"joint/slider.damping": "N·s/m", "timestep": "s"}
    assert some.metrics == [name for name, _ in some.groups[0].spec.metrics] == ["late", "far", "twice"]


def test_two_policies_of_one_name_are_reported_apart(tmp_path: Path) -> None:
    result = prepare(tmp_path, policy="random", compare="random")
    assert [group.name for group in result.groups] == ["random (1)", "random (2)"]


@pytest.mark.parametrize(
    ("arguments", "match", "path"),
    [
        ({}, "select a policy", ("policy",)),
        ({"policy": "no_such.onnx"}, "no_such.onnx", None),
        ({"policy": "zero", "compare_normalize": "none"}, "requires", ("compare_normalize",)),
        ({"policy": "zero", "vary": {"policy": "zero,random"}}, "both select the policy", ("policy",)),
        ({"compare": "zero", "vary": {"policy": "zero,random"}}, "both select the policy", ("compare",)),
        ({"policy": "zero", "metric": {"seed": "max(time)"}}, "cannot be the name of a metric", ("metric", "seed")),
        ({"policy": "zero", "metric": {"home": "max(time)"}}, "cannot be the name of a metric", ("metric", "home")),
        ({"policy": "zero", "metric": {"length_low": "max(time)"}}, "cannot be the name", ("metric", "length_low")),
        (
            {"policy": "zero", "metric": {"v": "max(time)", "v_high": "last(time)"}},
            "cannot be the name",
            ("metric", "v_high"),
        ),
        ({"policy": "zero", "metric": {"a b": "max(time)"}}, "cannot be the name of a metric", ("metric", "a b")),
        ({"policy": "zero", "metric": {"m": "max(qpos/knee)"}}, "qpos/knee", ("metric", "m")),
        ({"policy": "zero", "require": ["share(flown) < 1"]}, "flown", ("require", 0)),
    ],
)
def test_what_cannot_be_is_reported(
    tmp_path: Path, arguments: dict[str, object], match: str, path: tuple[object, ...] | None
) -> None:
    with pytest.raises(Exception, match=match) as caught:
        prepare(tmp_path, **arguments)
    if path is not None:
        assert isinstance(caught.value, UsageError)
        assert caught.value.path == path


def test_the_other_policy_is_checked_too(tmp_path: Path) -> None:
    policies = write_policies(tmp_path)
    with pytest.raises(UsageError, match="nobody"):
        prepare(tmp_path, policy="zero", compare=f"{policies}:nobody")


def test_a_missing_library_is_reported_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"mjrun\[eval\]"):
        prepare(tmp_path, policy="zero")


def test_a_specification_goes_to_another_process_as_it_is(tmp_path: Path) -> None:
    spec = EpisodeGroupSpec(cart_task(tmp_path), PolicyChoice("random", "none", True), (("m", "max(time)"),))
    assert pickle.loads(pickle.dumps(spec)) == spec


def test_a_policy_is_called_by_its_text_or_by_what_it_is() -> None:
    assert PolicyChoice("walk.onnx").name == "walk.onnx"
    assert PolicyChoice(len).name == "builtin_function_or_method"


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("runs/a/new.onnx", "runs/a/old.onnx", ("new.onnx", "old.onnx")),
        ("runs/a/p.onnx", "runs/b/p.onnx", ("a/p.onnx", "b/p.onnx")),
        ("runs/p.py:act", "runs/p.py:other", ("p.py:act", "p.py:other")),
        ("a/runs/p.onnx", "b/runs/p.onnx", ("a/runs/p.onnx", "b/runs/p.onnx")),
        ("p.onnx", "runs/p.onnx", ("p.onnx", "runs/p.onnx")),
        ("/p.onnx", "p.onnx", ("/p.onnx", "p.onnx")),
        ("runs/p.onnx", "random", ("p.onnx", "random")),
    ],
)
def test_two_policies_are_called_by_the_ends_of_their_paths_that_differ(
    first: str, second: str, expected: tuple[str, str]
) -> None:
    assert distinct_ends(first, second) == distinct_ends(second, first)[::-1] == expected
