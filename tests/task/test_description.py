"""A task, and an environment as a task, is described number by number."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.model.sources.gym import GymSource
from mjrun.physics.initial_state import InitialState
from mjrun.probe.fields import field_probe
from mjrun.task.description import SECTIONS, describe_environment, describe_task
from mjrun.task.task import Action, Command, Observation, Reset, Reward, Task, Termination
from mjrun.task.worlds import TaskWorlds
from tests.task.environments import registered

ARM = """<mujoco><option timestep=".01"/><worldbody><body name="arm"><joint name="hip"/><geom size=".1" pos="0 0 1"/>
<body name="hand" pos="0 0 1"><joint name="rail" type="slide"/><geom size=".1" pos="0 0 1"/></body></body></worldbody>
<actuator><motor name="turn" joint="hip" ctrlrange="-2 2"/><motor name="push" joint="rail"/></actuator>
<keyframe><key name="up" qpos=".5 .25"/></keyframe></mujoco>"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM)


def task() -> Task:
    return Task(
        "arm.xml",
        control_dt=0.02,
        duration=1,
        observations=[
            Observation(name="angle", probe="qpos/hip", offset=0.5, scale=[2], clip=[-1, 1]),
            Observation(name="speeds", joints=["rail", "hip"], of="qvel", history=2, delay=1, noise="normal(0, 1)"),
            Observation(name="hand", probe="xpos/hand", frame="arm"),
            Observation(name="wish", command="wish"),
            Observation(name="clock", phase=0.5),
        ],
        actions=[
            Action(joints="rail", target="position", kp=10, kd=1, squash="tanh", scale=0.1, offset="up"),
            Action(actuators="turn", clip=[-1, 2]),
        ],
        commands={
            "wish": Command(schedule=[[0, [1, 0]], [0.5, [0, 1]]]),
            "pace": Command(random="uniform(0, 1)", size=3, every=0.1),
            "still": Command(constant=2),
        },
        rewards={"near": Reward(value="1 - qpos/hip", weight=0.5), "alive": "1"},
        terminations={"over": Termination(when="qpos/hip > 2", as_="failure")},
        reset=Reset(key="up", qvel={"hip": 1.5}, noise={"qpos/*": "uniform(-0.1, 0.1)"}, vary={"opt.gravity[2]": "1"}),
    )


def test_rows_are_the_numbers_that_worlds_observe_and_take_in_order() -> None:
    made, worlds = describe_task(task()), TaskWorlds(task(), 1)
    assert [row.name for row in made.observations] == worlds.observation_names
    assert [row.name for row in made.actions] == worlds.action_names
    assert [row.index for row in made.observations] == list(range(worlds.reset([0]).shape[1]))
    assert (made.task.observations, made.task.actions) == (len(made.observations), len(made.actions))


def test_what_a_row_says_is_what_is_done_to_the_number() -> None:
    """Scale, offset and limits of a row, applied to its source, give the number that is observed."""
    made, worlds = describe_task(task()), TaskWorlds(task(), 1)
    row = made.observations[0]
    observed = worlds.reset([3])[0]
    for _ in range(5):
        model = worlds.model(0)
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, worlds.state(0), mujoco.mjtState.mjSTATE_INTEGRATION)
        assert row.low is not None
        assert row.high is not None
        assert observed[0] == np.clip((data.joint("hip").qpos[0] - row.offset) * row.scale, row.low, row.high)
        observed = worlds.step(np.array([[0.0, 2.0]])).observations[0]


def test_each_row_says_where_its_number_comes_from() -> None:
    rows = describe_task(task()).observations
    assert [(row.name, row.source, row.unit, row.delay) for row in rows] == [
        ("angle", "qpos/hip", "rad", 0),
        ("speeds/rail@-1", "qvel/rail", "m/s", 2),
        ("speeds/hip@-1", "qvel/hip", "rad/s", 2),
        ("speeds/rail", "qvel/rail", "m/s", 1),
        ("speeds/hip", "qvel/hip", "rad/s", 1),
        ("hand/x", "xpos/hand/x", "m", 0),
        ("hand/y", "xpos/hand/y", "m", 0),
        ("hand/z", "xpos/hand/z", "m", 0),
        ("wish/0", "command/wish/0", "", 0),
        ("wish/1", "command/wish/1", "", 0),
        ("clock/sin", "sin(2π t/0.5 s)", "", 0),
        ("clock/cos", "cos(2π t/0.5 s)", "", 0),
    ]
    assert {row.frame for row in rows if row.name.startswith("hand")} == {"arm"}
    assert {row.noise for row in rows if row.name.startswith("speeds")} == {"normal(0, 1)"}
    assert (rows[1].low, rows[1].high, rows[0].low, rows[0].high) == (None, None, -1, 1)


def test_actions_name_their_target_gains_and_limits() -> None:
    rail, turn = describe_task(task()).actions
    assert (rail.target, rail.unit, rail.squash, rail.scale, rail.offset) == ("position", "m", "tanh", 0.1, 0.25)
    assert (rail.kp, rail.kd, rail.actuator, rail.range) == (10, 1, "push", None)
    assert (turn.target, turn.low, turn.high, turn.actuator, turn.range) == ("control", -1, 2, "turn", (-2, 2))
    assert (turn.kp, turn.kd) == (None, None)


