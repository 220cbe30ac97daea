"""Rollouts in MuJoCo Warp against bare loops of MuJoCo, on Warp's CPU device."""

import mujoco
import numpy as np
import pytest

from mjrun.model import state
from mjrun.physics.engine import Engine
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_engine import WarpEngine

MODEL = """
<mujoco>
  <option timestep=".01" integrator="{integrator}"><flag energy="enable"/></option>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .3"><freejoint/><geom size=".1"/></body>
    <body pos="2 0 5"><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor name="m" joint="x"/></actuator>
  <sensor><jointpos joint="x"/></sensor>
</mujoco>
"""
FIELDS = ("qpos", "qvel", "ctrl", "xpos", "xmat", "energy", "ncon", "sensordata")
STEPS, N = 30, 3


@pytest.fixture(scope="module")
def engine() -> WarpEngine:
    pytest.importorskip("mujoco_warp")
    return WarpEngine(WarpDevice("cpu"))


def setting(integrator: str = "Euler") -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """A model, starts with different speeds, and controls."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator=integrator))
    data, starts = mujoco.MjData(model), []
    for index in range(N):
        data.qvel[0] = index
        starts.append(state.save(model, data))
    return model, np.array(starts), np.random.default_rng(1).normal(size=(N, STEPS, 1))


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_every_row_is_an_instant_of_a_bare_loop(engine: Engine, integrator: str) -> None:
    model, starts, controls = setting(integrator)
    blocks = list(engine.rollout(model, starts, controls, STEPS, FIELDS, every=7))
    assert np.concatenate([block.steps for block in blocks]).tolist() == [0, 7, 14, 21, 28, 30]
    assert all((block.counts == len(block.steps)).all() for block in blocks)
    touched = 0
    for index in range(N):
        data = mujoco.MjData(model)
        state.restore(model, data, starts[index])
        rows = iter(range(6))
        for step in range(STEPS + 1):
            data.ctrl[:] = controls[index, min(step, STEPS - 1)]
            mujoco.mj_forward(model, data)
            if step % 7 == 0 or step == STEPS:
                row = next(rows)
                touched += data.ncon
                for name in FIELDS:
                    values = np.concatenate([block.fields[name] for block in blocks], axis=1)[index, row]
                    np.testing.assert_allclose(values, getattr(data, name), atol=2e-4, err_msg=name)
            mujoco.mj_step(model, data)
    assert touched > 0


def test_a_world_that_fails_ends_while_the_others_go_on(engine: Engine) -> None:
    model, starts, controls = setting()
    data = mujoco.MjData(model)
    data.qvel[2] = 1e12
    starts[1] = state.save(model, data)
    (block,) = engine.rollout(model, starts, controls, STEPS, ("qpos",), every=10)
    assert list(block.failures) == [1]
    assert (block.failures[1].step, block.counts.tolist()) == (0, [4, 0, 4])
    assert np.isfinite(block.fields["qpos"][[0, 2]]).all()


def test_every_world_has_the_numbers_of_its_own_model(engine: Engine) -> None:
    starts, models = setting()[1], []
    for mass, friction, gear, gravity in ((1, 0.1, 1, -9), (2, 0.5, 3, -10), (3, 0.9, 5, -11)):
        spec = mujoco.MjSpec.from_string(MODEL.format(integrator="Euler"))
        spec.option.gravity = [0, 0, gravity]
        for body in spec.bodies[1:]:
            body.geoms[0].mass = mass
        spec.geoms[1].friction[0] = friction
        spec.actuators[0].gear[0] = gear
        models.append(spec.compile())
    controls = np.random.default_rng(1).normal(size=(N, STEPS, 1))
    (block,) = engine.rollout(models, starts, controls, STEPS, ("qpos", "qvel"))
    for index, model in enumerate(models):
        data = mujoco.MjData(model)
        state.restore(model, data, starts[index])
        for step in range(STEPS):
            data.ctrl[:] = controls[index, step]
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(block.fields["qpos"][index, -1], data.qpos, atol=2e-4)
        np.testing.assert_allclose(block.fields["qvel"][index, -1], data.qvel, atol=2e-3)
