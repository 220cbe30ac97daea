"""An episode of a task step by step: bit for bit that of the worlds, and of bare loops of mj_step."""

from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import InvalidActionError, UnstableError
from mjrun.model import state
from mjrun.options.disturbance import Push
from mjrun.outputs.trace_rows import blocks
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.task.episode import Ending
from mjrun.task.single_world import SingleWorld, TaskStepper
from mjrun.task.task import TIMED_OUT, Action, Command, Observation, Reset, Task, Termination
from mjrun.task.worlds import TaskWorlds
from tests.task.test_single_world import FORCED
from tests.task.test_worlds import CART, DISTURBED, cart, replace_model

ARM = """<mujoco><option timestep="0.01"/>
  <worldbody><body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping=".1"/>
    <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/>
    <body name="lower" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4"/></body></body></worldbody>
  <actuator><motor name="m1" joint="shoulder" gear="2"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(ARM)
MOTORS = [Action(actuators=["m1", "m2"], scale=0.5)]
POSITIONS = [Action(joints=["elbow", "shoulder"], target="position", kp=20, kd=[1, 2], scale=0.3)]


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
