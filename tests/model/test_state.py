"""Theorems about the integration state: a simulation goes on from it bit for bit."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.model import state
from tests.cases import mjcf

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.xml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_restored_simulation_continues_bit_for_bit(path: Path) -> None:
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


CROWDED = mjcf("crowded_state")


def test_every_number_of_a_state_belongs_to_the_field_that_it_is_read_from() -> None:
    model = mujoco.MjModel.from_xml_string(CROWDED)
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    numbers = random.standard_normal(state.size(model))
    slices = state.fields(state.sizes(model))
    numbers[slices["eq_active"]] = 1
    state.restore(model, data, numbers)

    for name, part in slices.items():
        assert np.array_equal(np.ravel(getattr(data, name)), numbers[part]), name
    covered = np.concatenate([np.arange(part.start, part.stop) for part in slices.values()])
    assert np.array_equal(covered, np.arange(state.size(model)))
    assert list(slices) == [name for name in state.FIELDS if name != "plugin_state"]


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_the_fields_of_a_state_are_all_of_it(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    slices = [*state.fields(state.sizes(model)).values()]
    assert slices[0] == slice(0, 1)
    assert slices[-1].stop == state.size(model)
