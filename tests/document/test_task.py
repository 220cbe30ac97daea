"""A task document is the task that it says, exactly, or a list of what is wrong with it, line by line."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import mjrun
from mjrun.document import task as task_module
from mjrun.document.json_schema import json_schema
from mjrun.document.task import read_task
from mjrun.errors import DocumentError, FileError, ModelNotFoundError, UnknownNameError, UsageError, concerning
from mjrun.options.model import ModelOptions
from mjrun.options.option import Options, options_of
from mjrun.options.task import (
    ActionOptions,
    CommandTermOptions,
    ObservationOptions,
    ResetOptions,
    RewardTermOptions,
    TaskOptions,
    TerminationOptions,
)
from mjrun.task.task import Action, Command, Observation, Reset, Reward, Task, Termination
from tests.cases import cases
from tests.document.option_strategies import in_python, in_quotes, options_in_documents
from tests.document.schema_oracle import fits

EXAMPLE = (task_module.__doc__ or "").split("```yaml")[1].split("```")[0]
HEAD = "model: scene:car\ncontrol_dt: 0.02\nduration: 5\n"
OBSERVES = "observations: [{name: position, probe: xpos/car}]\n"
ACTS = "actions: [{actuators: [forward, turn]}]\n"
WHOLE = HEAD + OBSERVES + ACTS


def read(text: str, *assignments: str) -> Task:
    Path("t.yaml").write_text(text)
    return read_task("t.yaml", assignments)


def task(**values: Any) -> Task:
    standard: dict[str, Any] = {
        "control_dt": 0.02,
        "duration": 5,
        "observations": [Observation(name="position", probe="xpos/car")],
        "actions": [Action(actuators=["forward", "turn"])],
        "path": Path("t.yaml"),
    }
    return Task(values.pop("model", "scene:car"), **{**standard, **values})


def test_a_task_of_the_gallery_has_a_name() -> None:
    ours, file = read_task("scene:car_drive", ["duration=2"]), Path(__file__).parents[2] / "scenes" / "car_drive.yaml"
    assert (ours.text, ours.stem, ours.path, ours.duration) == ("scene:car_drive", "car_drive", file, 2)
    assert task_module.task_or_model("scene:car_drive") == read_task("scene:car_drive")
    assert task_module.task_or_model("scene:car") == "scene:car"
    assert ours.load().nq == read_task(file).load().nq
    with pytest.raises(DocumentError, match="a task requires a model"):
        read(WHOLE.replace("scene:car", "scene:car_drive"))


@pytest.mark.parametrize("name", ["scene:car_driv", "scene:car", "gym:Ant-v5"])
def test_a_name_that_is_no_task_of_the_gallery_lists_those_that_are(name: str) -> None:
    with pytest.raises(UnknownNameError, match=rf"no task '{name}'.*\ntasks: scene:car_drive, "):
        read_task(name)


# --- what is said -------------------------------------------------------------------------------------


# Each with what it requires, and what it is made of: the options in one of these texts.
TERMS: dict[str, tuple[type[Options], Callable[..., Any], dict[str, Any], tuple[str, ...]]] = {
    "observations": (
        ObservationOptions, Observation, {"name": "a"}, ("probe", "joints", "action", "command", "phase", "value")
    ),
    "actions": (ActionOptions, Action, {}, ("joints target", "actuators")),
    "commands": (CommandTermOptions, Command, {}, ("constant", "table", "schedule", "random")),
    "rewards": (RewardTermOptions, Reward, {"value": "time"}, ()),
    "terminations": (TerminationOptions, Termination, {"when": "time > 1", "as": "failure"}, ()),
    "reset": (ResetOptions, Reset, {}, ()),
}  # fmt: skip
OF_THE_MODEL = [each.name for each in options_of(ModelOptions)]


@pytest.mark.parametrize("key", TERMS)
@given(data=st.data(), shared=options_in_documents(TaskOptions, without=OF_THE_MODEL))
@settings(max_examples=50)
def test_a_task_is_that_of_python_or_refused_by_both(key: str, data: st.DataObject, shared: dict[str, Any]) -> None:
    declared, term, needed, sources = TERMS[key]
    chosen, *others = [each.split() for each in data.draw(st.permutations(sources))] or [[]]
    without = [name for other in others for name in other]
    options = {**needed, **data.draw(options_in_documents(declared, without=without, always=chosen))}

    def all_terms(one: Any) -> Any:
        return [one] if key in ("observations", "actions") else one if key == "reset" else {"a": one}

    text = in_quotes({**yaml.safe_load(WHOLE), **shared, key: all_terms(options)})
    try:
        expected = task(**in_python(TaskOptions, shared), **{key: all_terms(term(**in_python(declared, options)))})
    except UsageError:
        with pytest.raises(DocumentError):
            read(text)
        return
    assert read(text) == expected


def test_a_reward_may_be_its_value() -> None:
    rewards = {"alive": Reward(value="1"), "near": Reward(value="exp(-time)")}
    assert read(WHOLE + "rewards: {alive: 1, near: exp(-time)}") == task(rewards=rewards)


def test_what_a_document_overrides_in_its_model_is_overridden() -> None:
    made = read(WHOLE + "timestep: 0.004\nintegrator: implicitfast\nset: {joint/left.damping: 0.5}")
    model = made.load()
    assert (model.opt.timestep, model.opt.integrator, model.joint("left").damping[0]) == (0.004, 3, 0.5)


def test_files_are_relative_to_the_document(folder: Path) -> None:
    (folder / "sub").mkdir()
    text = WHOLE.replace("scene:car", "../car.xml") + "commands: {goal: {table: goals.csv}}"
    (folder / "sub/drive.yaml").write_text(text)
    made = read_task("sub/drive.yaml")
    assert made.commands["goal"].table == "sub/goals.csv"
    assert [str(file) for file in made.files] == ["sub/../car.xml", "sub/drive.yaml", "sub/goals.csv"]
    assert (made.text, made.stem) == ("sub/drive.yaml", "drive")


def test_assignments_and_variables_count() -> None:
    made = read(
        WHOLE + "vars: {push: 0.3}\nreset: {noise: {qvel/car/x: 'uniform(-${push}, ${push})'}}",
        "duration=2",
        "vars.push=0.7",
        "reset.vary.geom/floor.friction[0]=uniform(0.3, 1)",
        "observations[0].scale=2",
        "rewards.alive=1",
    )
    assert made == task(
        duration=2,
        observations=[Observation(name="position", probe="xpos/car", scale=2)],
        rewards={"alive": "1"},
        reset=Reset(
            noise={"qvel/car/x": "uniform(-0.7, 0.7)"}, vary={"geom/floor.friction[0]": "uniform(0.3, 1)"}
        ),
    )  # fmt: skip


def test_a_document_may_build_on_another() -> None:
    Path("base.yaml").write_text(WHOLE)
    made = read("defaults: base.yaml\nduration: 1\nrewards: {alive: 1}")
    assert made == task(duration=1, rewards={"alive": "1"})


def test_a_task_can_be_pickled_with_the_places_of_its_faults() -> None:
    copy = pickle.loads(pickle.dumps(read(WHOLE)))
    assert copy == task()
    with pytest.raises(DocumentError, match=r"t\.yaml:4:40: observations\[0\]\.probe: lost"), copy.located():
        raise UsageError("lost", ("observations", 0, "probe"))


def test_the_name_in_python_is_the_function() -> None:
    assert mjrun.read_task is read_task


# --- what is wrong ------------------------------------------------------------------------------------


@cases("text, expected")
def test_what_is_wrong_is_reported_where_it_is(text: str, expected: str) -> None:
    with pytest.raises(DocumentError) as caught:
        read(WHOLE + text)
    assert str(caught.value).startswith(f"t.yaml:{expected}")


@cases("text, expected")
def test_what_is_wrong_with_an_observation_is_reported_where_it_is(text: str, expected: str) -> None:
    with pytest.raises(DocumentError) as caught:
        read(HEAD + ACTS + text)
    assert str(caught.value).startswith(f"t.yaml:{expected}")


@cases("text, expected")
def test_what_is_wrong_with_an_action_is_reported_where_it_is(text: str, expected: str) -> None:
    with pytest.raises(DocumentError) as caught:
        read(HEAD + OBSERVES + text)
    assert str(caught.value).startswith(f"t.yaml:{expected}")


def test_all_mistakes_are_reported_at_once_in_their_order() -> None:
    text = """control_dt: 0
