"""A single world gives what worlds side by side give, to the last bit, whatever a task is made of."""

import copy
import pickle
import warnings
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import InvalidActionError, ModelError, UnstableError, UsageError
from mjrun.model import state
from mjrun.options.simulation import Push
from mjrun.outputs.trace_rows import blocks
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.task.episode import Ending
from mjrun.task.single_world import SingleWorld, TaskStepper
from mjrun.task.task import TIMED_OUT, Action, Command, Observation, Reset, Task, Termination
from mjrun.task.worlds import TaskWorlds
from tests.task import gymnasium_tasks
from tests.task.test_worlds import CART, DISTURBED, EVERYTHING, cart, replace_model

FORCED = {
    "actions": [Action(joints="hinge", target="torque", scale=3), Action(joints="slide", target="velocity", kd=2)],
    "observations": [
        Observation(name="x", probe="qpos/slide", noise="uniform(-1, 1)"),
        Observation(name="force", probe="qfrc_actuator/hinge", history=2),
        Observation(name="left", value="time^2"),
    ],
    "rewards": {"r": "time - rate(action/hinge) / qpos/slide", "nothing": "1/0 - log(-qpos/slide)"},
}
ARM = """<mujoco><option timestep="0.01"/>
  <worldbody><body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping=".1"/>
    <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/>
    <body name="lower" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/></body></body></worldbody>
  <actuator><motor name="m1" joint="shoulder" gear="2"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(ARM)
MOTORS = [Action(actuators=["m1", "m2"], scale=0.5)]
POSITIONS = [Action(joints=["elbow", "shoulder"], target="position", kp=20, kd=[1, 2], scale=0.3)]


def assert_same(task: Task, scale: float = 1.0) -> None:
    """Plays two episodes in both."""
    single, worlds = SingleWorld(task), TaskWorlds(task, 1)
    generator = np.random.default_rng(2)
    for seed in (3, 4):
        np.testing.assert_array_equal(single.start(seed), worlds.reset([seed])[0])
        assert single.ended_at_start == worlds.ended_at_start
        for _ in range(20):
            action = scale * generator.uniform(-1, 1, len(worlds.action_names))
            ours, theirs = single.act(action.astype(np.float32)), worlds.step(action.astype(np.float32)[None])
            np.testing.assert_array_equal(ours.observations, theirs.observations[0])
            np.testing.assert_array_equal(
                [ours.rewards, *ours.reward_terms], [theirs.rewards[0], *theirs.reward_terms[0]]
            )
            assert ours.codes == theirs.codes[0]
            np.testing.assert_array_equal(single.state(0), worlds.state(0))
            if theirs.over[0]:
                break


@pytest.mark.parametrize("derived", ["current", "lagged"])
@pytest.mark.parametrize("values", [{}, DISTURBED, FORCED], ids=["plain", "disturbed", "forced"])
def test_it_is_one_of_many(tmp_path: Path, values: Mapping[str, object], derived: str) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    assert_same(replace_model(cart(**values, derived=derived), tmp_path / "cart.xml"))


@pytest.mark.parametrize("derived", ["current", "lagged"])
@pytest.mark.parametrize("values", [{}, EVERYTHING, FORCED], ids=["plain", "everything", "forced"])
def test_a_control_period_can_be_stepped_in_parts(values: Mapping[str, object], derived: str, tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    task = replace_model(cart(**values, derived=derived), tmp_path / "cart.xml")
    whole, parts = SingleWorld(task), SingleWorld(task)
    np.testing.assert_array_equal(whole.start(1), parts.start(1))
    model = parts.model(0)
    data = mujoco.MjData(model)
    for k in range(5):
        action = np.sin(k + np.arange(len(whole.action_names)))
        step = whole.act(action)
        parts.apply(action)
        for _ in range(whole.control_steps):
            state.restore(model, data, parts.state(0))
            parts.hold(data.qpos, data.qvel)
            parts.advance(1)
        state.restore(model, data, parts.state(0))
        mujoco.mj_forward(model, data)
        other = parts.conclude() if derived == "lagged" else parts.conclude_in(model, data)
        np.testing.assert_array_equal(step.observations, other.observations)
        np.testing.assert_array_equal([step.rewards, *step.reward_terms], [other.rewards, *other.reward_terms])
        np.testing.assert_array_equal(whole.state(0), parts.state(0))


@pytest.mark.parametrize("make", [gymnasium_tasks.hopper, gymnasium_tasks.ant])
def test_it_is_one_of_many_for_gymnasiums_tasks(make: Callable[[], Task]) -> None:
    with warnings.catch_warnings(action="ignore"):
        assert_same(make())


def test_an_unstable_world_ends_as_among_others() -> None:
    task = cart(actions=[Action(actuators="push", scale=1e9)])
    assert_same(task)
    single = SingleWorld(task)
    before = single.start(0)
    step = single.act(np.ones(1))
    assert step.endings[step.codes].name == "unstable"
    assert step.rewards == 0
    np.testing.assert_array_equal(step.observations, before)


def test_actions_that_cannot_be_are_refused() -> None:
    single = SingleWorld(cart())
    with pytest.raises(ValueError, match="reset it"):
        single.act(np.zeros(2))
    single.start(1)
    with pytest.raises(ValueError, match=r"shape \(2,\), not a tuple \(list, NoneType\)"):
        single.act(([0, 0], None))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"shape \(2,\), not \(3,\)"):
        single.act(np.zeros(3))
    with pytest.raises(ValueError, match=r"push is nan$"):
        single.act(np.array([0, np.nan]))
    single.act(np.array([1e200, 0]))  # whose square is not finite


def pickled(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


@pytest.mark.parametrize(
    ("values", "derived", "copied"),
    [({}, "current", copy.deepcopy), (DISTURBED, "lagged", copy.copy), (FORCED, "current", pickled)],
)
def test_copies_go_on_with_the_same_bits(
    tmp_path: Path, values: Mapping[str, object], derived: str, copied: Callable[[Any], Any]
) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    task = replace_model(cart(**values, derived=derived), tmp_path / "cart.xml")
    single, several = SingleWorld(task), TaskWorlds(task, 3)
    actions = np.random.default_rng(4).normal(size=(18, 3, len(single.action_names)))  # noise is drawn 16 at a time
    for steps in (0, 1, 5):
        single.start(7)
        several.reset([7, 8], [0, 2])
        for action in actions[:steps]:
            single.act(action[0])
            several.step(action[[2, 0]], [2, 0])
        single_copy, several_copy = copied(single), copied(several)
        np.testing.assert_array_equal(single_copy.model(0).geom_friction, single.model(0).geom_friction)
        for action in actions[steps:]:
            np.testing.assert_equal(single_copy.act(action[0])[:4], single.act(action[0])[:4])
            expected = several.step(action[[0, 2]], [0, 2])
            np.testing.assert_equal(several_copy.step(action[[0, 2]], [0, 2])[:4], expected[:4])
        np.testing.assert_array_equal(single_copy.state(0), single.state(0))
        np.testing.assert_array_equal(single_copy.start(9), single.start(9))


def test_a_copy_of_another_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    single = SingleWorld(replace_model(cart(), tmp_path / "cart.xml"))
    before, text = single.start(1), pickle.dumps(single)
    (tmp_path / "cart.xml").write_text(CART.replace('gear="2"', 'gear="3"'))
    np.testing.assert_array_equal(single.start(1), before)  # which has read its model once
    with pytest.raises(ModelError, match=r"cart.xml is not the model of the copied environment"):
        pickle.loads(text)


def test_copies_with_bodies_that_sleep_are_refused_within_an_episode(tmp_path: Path) -> None:
    asleep = CART.replace('<option timestep="0.01"/>', '<option timestep="0.01"><flag sleep="enable"/></option>')
    (tmp_path / "cart.xml").write_text(asleep)
    single = SingleWorld(replace_model(cart(), tmp_path / "cart.xml"))
    copy.deepcopy(single).start(1)
    single.start(1)
    with pytest.raises(UsageError, match="cannot be copied within an episode"):
        copy.deepcopy(single)


def arm(**values: object) -> Task:
    given = {
        "control_dt": 0.04,
        "duration": 0.4,
        "observations": [
            Observation(name="joints", joints=["*"]),
            Observation(name="last", action="previous"),
            Observation(name="goal", command="goal"),
        ],
        "actions": MOTORS,
        "commands": {"goal": Command(schedule=[[0, 1], [0.2, 2]])},
        "rewards": {"up": "xpos/lower/z", "calm": "-norm(rate('qpos/*'))"},
        "reset": Reset(noise={"qpos/*": "normal(0, 0.5)"}),
        **values,
    }
    return Task(MODEL, **given)  # type: ignore[arg-type]


class Wave:
    """Answers with a wave, and with what it sees."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        self.calls += 1
        return np.sin(self.calls + observation[:2])


