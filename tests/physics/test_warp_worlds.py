"""Worlds in MuJoCo Warp against a bare loop of MuJoCo, on Warp's CPU device; and what is said where it cannot."""

import re

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError, spelled
from mjrun.model import state
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_worlds import OVERFLOWS, WarpWorlds, overflow_message

# A ball that falls, and stays where it has fallen; and a slider that is pushed.
MODEL = """
<mujoco>
  <option timestep=".01"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .5"><freejoint/><geom size=".1"/></body>
    <body pos="2 0 5"><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor name="m" joint="x"/></actuator>
</mujoco>
"""
WORLDS = 2
LIMITS = {"nconmax": 16, "njmax": 64, "contacts": 17, "constraints": 70, "iterations": 100}


def start(speed: float = 0.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qvel[2] = speed
    return model, data


@pytest.fixture(scope="module")
def device() -> WarpDevice:
    pytest.importorskip("mujoco_warp")
    return WarpDevice("cpu")


def worlds_of(device: WarpDevice, njmax: int | None = None, **changed: float) -> WarpWorlds:
    model, data = start(**changed)
    return WarpWorlds(device, model, np.tile(state.save(model, data), (WORLDS, 1)), njmax=njmax)


def test_without_controls_all_worlds_are_alike_and_fall_as_galilei_has_it(device: WarpDevice) -> None:
    worlds, steps = worlds_of(device), 25
    with worlds.active():
        for _ in range(steps):
            worlds.step()
        qpos = worlds.read("qpos")
    np.testing.assert_array_equal(qpos[0], qpos[1])
    # Semi-implicit Euler: h g (1 + 2 + … + n) h below where it was.
    fallen = 9.81 * 0.01**2 * steps * (steps + 1) / 2
    np.testing.assert_allclose(qpos[0, 2], 0.5 - fallen, atol=1e-6)


def test_every_world_starts_where_it_is_told_and_can_start_again(device: WarpDevice) -> None:
    model, data = start()
    rng = np.random.default_rng(0)
    starts = []
    for _ in range(3):
        data.qvel[:], data.ctrl[:], data.qfrc_applied[:] = rng.normal(size=model.nv), rng.normal(), 0.1
        starts.append(state.save(model, data))
    worlds = WarpWorlds(device, model, np.array(starts))
    with worlds.active():
        for _ in range(2):
            worlds.restart()
            for index, row in enumerate(starts):
                state.restore(model, data, row)
                for name in ("qpos", "qvel", "ctrl", "qfrc_applied"):
                    np.testing.assert_allclose(worlds.read(name)[index], getattr(data, name), atol=1e-6)
            worlds.step()


def test_what_does_not_fit_is_told_with_what_to_raise(device: WarpDevice) -> None:
    narrow, most = worlds_of(device, njmax=2), 0
    with narrow.active():
        for _ in range(45):
            narrow.step()
            most = max(most, int(narrow.demand().constraints.max()))
        (message,) = narrow.overflows(constraints=most)
    assert message.startswith("there is room for 2 constraints in a world; ")
    assert spelled(message).endswith(": raise njmax to 4")  # a pyramid of 4 sides


def test_worlds_that_leave_all_bounds_are_unstable(device: WarpDevice) -> None:
    worlds = worlds_of(device, speed=1e12)
    with worlds.active():
        worlds.step()
        assert worlds.unstable().tolist() == [True] * WORLDS


def test_a_feature_that_it_does_not_support_is_named(device: WarpDevice) -> None:
    model, data = start()
    model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
    with pytest.raises(UsageError, match=r"cannot simulate this model: mjSOL_PGS is unsupported\.\nengine c can"):
        WarpWorlds(device, model, state.save(model, data)[None])


def test_a_field_that_it_does_not_have_is_refused(device: WarpDevice) -> None:
    with pytest.raises(UsageError, match="does not compute 'qDeriv'\nengine c does"):
        worlds_of(device).require(["qpos", "ncon", "qDeriv"])


def test_every_overflow_that_the_library_knows_has_a_sentence() -> None:
    known = pytest.importorskip("mujoco_warp").OverflowType
    single = {mark.name for mark in known if mark.value and not mark.value & (mark.value - 1)}
    assert single - set(OVERFLOWS) == {"NVMAX"}  # whose limit is that of the model here


@pytest.mark.parametrize(
    ("mark", "said"),
    [
        ("NEFC", "^there is room for 64 constraints in a world; .*: raise njmax to 70$"),
        ("BROADPHASE", "^there is room for 16 contacts in a world; .*: raise nconmax to 17$"),
        ("CCD", "raise nconmax above 16"),
        ("ITERATIONS", "limit of 100 iterations: raise set opt.iterations"),
        ("NEW_ONE", "^mujoco_warp has no room: new_one overflow$"),
    ],
)
def test_an_overflow_says_what_is_missing_and_the_remedy(mark: str, said: str) -> None:
    assert re.search(said, spelled(overflow_message(mark, LIMITS)))


def test_every_sentence_can_be_told() -> None:
    assert not any("{" in overflow_message(mark, LIMITS) for mark in OVERFLOWS)
