"""Controls from several things at once, against bare loops."""

import json
import math
import sys
import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import ControllerError, UnstableError, UsageError
from mjrun.physics.control import NOISE_BLOCK, ControlArray, ControlNoise, PeriodicController
from mjrun.physics.stepper import CHUNK
from mjrun.timeline import nearest
from tests.physics.driven_arm import arm, bare, by_instants, periodic, same, stepped_in_c, stepper, table


@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
def test_noise_is_added_to_what_a_controller_sets(taken: Callable) -> None:
    model = arm()
    expected, held = ControlNoise(0.3, 0, 9, 0.002, 2).rows(0, 101), np.zeros(2)

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        assert np.array_equal(data.ctrl, held)  # without the noise
        held[:] = [data.qpos[0], data.time]
        data.ctrl[:] = held

    drives = {
        "noise": ControlNoise(0.3, 0, 9, 0.002, 2),
        "controller": periodic(act, "0.01"),
    }
    found = taken(stepper(model, **drives), 100)
    qpos, time = found["qpos"][::5, 0].repeat(5)[:101], (np.arange(101) // 5) / 100
    assert found["ctrl"] - expected == pytest.approx(np.column_stack([qpos, time]), abs=1e-12)


def test_an_instability_under_varying_controls_is_found_at_its_step() -> None:
    model = arm()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data, first = mujoco.MjData(model), 0
    while not any(warning.number for warning in data.warning):
        data.ctrl[:] = (1e9, -1e9) if first >= 37 else (0, 0)
        mujoco.mj_step(model, data)
        first += 1
    with pytest.raises(UnstableError) as caught:
        stepper(model, table=table([0.0, 0.074], [0.0, 1e9])).advance(200)
    assert caught.value.step == first - 1 == 37


@cache
def whole_noise(smooth: float) -> np.ndarray:
    return ControlNoise(2.0, smooth, 5, 0.002, 3).rows(0, 5 * NOISE_BLOCK)


@pytest.mark.parametrize("smooth", [0.0, 0.05])
@settings(max_examples=30)
@given(first=st.integers(0, 3 * NOISE_BLOCK), count=st.integers(0, 2 * NOISE_BLOCK))
def test_noise_is_the_same_wherever_one_begins(smooth: float, first: int, count: int) -> None:
    whole = whole_noise(smooth)
    noise = ControlNoise(2.0, smooth, 5, 0.002, 3)
    assert np.array_equal(noise.rows(first, count), whole[first : first + count])
    assert np.array_equal(noise.rows(0, 10), whole[:10])


@pytest.mark.parametrize("smooth", [0.0, 0.02])
def test_noise_has_its_deviation_and_its_memory(smooth: float) -> None:
    rows = ControlNoise(0.5, smooth, 1, 0.002, 40).rows(0, 20_000)
    keep = math.exp(-0.002 / smooth) if smooth else 0.0
    assert rows.std() == pytest.approx(0.5, rel=0.02)
    assert rows.mean() == pytest.approx(0, abs=0.01)
    assert rows[0].std() == pytest.approx(0.5, rel=0.5)
    for lag in (1, 5):
        assert (rows[lag:] * rows[:-lag]).mean() / 0.25 == pytest.approx(keep**lag, abs=0.02)
    across = np.corrcoef(rows.T)[~np.eye(40, dtype=bool)]
    assert abs(across).max() < (0.1 if smooth else 0.04)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
@pytest.mark.parametrize("linear", [False, True])
def test_a_table_drives_as_a_bare_loop_does(integrator: str, taken: Callable, linear: bool) -> None:
    model = arm(integrator)
    time, values = [-0.1, 0.05, 0.1, 0.1013, 0.4], [1.0, -2.0, 0.5, 4.0, 0.0]

    def ctrl(step: int, data: mujoco.MjData) -> None:
        at = step / 500
        held = values[max(i for i, t in enumerate(time) if t <= at)]
        data.ctrl[:] = np.interp(at, time, values) * np.array([1, -1]) if linear else (held, -held)

    run = stepper(model, table=table(time, values, linear))
    assert same(taken(run, 260), bare(model, 260, ctrl))


def test_a_table_s_times_may_be_sums_of_floats() -> None:
    time = np.cumsum([0.002] * 100) - 0.002
    assert any(time[k] > k / 500 for k in range(100))  # which would be a step late
    ctrl = np.zeros((100, 2))
    table(time.tolist(), list(range(100))).apply(ctrl, 0, Fraction(1, 500))
    assert np.array_equal(ctrl[:, 0], np.arange(100))


def test_a_sequence_has_a_row_for_each_step_and_holds_the_last() -> None:
    values = np.arange(6.0).reshape(3, 2)
    ctrl = np.zeros((4, 2))
    ControlArray(values).apply(ctrl, 1, Fraction(1, 500))
    assert ctrl.tolist() == [[2, 3], [4, 5], [4, 5], [4, 5]]


def test_a_sequence_drives_as_a_bare_loop_does() -> None:
    model = arm()
    values = np.random.default_rng(0).standard_normal((80, 2))

    def ctrl(step: int, data: mujoco.MjData) -> None:
        data.ctrl[:] = values[min(step, 79)]

    for taken in (stepped_in_c, by_instants):
        assert same(taken(stepper(model, table=ControlArray(values)), 100), bare(model, 100, ctrl))


class Swing:
    """A controller with a memory of its own."""

    def __init__(self) -> None:
        self.calls: list[float] = []
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.calls.append(data.time)
        data.ctrl[:] = [math.sin(20 * data.time) - 0.3 * data.qvel[0], 0.1 * data.sensordata[0]]
        data.xfrc_applied[3, 2] = 3 * len(self.calls)


@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
@pytest.mark.parametrize(
    ("integrator", "period", "every"),
    [
        ("Euler", "0.002", 1),
        ("Euler", "0.014", 7),
        ("Euler", "0.3", 150),
        ("RK4", "0.014", 7),
        ("implicitfast", "0.014", 7),
    ],
)
def test_a_controller_drives_as_a_bare_loop_does(integrator: str, taken: Callable, period: str, every: int) -> None:
    model, swing, other = arm(integrator), Swing(), Swing()
    run = stepper(model, controller=periodic(swing, period))
    oracle = bare(model, 300, lambda step, data: None if step % every else other(model, data))
    assert same(taken(run, 300), oracle)
    assert len(swing.calls) == len(other.calls) == 300 // every + 1
    assert swing.resets == 1


class Reflex:
    """A controller of positions and velocities alone: it is called on the data of the steps, in blocks of them.

    Args:
      bad: the call in which it does something else.
    """

    def __init__(self, bad: int = -1, act: Callable[[], float] = lambda: 0.0) -> None:
        self.calls: list[float] = []
        self._bad, self._act = bad, act

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[0] = self._act() if len(self.calls) == self._bad else 0.3
        self.calls.append(data.time)
        data.ctrl[:] = [math.sin(20 * data.time) - 0.3 * data.qvel[0], 0.1 * len(self.calls)]
        data.xfrc_applied[3, 2] = 3 * len(self.calls)


class Keeper(Reflex):
    """The same controller, which keeps the data, and so gets a copy."""

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.data = data
        super().__call__(model, data)


@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
@pytest.mark.parametrize("kind", [Reflex, Keeper])
def test_a_controller_called_in_blocks_drives_as_a_bare_loop_does(
    kind: type[Reflex], integrator: str, every: int, taken: Callable
) -> None:
    model, reflex, other = arm(integrator), kind(), kind()
    run = stepper(model, controller=periodic(reflex, str(Fraction("0.002") * every)))
    assert run.steps_together() > CHUNK
    oracle = bare(model, 130, lambda step, data: None if step % every else other(model, data))
    assert same(taken(run, 130), oracle)
    assert reflex.calls == other.calls

    far = stepper(model, controller=periodic(kind(), str(Fraction("0.002") * every)))
    far.advance(130)
    assert np.array_equal(far.state(), run.state())


@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
@pytest.mark.parametrize("step", [1, CHUNK - 1, CHUNK, 120])
@pytest.mark.parametrize("kind", [Reflex, Keeper])
def test_a_controller_that_fails_later_is_called_once_at_each_step_until_then(
    kind: type[Reflex], step: int, taken: Callable
) -> None:
    reflex = kind(step, lambda: 1 / 0)
    run = stepper(arm(), controller=periodic(reflex, "0.002"))
    with pytest.raises(ControllerError, match=f"at step {step}, time .* raised ZeroDivisionError"):
        taken(run, 200)
    assert reflex.calls == pytest.approx(0.002 * np.arange(step))
    assert run.step == step


@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
@pytest.mark.parametrize("step", [1, CHUNK - 1, CHUNK, 120])
@pytest.mark.parametrize("kind", [Reflex, Keeper])
def test_a_controller_is_not_called_again_where_its_simulation_fails(
    kind: type[Reflex], step: int, taken: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for MuJoCo's log
    reflex = kind(step, lambda: 1e300)
    run = stepper(arm(), controller=periodic(reflex, "0.002"))
    with pytest.raises(UnstableError) as caught:
        taken(run, 200)
    assert caught.value.step == run.step == step
    assert reflex.calls[: step + 1] == pytest.approx(0.002 * np.arange(step + 1))
    assert len({*reflex.calls}) == len(reflex.calls)


def test_looking_on_does_not_call_a_controller() -> None:
    model, watched, alone = arm(), Swing(), Swing()
    runs = [stepper(model, controller=periodic(s, "0.01")) for s in (watched, alone)]
    for step in range(0, 101, 3):
        runs[0].advance(step)
        runs[0].instant()
        runs[0].state()
    for run in runs:
        run.advance(101)
    assert watched.calls == alone.calls
    assert np.array_equal(runs[0].state(), runs[1].state())


@given(st.fractions(1, 40, max_denominator=60), st.integers(0, 3000))
def test_a_controller_is_called_at_the_steps_nearest_to_its_multiples(ratio: Fraction, step: int) -> None:
    controller = PeriodicController(lambda model, data: None, ratio, Fraction(1))
    due = {nearest(k * ratio) for k in range(step + 3)}
    assert controller.is_due(step) == (step in due)
    assert controller.next_change(step) == min(k for k in due if k > step)


def test_returned_controls_count() -> None:
    model = arm()
    run = stepper(model, controller=periodic(lambda model, data: [1, 2], "0.002"))
    assert run.instant().ctrl == pytest.approx([1, 2])
    assert run.instant().actuator_force[0] == 1


@pytest.mark.parametrize(
    ("controller", "said"),
    [
        (
            lambda model, data: [1, 2, 3],
            r"returned shape \(3,\) at step 0, time 0 s; the model takes \(2,\)\nactuators: m",
        ),
        (lambda model, data: "up", "returned a str at step 0, time 0 s, not numbers"),
        (lambda model, data: ([1, 2], None), r"returned a tuple \(list, NoneType\) at step 0, time 0 s, not numbers"),
        (lambda model, data: [0, math.nan], "set g to nan at step 0"),
        (lambda model, data: data.qvel.fill(1), "changed the state at step 0"),
        (lambda model, data: 1 / 0, "(?s)at step 0, time 0 s, raised ZeroDivisionError: .*in <lambda>"),
        (lambda model, data: sys.exit(), "raised SystemExit"),
        (lambda model, data: next(iter(())), rf"raised StopIteration \({Path(__file__).name}:\d+\)\n"),
        (lambda model, data: json.loads("{"), rf"raised JSONDecodeError: .* \({Path(__file__).name}:\d+\)\n"),
        (lambda data: None, r"must take \(model, data\)"),
    ],
)
def test_a_controller_that_fails_says_how(controller: Callable, said: str) -> None:
    with pytest.raises(ControllerError, match=said):
        stepper(arm(), controller=periodic(controller, "0.002"))


def test_a_controller_cannot_be_called_between_steps() -> None:
    with pytest.raises(UsageError, match=r"control_dt 0.001 is shorter than the timestep, 0.002 s"):
        periodic(lambda model, data: None, "0.001")


def test_the_memory_of_noise_does_not_grow_with_the_actuators_of_each_step() -> None:
    blocks, actuators = 64, 16
    noise = ControlNoise(1.0, 0.1, 0, 0.001, actuators)
    tracemalloc.start()
    noise.rows(0, 1)
    before = tracemalloc.get_traced_memory()[0]
    noise.rows(blocks * NOISE_BLOCK, 1)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < blocks * NOISE_BLOCK * actuators * 8 / 10  # a tenth of all numbers that were drawn
