"""Initial states against those of a bare loop."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.fitting.measurements import LogSegment
from mjrun.fitting.prediction import chunks
from mjrun.fitting.starting_states import StateGuesses, simulated_starts
from mjrun.model import state
from mjrun.model.sources import parse_source
from tests.fitting.cart import TRUTH, cart_log, cart_shooting
from tests.fitting.logs import simulate, write_model


def guess(
    model: mujoco.MjModel, signals: list[str], times: np.ndarray, values: np.ndarray, noise: np.ndarray | None = None
) -> mujoco.MjData:
    data = mujoco.MjData(model)
    starting = StateGuesses(model, signals, state.save(model, data), noise)
    parts = chunks([LogSegment("log", times, values, np.zeros((len(times), model.nu)))], 30, model.opt.timestep)
    state.restore(model, data, starting.guess(parts[1], model.opt.timestep))
    return data


def test_positions_give_velocities(tmp_path: Path) -> None:
    model = parse_source(str(write_model(tmp_path))).load()
    times, angles = simulate(1.0, every=1)
    data = guess(model, ["qpos/hinge"], times[::5], angles[::5, None])
    row = 5 * round((len(times[::5]) - 1) / round((len(times[::5]) - 1) / 30))
    rates = np.gradient(angles, times)
    assert data.qpos[0] == pytest.approx(angles[row], abs=2e-3)
    assert data.qvel[0] == pytest.approx(rates[row], abs=0.2)


@pytest.mark.parametrize("row", range(9))
def test_an_outlier_does_not_change_a_guess(tmp_path: Path, row: int) -> None:
    """The angle jerks after 12 rows, so that no longer window has a parabola."""
    model = parse_source(str(write_model(tmp_path))).load()
    times = np.arange(60) * 0.01
    values = 0.3 + 2 * times + 40 * np.maximum(times - 0.42, 0)
    values[30 + row] += 0.05
    data = guess(model, ["qpos/hinge"], times, values[:, None], np.array([1e-3]))
    assert data.qpos[0] == pytest.approx(0.9, abs=1e-6)
    assert data.qvel[0] == pytest.approx(2, abs=1e-4)


def test_beside_an_impact_the_first_sample_counts(tmp_path: Path) -> None:
    """No parabola explains nine rows of a bounce to the noise."""
    model = parse_source(str(write_model(tmp_path))).load()
    times = np.arange(60) * 0.01
    values = np.abs(times - 0.33)
    data = guess(model, ["qpos/hinge"], times, values[:, None], np.array([1e-6]))
    assert data.qpos[0] == pytest.approx(values[30], abs=1e-12)


def test_measured_velocities_count_as_they_are(tmp_path: Path) -> None:
    model = parse_source(str(write_model(tmp_path))).load()
    times = np.arange(60) * 0.01
    data = guess(model, ["qpos/hinge", "qvel/hinge"], times, np.column_stack([times, 7 + 0 * times]))
    assert data.qvel[0] == pytest.approx(7)


def test_samples_that_are_missing_are_passed_over_and_joints_that_are_not_measured_stay() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="a"/><joint name="b" axis="1 0 0"/><geom size=".1"/></body></worldbody>'
        "</mujoco>"
    )
    times = np.arange(60) * 0.01
    values = np.column_stack([3 * times])
    values[30:33] = np.nan
    data = guess(model, ["qpos/a"], times, values)
    row = round(59 / 2)
    assert data.qpos[0] == pytest.approx(3 * times[row], abs=0.02)
    assert data.qvel[0] == pytest.approx(3)
    assert data.qpos[1] == data.qvel[1] == 0


def test_what_is_not_measured_follows_from_the_commands() -> None:
    log, rows = cart_log()
    _, predictor, starting, _ = cart_shooting()
    assert not starting.all_measured
    parts = chunks([log], 40, predictor.timestep)
    starts = simulated_starts(predictor, starting, parts, TRUTH)
    data = mujoco.MjData(predictor.model)
    for part, start in list(zip(parts, starts, strict=True))[2:]:  # by then the start is forgotten
        state.restore(predictor.model, data, start)
        assert data.qpos[1] == pytest.approx(rows[part.rows.start, 1], abs=1e-2)
        assert data.qvel == pytest.approx(rows[part.rows.start, 2:], abs=0.15)


@pytest.mark.parametrize("gear", [1e200, 1e300])  # unstable; refused by the compiler
def test_where_nothing_can_be_simulated_the_rest_is_as_at_the_start(gear: float) -> None:
    log, _ = cart_log()
    _, predictor, starting, _ = cart_shooting()
    parts = chunks([log], 40, predictor.timestep)
    data = mujoco.MjData(predictor.model)
    state.restore(predictor.model, data, simulated_starts(predictor, starting, parts, (TRUTH[0], gear))[-1])
    assert np.isfinite(data.qpos).all()
    assert data.qpos[0] == data.qvel[0] == 0
