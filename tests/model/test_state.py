"""Theorems about the integration state: a simulation goes on from it bit for bit."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.model import state

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.xml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_restored_simulation_goes_on_bit_for_bit(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    first, second = mujoco.MjData(model), mujoco.MjData(model)
    first.ctrl[:] = 0.1
    mujoco.mj_step(model, first, nstep=50)
    saved = state.save(model, first)
    assert saved.shape == (state.size(model),)
    assert np.array_equal(saved[state.controls(model)], first.ctrl)

    state.restore(model, second, saved)
    for data in (first, second):
        mujoco.mj_step(model, data, nstep=50)
    assert np.array_equal(state.save(model, first), state.save(model, second))


def test_a_part_of_a_state_is_restored_alone() -> None:
    model = mujoco.MjModel.from_xml_path(str(SCENES[0]))
    source, target = mujoco.MjData(model), mujoco.MjData(model)
    source.ctrl[:], source.qpos[:] = 1, 2
    state.restore(model, target, state.save(model, source, state.CTRL), state.CTRL)
    assert (target.ctrl == 1).all()
    assert np.array_equal(target.qpos, mujoco.MjData(model).qpos)