observations:
- {name: a}
- {name: b, probe: qpos, noise: wide}
actions:
- {joints: a}
set: {opt.x: }
"""
    with pytest.raises(DocumentError) as caught:
        read(text)
    assert str(caught.value).splitlines() == [
        "t.yaml:1:1: 'duration' is missing",
        "t.yaml:1:1: 'model' is missing",
        "t.yaml:1:13: control_dt: expected a positive number, got 0",
        "t.yaml:7:13: set.opt.x: expected a finite number, text, true or false, or a list of finite numbers, "
        "got nothing",
    ]
    with pytest.raises(DocumentError) as caught:
        read("model: scene:car\nduration: 1\n" + text.replace(": 0\n", ": 0.1\n").partition("set")[0])
    assert [line.partition(": ")[0] for line in str(caught.value).splitlines()] == [
        "t.yaml:5:3",
        "t.yaml:6:33",
        "t.yaml:8:3",
    ]


def test_what_only_the_model_brings_to_light_is_reported_at_its_line() -> None:
    made = read(WHOLE + "rewards: {near: exp(-1)}\nreset:\n  vary: {geom/flor.friction: 'uniform(0, 1)'}")
    places = [
        (("rewards", "near", "value"), "6:17: rewards.near: lost"),
        (("reset", "vary", "geom/flor.friction"), "8:10: reset.vary.geom/flor.friction: lost"),
        (("actions", 0, "actuators", 1), "5:33: actions[0].actuators[1]: lost"),
        (("control_dt",), "2:13: control_dt: lost"),
    ]
    for path, expected in places:
        with pytest.raises(DocumentError) as caught, made.located(), concerning(*path):
            raise UsageError("lost")
        assert str(caught.value) == f"t.yaml:{expected}"


def test_what_the_document_does_not_say_is_no_fault_of_it() -> None:
    with pytest.raises(UsageError, match=r"^lost$") as caught, read(WHOLE).located():
        raise UsageError("lost", ("policy",))
    assert not isinstance(caught.value, DocumentError)
    settings = "set: {opt.cone: elliptic}\n"
    with pytest.raises(UsageError, match=r"^lost$") as caught, read(WHOLE + settings).located():
        raise UsageError("lost", ("set", "geom/nix.mass"))
    assert not isinstance(caught.value, DocumentError)
    with pytest.raises(DocumentError, match=r"^t\.yaml:6:7: set\.opt\.cone: lost"), read(WHOLE + settings).located():
        raise UsageError("lost", ("set", "opt.cone"))


def test_a_missing_model_is_reported_at_its_line_once() -> None:
    made = read(WHOLE.replace("scene:car", "no.xml"))
    with (
        pytest.raises(ModelNotFoundError, match=r"^t\.yaml:1:8: model: no\.xml: no such model"),
        made.located(),
        made.located(),
    ):
        made.compile()


def test_a_document_that_is_not_there_is_reported() -> None:
    with pytest.raises(FileError, match=r"^nothing\.yaml: no such file"):
        read_task("nothing.yaml")


# --- the schema ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        EXAMPLE,
        WHOLE,
        WHOLE + "rewards: {a: 1, b: text, c: {value: x, weight: '${w}'}}\nvars: {w: 2}",
        WHOLE + "reset: {noise: {a: 0.1, b: 'normal(0, 1)', c: {normal: [0, 1]}}}",
        WHOLE + "commands: {a: {schedule: [[0, 1], [0.5, 2]]}, b: {random: ['uniform(0, 1)', 2]}}",
        HEAD + OBSERVES + "actions: [{joints: a, target: position, kp: 1, kd: [1, 2], offset: home, clip: [[0], 2]}]",
    ],
)
def test_task_documents_are_read_and_fit_the_schema(text: str) -> None:
    read(text)
    assert fits(yaml.safe_load(text), json_schema("task"), json_schema("task"))


@cases("text")
def test_what_is_no_task_document_does_not_fit_the_schema(text: str) -> None:
    with pytest.raises(DocumentError):
        read(text)
    assert not fits(yaml.safe_load(text), json_schema("task"), json_schema("task"))
