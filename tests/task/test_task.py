"""A task is a source of its model, a value that survives pickling, and checked in itself."""

import pickle
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import pytest

from mjrun.errors import UsageError, spelled
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.task.task import Action, Command, Observation, Reset, Reward, Task, Termination

POSITION = Observation(name="position", probe="qpos")
DRIVE = Action(actuators="*")


def task(**values: object) -> Task:
    given = {"control_dt": 0.02, "duration": 1, "observations": [POSITION], "actions": [DRIVE], **values}
    return Task("scene:pendulum", **given)  # type: ignore[arg-type]


def test_a_task_is_a_source_of_its_model_with_the_overrides_of_both() -> None:
    model = parse_source("scene:pendulum", [Override("opt.gravity", "0 0 -1")])
    made = replace(task(), model=model, overrides=(Override("opt.timestep", "0.004"),))
    loaded = made.load()
    assert (loaded.opt.gravity[2], loaded.opt.timestep) == (-1, 0.004)
    assert made.files[0] == model.files[0]
    assert (made.text, made.stem) == ("scene:pendulum", "pendulum")
    assert replace(made, path=Path("swing.yaml")).stem == "swing"


def test_a_task_is_a_value() -> None:
    made = task(rewards={"up": "1"}, reset=Reset(qpos={"hinge": 1}, noise={"qpos/*": "uniform(-1, 1)"}))
    again = pickle.loads(pickle.dumps(made))
    assert again == made
    assert hash(again) == hash(made)
    assert made.rewards == {"up": Reward(value="1")}
    assert made.control_dt == Fraction(1, 50)


def test_periods_are_whole() -> None:
    assert task().periods == 50
    assert task(duration=1.01).periods == 51
    model = mujoco.MjModel.from_xml_string('<mujoco><option timestep="0.005"/></mujoco>')
    assert task().control_steps(model) == 4
    with pytest.raises(UsageError, match="must be a whole number"):
        task(control_dt=0.012).control_steps(model)


@pytest.mark.parametrize(
    ("values", "message", "path"),
    [
        ({"control_dt": 0}, "control_dt", ("control_dt",)),
        ({"derived": "old"}, "one of current, lagged", ("derived",)),
        ({"observations": []}, "at least one observation", ("observations",)),
        ({"observations": [POSITION, POSITION]}, "two observations", ("observations", 1, "name")),
        (
            {"observations": [Observation(name="x", command="gaol")], "commands": {"goal": Command(constant=1)}},
            "no command 'gaol' (did you mean 'goal'?)",
            ("observations", 0, "command"),
        ),
        (
            {"terminations": {"timeout": Termination(when="1 > 0", as_="failure")}},
            "a built-in termination",
            ("terminations", "timeout"),
        ),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, object], message: str, path: tuple[str | int, ...]) -> None:
    with pytest.raises(UsageError) as caught:
        task(**values)
    assert message in spelled(str(caught.value), str)
    assert caught.value.path == path


def test_an_episode_without_end_is_refused() -> None:
    with pytest.raises(UsageError, match="exceed the limit of 10,000,000 control periods"):
        task(duration=1e24)
