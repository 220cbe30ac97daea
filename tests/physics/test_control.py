"""Controls from several things at once, against bare loops."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnstableError
from mjrun.physics.control_noise import ControlNoise
from tests.physics.driven_arm import arm, by_instants, periodic, stepped_in_c, stepper, table


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
        stepper(model, table=table(model, [0.0, 0.074], [0.0, 1e9])).advance(200)
    assert caught.value.step == first - 1 == 37
