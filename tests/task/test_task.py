"""A task is a source of its model, a value that survives pickling, and checked in itself, with its terms."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError, spelled
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.task.episode import Ending
from mjrun.task.random_streams import COMMANDS, CommandSignals, stream
from mjrun.task.task import TIMED_OUT, UNSTABLE, Action, Command, Observation, Reset, Reward, Task, Termination

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


@pytest.mark.parametrize("timestep", [0.001, 0.1, 1 / 240])
def test_a_product_of_floats_is_the_whole_number_of_periods_that_it_means(timestep: float) -> None:
    model = mujoco.MjModel.from_xml_string(f'<mujoco><option timestep="{timestep!r}"/></mujoco>')
    for count in range(1, 100):
        made = task(control_dt=count * timestep, duration=count * 7 * timestep)
        assert made.control_steps(model) == count
        assert made.periods == 7


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


DT = Fraction(1, 10)


def signals(count: int = 1, **commands: Command) -> CommandSignals:
    return CommandSignals(commands, DT, 10, count)


def values(made: CommandSignals) -> np.ndarray:
    """At all instants of the first world."""
    instants = np.arange(11)
    return made.at(np.zeros(11, int), instants)


def test_constants_and_schedules_hold() -> None:
    made = signals(goal=Command(constant=[-1, 4]), speed=Command(schedule=[[0, 1], [0.3, 2], [0.75, 3]]))
    assert made.names == ["goal/0", "goal/1", "speed"]
    assert made.slices == {"goal": slice(0, 2), "speed": slice(2, 3)}
    assert values(made)[:, :2].tolist() == [[-1, 4]] * 11
    assert values(made)[:, 2].tolist() == [1] * 3 + [2] * 5 + [3] * 3


@pytest.mark.parametrize("interpolation", ["hold", "linear"])
def test_tables_are_as_numpy_interpolates_them(tmp_path: Path, interpolation: str) -> None:
    file = tmp_path / "goals.csv"
    file.write_text("time,x,y\n0,1,5\n0.25,2,6\n0.5,4,7\n")
    made = values(signals(goal=Command(table=file, interpolation=interpolation)))
    times = np.arange(11) / 10
    if interpolation == "linear":
        np.testing.assert_allclose(made[:, 0], np.interp(times, [0, 0.25, 0.5], [1, 2, 4]))
    else:
        assert made[:, 1].tolist() == [5] * 3 + [6] * 2 + [7] * 6


def test_random_commands_are_of_the_seed_and_drawn_anew_when_they_should() -> None:
    made = signals(3, goal=Command(random="uniform(-1, 1)", size=2, every=0.3), side=Command(random="choice(-1, 1)"))
    for world, seed in enumerate((4, 5, 6)):
        made.begin(world, seed)
    worlds, instants = np.array([1, 0, 1, 1]), np.array([0, 2, 3, 10])
    generator = stream(5, COMMANDS)
    goal = np.stack([generator.uniform(-1, 1, 4) for _ in range(2)], axis=1)
    at = made.at(worlds, instants)
    np.testing.assert_array_equal(at[[0, 2, 3], :2], goal[[0, 1, 3]])
    assert set(at[:, 2]) <= {-1, 1}
    assert at[0, 2] == at[3, 2]


@pytest.mark.parametrize(
    ("content", "message"),
    [("t,x\n0,1\n", "a column time"), ("time,x\n1,1\n", "begins at 1 s"), ("time,x\n0,nan\n", "x is nan")],
)
def test_tables_that_cannot_be_used_are_refused(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "goals.csv").write_text(content)
    with pytest.raises(UsageError, match=message) as caught:
        signals(goal=Command(table=tmp_path / "goals.csv"))
    assert caught.value.path == ("commands", "goal", "table")


def test_new_values_come_at_control_instants() -> None:
    with pytest.raises(UsageError, match="is not a whole number of control periods") as caught:
        signals(goal=Command(random="uniform(0, 1)", every=0.25))
    assert caught.value.path == ("commands", "goal", "every")


@pytest.mark.parametrize(
    ("make", "message", "path"),
    [
        (lambda: Observation(name="x"), "taken from one of probe, joints", ("probe",)),
        (lambda: Observation(name="x", probe="qpos", value="1"), "not probe and value", ("value",)),
        (lambda: Observation(name="x", probe="qpos", of="qvel"), "of applies only with joints", ("of",)),
        (lambda: Observation(name="x", probe="qpos", noise="gauss(1, 2)"), "no distribution gauss", ("noise",)),
        (lambda: Observation(name="x", probe="qpos", noise="choice(a, b)"), "neither a number", ("noise",)),
        (lambda: Action(), "drives one of actuators, joints", ("actuators",)),
        (lambda: Action(actuators="*", joints="*"), "exclude each other", ("joints",)),
        (lambda: Action(joints="*"), "joints requires a target", ("target",)),
        (lambda: Action(actuators="*", target="torque"), "target torque applies only with joints", ("target",)),
        (lambda: Action(joints="*", target="position", kp=1), "requires kd", ("target",)),
        (lambda: Action(joints="*", target="torque", kp=1), "kp is not a gain of the target torque", ("kp",)),
        (lambda: Command(), "comes from one of", ("constant",)),
        (lambda: Command(constant=1, size=2), "size applies only with random", ("size",)),
        (lambda: Command(random=["uniform(0, 1)"] * 2, size=3), "has 2 distributions, not 3", ("size",)),
        (lambda: Reset(noise={"qpos/*": "b"}), "neither a number nor a distribution", ("noise", "qpos/*")),
    ],
)
def test_what_does_not_go_together_is_refused(make: Callable[[], object], message: str, path: tuple[str, ...]) -> None:
    with pytest.raises(UsageError) as caught:
        make()
    assert message in spelled(str(caught.value), str)
    assert caught.value.path == path


def test_terms_know_what_they_are() -> None:
    assert Observation(name="x", command="goal").source == "command"
    assert Reward(value="1").weight == 1
    assert Termination(when="1 > 0", as_="success").ending("there") == Ending("there", "success")
    assert not TIMED_OUT.terminated
    assert UNSTABLE.terminated
    assert Reset(vary={"geom/floor.friction": "1,0.1,0.1"}).vary == (("geom/floor.friction", "1,0.1,0.1"),)