@pytest.mark.parametrize("actions", [MOTORS, POSITIONS])
def test_it_is_the_episode_of_the_worlds_however_one_looks_at_it(actions: list[Action]) -> None:
    task = arm(actions=actions)
    worlds, wave = TaskWorlds(task, 2), Wave()
    observation = worlds.reset([3, 5])[1]
    every, sometimes = (TaskStepper(SingleWorld(task), Wave(), 5) for _ in range(2))
    total = 0.0
    for k in range(10):
        action = wave(observation)
        for stepper in (every, sometimes):
            now = stepper.now()
            np.testing.assert_array_equal(now.observation, observation)
            np.testing.assert_array_equal(now.action, action)
            assert (now.total, now.ending, stepper.step, stepper.periods) == (total, None, 4 * k, k)
        result = worlds.step(np.stack([action, action]))
        observation, total = result.observations[1], total + result.rewards[1]

        sometimes.advance(4 * k + 4)
        for step in range(4 * k + 1, 4 * k + 5):
            every.advance(step)
            every.instant()
        np.testing.assert_array_equal(sometimes.now().reward_terms, result.reward_terms[1])
        physics = state.part(MODEL, mujoco.mjtState.mjSTATE_PHYSICS)
        np.testing.assert_array_equal(every.state()[physics], worlds.state(1)[physics])
        np.testing.assert_array_equal(every.state(), sometimes.state())
    assert (every.now().ending, every.periods) == (TIMED_OUT, 10)


