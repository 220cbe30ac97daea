"""Hidden sensors make MuJoCo compute what a step leaves out, and change nothing else."""

import mujoco
import numpy as np
import pytest

from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.task.hidden_sensors import SENSED, SensingSource, can_sense


@pytest.mark.parametrize("field", SENSED)
def test_a_step_leaves_the_field_as_mujocos_own_function_gives_it(field: str) -> None:
    source = parse_source("scene:dominos", [Override("opt.gravity", "0 0 -5")])
    plain = source.load()
    sensing = SensingSource(source, (field,)).load()
    assert sensing.nsensor == plain.nsensor + 1
    data, other = mujoco.MjData(plain), mujoco.MjData(sensing)
    data.qvel[:] = other.qvel[:] = np.random.default_rng(0).normal(0, 0.05, plain.nv)
    for _ in range(80):
        mujoco.mj_step(plain, data)
        mujoco.mj_step(sensing, other)
    np.testing.assert_array_equal(data.qpos, other.qpos)

    mujoco.mj_forward(plain, data)
    mujoco.mj_forward(sensing, other)
    mujoco.mj_rnePostConstraint(plain, data)
    mujoco.mj_subtreeVel(plain, data)
    assert np.any(getattr(data, field))
    np.testing.assert_array_equal(getattr(data, field), getattr(other, field))


def test_contact_forces_are_left_as_gymnasium_computes_them_after_a_step() -> None:
    source = parse_source("scene:dominos")
    plain, sensing = source.load(), SensingSource(source, ("cfrc_ext",)).load()
    data, other = mujoco.MjData(plain), mujoco.MjData(sensing)
    for _ in range(50):
        mujoco.mj_step(plain, data)
        mujoco.mj_step(sensing, other)
        mujoco.mj_rnePostConstraint(plain, data)
        np.testing.assert_array_equal(data.cfrc_ext, other.cfrc_ext)
    assert np.any(other.cfrc_ext)


def test_compiled_models_and_those_without_sensors_cannot_sense() -> None:
    source = parse_source("scene:pendulum")
    spec, model = source.compile()
    assert can_sense(spec, model)
    assert not can_sense(None, model)
    assert not can_sense(*parse_source("scene:pendulum", [Override("opt.flag.sensor", "disable")]).compile())
