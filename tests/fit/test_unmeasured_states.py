"""What is not measured is where a bare loop has it."""

import mujoco
import numpy as np
import pytest

from mjrun.fit.prediction import chunks
from mjrun.fit.unmeasured_states import simulated_starts
from mjrun.model import state
from tests.fit.cart import TRUTH, cart_log, cart_shooting


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