ASLEEP = '<option timestep="0.01" sleep_tolerance="1"><flag sleep="enable"/></option>'
RK4, EULER = '<option timestep="0.01" integrator="RK4"/>', '<option timestep="0.01"/>'
CASES = pytest.mark.parametrize(
    ("values", "derived", "option"),
    [
        pytest.param(DISTURBED, "current", RK4, id="disturbed RK4"),
        pytest.param(FORCED, "lagged", RK4, id="forced RK4"),
        pytest.param(DISTURBED, "lagged", EULER, id="disturbed Euler"),
        pytest.param(FORCED, "current", EULER, id="forced Euler"),
        pytest.param({}, "lagged", EULER, id="plain Euler"),
        pytest.param({}, "current", EULER, id="current Euler"),
        pytest.param({}, "current", ASLEEP, id="plain asleep"),
        pytest.param(DISTURBED, "lagged", ASLEEP, id="disturbed asleep"),
    ],
)


@CASES
def test_what_a_task_measures_is_that_of_the_worlds(
    tmp_path: Path, values: Mapping[str, object], derived: str, option: str
) -> None:
    (tmp_path / "cart.xml").write_text(CART.replace('<option timestep="0.01"/>', option))
    task = replace_model(cart(**{**values, "derived": derived, "terminations": {}}), tmp_path / "cart.xml")
    worlds = TaskWorlds(task, 1)
    every, sometimes = (TaskStepper(SingleWorld(task), Wave(), 5) for _ in range(2))
    observation, wave = worlds.reset([5]), Wave()
    inputs = state.controls(worlds.model(0)).start
    for period in range(1, 16):
        result = worlds.step(wave(observation[0])[None])
        observation = result.observations
        sometimes.advance(3 * period)
        for step in range(3 * period - 2, 3 * period + 1):
            every.advance(step)
            every.instant()
        for stepper in (every, sometimes):
            now = stepper.now()
            np.testing.assert_array_equal(now.observation, observation[0])
            np.testing.assert_array_equal([now.reward, *now.reward_terms], [result.rewards[0], *result.reward_terms[0]])
            np.testing.assert_array_equal(stepper.state()[:inputs], worlds.state(0)[:inputs])


