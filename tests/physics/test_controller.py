"""Controllers in Python, against bare loops that set `data.ctrl` by hand."""

import math
from collections.abc import Callable
from fractions import Fraction

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import ControllerError, UsageError
from mjrun.model import state
from mjrun.physics.controller import PeriodicController
from mjrun.timeline import nearest
from tests.physics.driven_arm import arm, bare, by_instants, periodic, same, stepped_in_c, stepper


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


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
@pytest.mark.parametrize("taken", [stepped_in_c, by_instants])
@pytest.mark.parametrize(("period", "every"), [("0.002", 1), ("0.014", 7), ("0.3", 150)])
def test_a_controller_drives_as_a_bare_loop_does(integrator: str, taken: Callable, period: str, every: int) -> None:
    model, swing, other = arm(integrator), Swing(), Swing()
    run = stepper(model, controller=periodic(swing, period))
    oracle = bare(model, 300, lambda step, data: None if step % every else other(model, data))
    assert same(taken(run, 300), oracle)
    assert len(swing.calls) == len(other.calls) == 300 // every + 1
    assert swing.resets == 1


def test_a_controller_that_does_nothing_changes_nothing() -> None:
    model = arm()
    idle = stepper(model, controller=periodic(lambda model, data: None, "0.004"))
    alone = stepper(model)
    idle.advance(500)
    alone.advance(500)
    assert np.array_equal(idle.state(), alone.state())


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


def test_a_controller_sees_one_instant() -> None:
    model = arm()

    def check(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        fresh = mujoco.MjData(model)
        state.restore(model, fresh, state.save(model, data))
        mujoco.mj_forward(model, fresh)
        assert np.array_equal(fresh.xpos, data.xpos)
        assert np.array_equal(fresh.sensordata, data.sensordata)
        data.ctrl[:] = math.cos(9 * data.time)

    stepper(model, controller=periodic(check, "0.002")).advance(60)


@given(st.fractions(1, 40, max_denominator=60), st.integers(0, 3000))
def test_a_controller_is_called_at_the_steps_nearest_to_its_multiples(ratio: Fraction, step: int) -> None:
    controller = PeriodicController(lambda model, data: None, ratio, Fraction(1))
    due = {nearest(k * ratio) for k in range(step + 3)}
    assert controller.is_due(step) == (step in due)
    assert controller.next_call(step) == min(k for k in due if k > step)


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
        (lambda model, data: [0, math.nan], "set g to nan at step 0"),
        (lambda model, data: data.qvel.fill(1), "changed the state at step 0"),
        (lambda model, data: 1 / 0, "(?s)at step 0, time 0 s, raised ZeroDivisionError: .*in <lambda>"),
        (lambda data: None, r"must take \(model, data\)"),
    ],
)
def test_a_controller_that_fails_says_how(controller: Callable, said: str) -> None:
    with pytest.raises(ControllerError, match=said):
        stepper(arm(), controller=periodic(controller, "0.002"))


def test_a_controller_that_leaves_is_an_error() -> None:
    def leave(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        raise SystemExit(0)

    with pytest.raises(ControllerError, match="raised SystemExit"):
        stepper(arm(), controller=periodic(leave, "0.002"))


def test_a_controller_cannot_be_called_between_steps() -> None:
    with pytest.raises(UsageError, match=r"control_dt 0.001 is shorter than the timestep, 0.002 s"):
        periodic(lambda model, data: None, "0.001")
