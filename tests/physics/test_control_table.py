"""Controls from tables, against bare loops that look them up."""

from collections.abc import Callable
from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.physics.control_table import ControlArray, ControlTable
from tests.physics.driven_arm import arm, bare, by_instants, same, stepped_in_c, stepper, table


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

    run = stepper(model, table=table(model, time, values, linear))
    assert same(taken(run, 260), bare(model, 260, ctrl))


def test_a_table_s_times_may_be_sums_of_floats() -> None:
    model = arm()
    time = np.cumsum([0.002] * 100) - 0.002
    assert any(time[k] > k / 500 for k in range(100))  # which would be a step late
    ctrl = np.zeros((100, 2))
    table(model, time.tolist(), list(range(100))).apply(ctrl, 0, Fraction(1, 500))
    assert np.array_equal(ctrl[:, 0], np.arange(100))


def test_actuators_without_a_column_keep_their_control() -> None:
    model = arm()
    driven = ControlTable(model, {"time": np.zeros(1), "ctrl/g": np.ones(1)}, "t.csv", constant=[0])
    ctrl = np.full((3, 2), 7.0)
    driven.apply(ctrl, 0, Fraction(1, 500))
    assert ctrl.tolist() == [[7, 1]] * 3


GOOD = {"time": np.array([0, 1.0]), "ctrl/m": np.zeros(2), "ctrl/g": np.zeros(2)}


@pytest.mark.parametrize(
    ("columns", "kind", "said"),
    [
        ({**GOOD, "ctrl/q": np.zeros(2)}, UnknownNameError, "no actuator 'q' in the columns of t.csv"),
        (
            {k: v for k, v in GOOD.items() if k != "ctrl/g"},
            UsageError,
            "t.csv lacks columns that the model takes: ctrl/g",
        ),
        ({"time": np.zeros(1)}, UsageError, "lacks columns that the model takes: ctrl/m, ctrl/g"),
        ({k: v for k, v in GOOD.items() if k != "time"}, UsageError, "has no column 'time'"),
        ({k: v[:0] for k, v in GOOD.items()}, UsageError, "has no rows"),
        ({**GOOD, "time": np.array([1.0, 0])}, UsageError, "row 1: time 0 follows 1, and must grow"),
        ({**GOOD, "time": np.array([0.0, 0])}, UsageError, "row 1: time 0 follows 0, and must grow"),
        ({**GOOD, "time": np.array([0.5, 1])}, UsageError, "begins at 0.5 s"),
        ({**GOOD, "time": np.array([0, np.nan])}, UsageError, "row 1: time is nan"),
        ({**GOOD, "ctrl/g": np.array([0, np.inf])}, UsageError, "row 1: ctrl/g is inf"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(columns: dict[str, np.ndarray], kind: type, said: str) -> None:
    with pytest.raises(kind, match=said):
        ControlTable(arm(), columns, "t.csv")


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