@pytest.mark.parametrize("actions", [MOTORS, POSITIONS])
def test_the_controls_in_force_at_an_instant_are_those_of_the_next_step(actions: list[Action]) -> None:
    stepper = TaskStepper(SingleWorld(arm(actions=actions)), Wave(), 1)
    data = mujoco.MjData(MODEL)
    for step in range(1, 13):
        state.restore(MODEL, data, stepper.state())
        np.testing.assert_array_equal(stepper.instant().ctrl, data.ctrl)
        if actions is POSITIONS:
            wanted = stepper.now().action[[1, 0]] * 0.3
            torque = 20 * (wanted - data.qpos) - [2, 1] * data.qvel
            np.testing.assert_allclose(data.ctrl, torque / [2, 1], rtol=1e-12)
        else:
            np.testing.assert_array_equal(data.ctrl, stepper.now().action * 0.5)
        mujoco.mj_step(MODEL, data)
        stepper.advance(step)
        np.testing.assert_array_equal(stepper.state()[1:5], [*data.qpos, *data.qvel])


def test_beyond_the_end_it_goes_on_without_a_reset_and_the_return_stays() -> None:
    ended = {"low": Termination(when="time > 0.15", as_="success")}
    stepper = TaskStepper(SingleWorld(arm(terminations=ended)), Wave(), 2)
    free = TaskStepper(SingleWorld(arm(duration=5)), Wave(), 2)
    totals: dict[int, float] = {}
    for step in range(4, 81, 4):
        stepper.advance(step)
        free.advance(step)
        np.testing.assert_array_equal(stepper.state(), free.state())
        totals[step] = free.now().total
    now = stepper.now()
    assert now.ending == Ending("low", "success")
    assert (stepper.periods, now.total) == (4, totals[16])
    assert now.reward == free.now().reward


def test_noise_delays_and_pushes_act_as_in_a_bare_loop() -> None:
    """Each motor has a separate delay; the noise is white, and drawn from the seed in blocks of 1024 steps."""
    push = Push("lower", (5.0, 0.0, 0.0), Fraction("0.05"), Fraction("0.07"))
    actions = [Action(actuators="m1", scale=0.5, delay=2), Action(actuators="m2", scale=0.5, offset=0.1, delay=1)]
    stepper = TaskStepper(SingleWorld(arm(push=push, ctrl_noise=0.3, actions=actions)), Wave(), 4)
    noise = 0.3 * np.random.default_rng([4, 1, 0]).standard_normal((1024, 2))
    data, wave, returned = mujoco.MjData(MODEL), Wave(), [np.zeros(2)] * 2
    state.restore(MODEL, data, stepper.state())
    for step in range(16):
        if step % 4 == 0:
            returned.append(wave(np.array([*data.qpos])))
        data.ctrl[:] = [returned[-3][0] * 0.5, returned[-2][1] * 0.5 + 0.1]
        data.ctrl += noise[step]
        data.xfrc_applied[2, 0] = 5 if 5 <= step < 12 else 0
        stepper.advance(step)
        np.testing.assert_array_equal(stepper.state()[1:5], [*data.qpos, *data.qvel])
        np.testing.assert_array_equal(stepper.instant().ctrl, data.ctrl)
        mujoco.mj_step(MODEL, data)


class Answers:
    """Gives what it is told to."""

    def __init__(self, *answers: list[float]) -> None:
        self.answers = iter(answers)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        return np.array(next(self.answers))


def test_an_action_that_is_not_finite_is_told_with_its_step() -> None:
    stepper = TaskStepper(SingleWorld(arm()), Answers([0, 0], [0, np.nan]), 0, "p.onnx")
    with pytest.raises(
        InvalidActionError, match=r"p\.onnx returned non-finite actions at step 4, time 0.04 s: m2 = nan"
    ) as caught:
        stepper.advance(6)
    assert caught.value.step == 4