def test_limits_of_controls_are_those_before_the_variation_of_the_model() -> None:
    varied = replace(task(), reset=Reset(key="up", vary={"actuator/turn.ctrlrange[1]": "uniform(5, 9)"}))
    assert [row.range for row in describe_task(varied).actions] == [None, (-2, 2)]


def test_all_else_is_as_the_task_says() -> None:
    made = json.loads(json.dumps(describe_task(task()).document()))
    assert [*made] == [*SECTIONS]
    assert made["commands"] == [
        {"name": "wish", "size": 2, "source": "1 0 from 0 s, 0 1 from 0.5 s"},
        {"name": "pace", "size": 3, "source": "uniform(0, 1) every 0.1 s"},
        {"name": "still", "size": 1, "source": "2"},
    ]
    assert made["rewards"] == [
        {"name": "near", "weight": 0.5, "value": "1 - qpos/hip"},
        {"name": "alive", "weight": 1, "value": "1"},
    ]
    assert made["terminations"] == [{"name": "over", "kind": "failure", "when": "qpos/hip > 2"}]
    assert made["reset"] == [
        {"what": "key", "name": "up", "value": ""},
        {"what": "qvel", "name": "hip", "value": "1.5"},
        {"what": "noise", "name": "qpos/*", "value": "uniform(-0.1, 0.1)"},
        {"what": "vary", "name": "opt.gravity[2]", "value": "1"},
    ]
    assert made["task"] == {
        "model": "arm.xml",
        "timestep": 0.01,
        "control_dt": 0.02,
        "control_steps": 2,
        "duration": 1.0,
        "periods": 50,
        "derived": "current",
        "observations": 12,
        "actions": 2,
    }


def test_a_section_that_there_is_not_is_told() -> None:
    made = describe_task(task())
    assert [*made.document("actions")] == ["actions"]
    with pytest.raises(UnknownNameError, match="no section 'action'"):
        made.document("action")


def test_what_does_not_fit_the_model_is_told() -> None:
    bad = Task(
        "arm.xml",
        control_dt=0.02,
        duration=1,
        observations=[Observation(name="angle", probe="qpos/hop")],
        actions=[Action(actuators="turn")],
    )
    with pytest.raises(UsageError, match="hop"):
        describe_task(bad)


@pytest.mark.parametrize(("name", "numbers", "limit"), [("Ant-v5", (105, 8), 1000), ("Reacher-v5", (10, 2), 50)])
def test_sizes_and_times_are_those_of_gymnasium(name: str, numbers: tuple[int, int], limit: int) -> None:
    task = describe_environment(GymSource(name)).task
    environment: gymnasium.Env = gymnasium.make(name)
    assert (task.observations, task.actions, task.periods) == (*numbers, limit)
    assert environment.observation_space.shape == (task.observations,)
    assert environment.get_wrapper_attr("dt") == task.control_dt == task.control_steps * task.timestep
    assert task.duration == pytest.approx(limit * task.control_dt)


def test_each_number_of_an_observation_is_that_of_its_source() -> None:
    source = GymSource("Hopper-v5?reset_noise_scale=0")
    environment = gymnasium.make("Hopper-v5", reset_noise_scale=0)
    observation, _ = environment.reset(seed=1)
    model, data = source.load(), InitialState().data(source.load())
    columns = {
        column.name: (value, column.unit)
        for field, values in (("qpos", data.qpos), ("qvel", data.qvel))
        for column, value in zip(field_probe(model, field).columns, values, strict=True)
    }
    for row in describe_environment(source).observations:
        assert columns[row.source] == (observation[row.index], row.unit)


def test_actions_have_their_bounds_and_the_limits_of_their_controls() -> None:
    rows = describe_environment(GymSource("Humanoid-v5")).actions
    assert [row.name for row in rows[:2]] == ["abdomen_y", "abdomen_z"]
    assert all((row.low, row.high) == pytest.approx((-0.4, 0.4)) == row.range for row in rows)


def test_an_environment_without_a_limit_has_none(tmp_path: Path) -> None:
    with registered(tmp_path) as name:
        description = describe_environment(GymSource(name))
    assert (description.task.duration, description.task.periods) == (None, None)
    assert [row.name for row in description.terminations] == ["terminated"]
    assert [row.name for row in description.rewards] == ["alive", "speed"]
    assert np.all([row.source == "" for row in description.observations])


def test_the_range_of_an_action_is_that_of_its_control_after_an_actuator_with_several() -> None:
    Path("turn.xml").write_text("""<mujoco><option timestep=".01"/><worldbody>
    <body name="a"><joint name="ball" type="ball" range="0 1"/><geom size=".1"/></body>
    <body name="b" pos="1 0 0"><joint name="hinge"/><geom size=".1"/></body></worldbody><actuator>
    <orientation name="turn" joint="ball"/><motor name="push" joint="hinge" ctrlrange="-3 3"/>
    </actuator></mujoco>""")
    observations = [Observation(name="angle", probe="qpos/hinge")]
    made = describe_task(
        Task("turn.xml", control_dt=0.02, duration=1, observations=observations, actions=[Action(actuators="*")])
    )
    limits = {row.name: row.range for row in made.actions}
    model = mujoco.MjModel.from_xml_path("turn.xml")
    assert len(limits) == model.nu > model.nactuator
    assert limits["push"] == (-3, 3)
