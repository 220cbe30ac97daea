"""Simulations that are stepped in threads are those of `mujoco.batch`, to the last bit."""

from typing import Any

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch, SimulationError

from mjrun.task.batch_columns import MjDataBatch

BALLS = """<mujoco><size memory="MEMORY"/><option integrator="INTEGRATOR"/><worldbody><geom type="plane" size="5 5 1"/>
<replicate count="4" offset=".15 0 .05"><body pos="0 0 .3"><freejoint/><geom size=".1"/></body></replicate>
<body pos="0 1 1"><joint name="hinge" axis="0 1 0"/><geom type="capsule" size=".05 .2" pos="0 0 .3"/></body>
</worldbody><actuator><motor joint="hinge"/></actuator><sensor><accelerometer site="s"/></sensor></mujoco>"""
BALLS = BALLS.replace("<joint name", '<site name="s"/><joint name')
COUNT, FIELDS = 5, ("xpos", "qacc", "sensordata", "ncon", "cvel", "xfrc_applied", "time")


def model_of(integrator: str = "Euler", memory: str = "1M", mass: float = 1.0) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(BALLS.replace("INTEGRATOR", integrator).replace("MEMORY", memory))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    model.body_mass[-1] *= mass
    return model


def started(batch: Any) -> Any:
    """Binds the fields, and starts every simulation differently, one far too fast."""
    for field in FIELDS:
        batch.bind(field)
    batch.bind("qvel")[:] = np.random.default_rng(1).normal(size=batch.bind("qvel").shape)
    batch.bind("qvel")[3] *= 1e9
    batch.bind("xfrc_applied")[:, 2, 1] = 7
    return batch


def assert_equal(ours: MjDataBatch, theirs: Batch) -> None:
    np.testing.assert_array_equal(ours.state, theirs.state)
    np.testing.assert_array_equal(ours.warning[..., 1] > 0, theirs.warning[..., 1] > 0)
    for field in FIELDS:
        np.testing.assert_array_equal(ours.bind(field), theirs.bind(field))


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize(("threads", "persistent"), [(1, False), (3, False), (2, True)])
def test_simulations_are_those_of_mujocos_batch(integrator: str, threads: int, persistent: bool) -> None:
    models = [model_of(integrator, mass=1 + world * persistent) for world in range(COUNT)]
    ours = started(MjDataBatch(models[0], COUNT, threads, persistent))
    theirs = started(Batch(models[0], COUNT, 1, persistent=True))
    if persistent:
        ours.set_models(models)
        theirs.set_models(models)
    forces = np.zeros((COUNT, mujoco.MjData(models[0]).cfrc_int.size))

    def examine(world: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        mujoco.mj_rnePostConstraint(model, data)
        forces[world] = data.cfrc_int.ravel()

    ours.examine = examine
    some = np.array([1, 3, 4])
    calls = [
        ("forward", None, 3),
        ("step", None, 5, 0),
        ("step", some, 2, 3),
        ("forward", some, 3),
        ("step", None, 20, 3),
    ]
    for number, (name, *arguments) in enumerate(calls):
        for batch in (ours, theirs):
            batch.bind("ctrl")[:] = np.sin(number)
            getattr(batch, name)(*arguments)
        assert_equal(ours, theirs)
        for world in range(COUNT) if arguments[0] is None else some:
            data = theirs.get_data(int(world))
            mujoco.mj_rnePostConstraint(models[world], data)
            np.testing.assert_array_equal(forces[world], data.cfrc_int.ravel())
    assert ours.warning[3, :, 1].any()
    assert not ours.warning[:3, :, 1].any()


def test_an_error_leaves_the_state_of_its_simulation() -> None:
    small = model_of(memory="5K")  # enough for balls in the air
    batches = started(MjDataBatch(small, COUNT, 2, persistent=False)), started(Batch(small, COUNT, 2, persistent=True))
    for batch in batches:
        batch.bind("qvel")[3] = 0
        batch.bind("qpos")[2, 2:28:7] = 0.05  # which touch the floor and each other
        before = batch.state[2].copy()
        with pytest.raises(SimulationError) as raised:
            batch.step(None, 3, 3)
        assert raised.value.ids.tolist() == [2]
        np.testing.assert_array_equal(batch.state[2], before)
    np.testing.assert_array_equal(batches[0].state, batches[1].state)