@pytest.mark.parametrize("every", [1, 8])
def test_an_unstable_simulation_is_told_with_its_first_bad_step(every: int) -> None:
    stepper = TaskStepper(SingleWorld(arm()), Answers([0, 0], *[[1e10, 0]] * 10), 0)
    steps = [Tap(range(0, 41, every), id)]
    with pytest.raises(UnstableError, match=r"the simulation became unstable at step 4, .*joint 'shoulder'"):
        run_with_taps(stepper, steps, 40)


FIELDS = ("qpos", "qvel", "ctrl", "qacc", "sensordata", "energy", "xpos", "qfrc_constraint", "ncon", "xfrc_applied")


@CASES
def test_rows_in_blocks_are_instants_of_a_bare_loop(
    tmp_path: Path, values: Mapping[str, object], derived: str, option: str
) -> None:
    (tmp_path / "cart.xml").write_text(CART.replace('<option timestep="0.01"/>', option))
    task = replace_model(cart(**{**values, "derived": derived, "terminations": {}}), tmp_path / "cart.xml")
    singly, together = (TaskStepper(SingleWorld(task), Wave(), 5) for _ in range(2))
    data, shown = (mujoco.MjData(singly.model) for _ in range(2))
    state.restore(singly.model, data, singly.state())
    expected: dict[str, list[np.ndarray]] = {field: [] for field in FIELDS}
    for step in range(31):
        singly.advance(step)
        inputs = state.save(singly.model, singly.instant(), state.INPUTS)
        state.restore(singly.model, data, inputs, state.INPUTS)
        mujoco.mj_copyData(shown, singly.model, data)
        mujoco.mj_forward(singly.model, shown)
        for field in FIELDS:
            expected[field].append(np.array(getattr(shown, field)))
        mujoco.mj_step(singly.model, data)
    rows = [fields for _, _, fields in blocks(together, FIELDS, 30, 11)]
    for field in FIELDS:
        np.testing.assert_array_equal(np.concatenate([each[field][0] for each in rows]), expected[field], field)
    np.testing.assert_array_equal(together.now().observation, singly.now().observation)
    np.testing.assert_array_equal(together.now().total, singly.now().total)
    assert together.step == 30


def test_an_invalid_action_ends_rows_in_blocks_where_it_ends_the_simulation() -> None:
    stepper = TaskStepper(SingleWorld(arm()), Answers([0, 0], [0, 0], [0, np.nan]), 0, "p.onnx")
    steps: list[int] = []

    def collect() -> None:
        for first, count, _ in blocks(stepper, ("qpos",), 40):
            steps.extend(range(first, first + count))

    with pytest.raises(InvalidActionError, match="at step 8"):
        collect()
    assert steps == [*range(8)]


@pytest.mark.parametrize("actions", [MOTORS, POSITIONS])
def test_a_block_that_fails_is_repeated_without_another_call_of_the_policy(actions: list[Action]) -> None:
    """The simulation diverges in the period of the fifth action, in a block that goes on to further actions."""

    class Diverging(Wave):
        def __call__(self, observation: np.ndarray) -> np.ndarray:
            return super().__call__(observation) * (1e9 if self.calls == 5 else 1)

    def played(rows: bool) -> tuple[int, list[float], list[bytes]]:
        actor, totals, states = Diverging(), list[float](), list[bytes]()
        stepper = TaskStepper(SingleWorld(arm(actions=actions)), actor, 5)

        def read(data: mujoco.MjData) -> None:
            totals.append(stepper.now().total)
            states.append(data.qpos.tobytes() + data.ctrl.tobytes())

        if rows:
            assert stepper.steps_together() > 20
            assert not stepper.read_steps(30, lambda data: [partial(read, data)], [])
            assert (stepper.step, stepper.now().total) == (0, 0.0)
            totals, states = [], []
        with pytest.raises(UnstableError, match=r"at step 1[67],"):
            run_with_taps(stepper, [Tap(range(41), lambda _: read(stepper.instant()))], 40)
        return actor.calls, totals, states

    (calls, *singly), (calls_in_block, *in_block) = played(rows=False), played(rows=True)
    assert singly == in_block
    assert calls == 5 < calls_in_block <= 8  # of the steps 0, 4, …, 28 of the block
