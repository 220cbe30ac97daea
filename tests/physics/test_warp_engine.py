"""Rollouts in MuJoCo Warp against bare loops of MuJoCo, on Warp's CPU device."""

import re

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnstableWorldError, UsageError, spelled
from mjrun.model import state
from mjrun.physics.engine import Engine
from mjrun.physics.stepper import RK4
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_engine import OVERFLOWS, WarpEngine, WarpWorlds, overflow_message
from tests.cases import cases, mjcf

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
pytestmark = pytest.mark.warp
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
    assert isinstance(block.failures[1], UnstableWorldError)
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


# A ball that falls, and stays where it has fallen; and a slider that is pushed.
WORLD = mjcf("ball_and_slide")
WORLDS = 2
LIMITS = {"nconmax": 16, "njmax": 64, "contacts": 17, "constraints": 70, "iterations": 100}


def start(speed: float = 0.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(WORLD)
    data = mujoco.MjData(model)
    data.qvel[2] = speed
    return model, data


def test_rows_with_too_little_memory_are_simulated_again_with_more(engine: WarpEngine) -> None:
    starts, controls = setting()[1:]
    plane = '<geom type="plane" size="5 5 1"/>'
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator="Euler").replace(plane, 2 * plane))
    small = WarpEngine(WarpDevice("cpu"))
    small._limits[model.nbody, model.nv, model.ngeom, model.nflex] = 1, 1
    runs = [list(each.rollout(model, starts, controls, STEPS, FIELDS, every=10)) for each in (engine, small)]
    for exact, repeated in zip(*runs, strict=True):
        assert exact.fields["ncon"].max() == 2
        for name in FIELDS:
            np.testing.assert_array_equal(repeated.fields[name], exact.fields[name])
    assert [*small._limits.values()] == [(2, 8)]  # doubled for 2 contacts with 4 constraints each


def test_a_world_in_which_contacts_were_omitted_fails(engine: WarpEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WarpWorlds, "omissions", lambda self: {2: overflow_message("HFIELD", {})})
    model, starts, controls = setting()
    (block,) = engine.rollout(model, starts, controls, STEPS, ("qpos",), every=10)
    assert block.counts.tolist() == [4, 4, 0]
    assert str(block.failures[2]).startswith("a shape meets too many cells of a height field: ")


def test_states_are_those_that_worlds_were_put_into(device: WarpDevice) -> None:
    model = mujoco.MjModel.from_xml_string(WORLD)
    starts = np.random.default_rng(0).normal(size=(2, state.size(model))).astype(np.float32).astype(float)
    worlds = WarpWorlds(device, model, starts)
    with worlds.active():
        np.testing.assert_array_equal(worlds.states(), starts)


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
    assert message.startswith("a world holds at most 2 constraints; ")
    assert spelled(message).endswith(": raise njmax to 4")  # a pyramid of 4 sides


def test_worlds_that_leave_all_bounds_are_unstable(device: WarpDevice) -> None:
    worlds = worlds_of(device, speed=1e12)
    with worlds.active():
        worlds.step()
        assert worlds.unstable().tolist() == [True] * WORLDS
    model, data = start()
    data.qfrc_applied[2] = 1e11  # the velocity after a step is within bounds, the acceleration is not
    worlds = WarpWorlds(device, model, np.array([state.save(model, data), state.save(*start())]))
    with worlds.active():
        worlds.step()
        assert abs(worlds.read("qvel")).max() < mujoco.mjMAXVAL
        assert worlds.unstable().tolist() == [True, False]


def test_a_feature_that_it_does_not_support_is_named(device: WarpDevice) -> None:
    model, data = start()
    model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
    with pytest.raises(UsageError, match=r"cannot simulate this model: mjSOL_PGS is unsupported\.\nengine c can"):
        WarpWorlds(device, model, state.save(model, data)[None])


def test_delayed_controls_are_refused_where_they_would_differ_from_those_of_mujoco(device: WarpDevice) -> None:
    body = '<body><joint name="j"/><geom size=".1"/></body>'
    motor = '<motor name="m" joint="j" delay="0.01" nsample="5"/>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{body}</worldbody><actuator>{motor}</actuator></mujoco>"
    )
    start = state.save(model, mujoco.MjData(model))[None]
    WarpWorlds(device, model, start)
    model.opt.integrator = RK4
    with pytest.raises(UsageError, match=r"cannot simulate this model: its RK4 reads delayed .*\nengine c can"):
        WarpWorlds(device, model, start)


def test_a_field_that_it_does_not_have_is_refused(device: WarpDevice) -> None:
    with pytest.raises(UsageError, match="does not compute 'qDeriv'\nengine c does"):
        worlds_of(device).require(["qpos", "ncon", "qDeriv"])


def test_every_overflow_that_the_library_knows_has_a_sentence() -> None:
    known = pytest.importorskip("mujoco_warp").OverflowType
    single = {mark.name for mark in known if mark.value and not mark.value & (mark.value - 1)}
    assert single - set(OVERFLOWS) == {"NVMAX"}  # whose limit is that of the model here


def test_each_mark_of_a_world_is_reported_alone(device: WarpDevice) -> None:
    known = pytest.importorskip("mujoco_warp").OverflowType
    worlds = worlds_of(device)
    with worlds.active():
        for bit in range(known.ALL.bit_length()):
            worlds._data.overflow.fill_(1 << bit)
            (message,) = worlds.overflows()
            meaning, _ = OVERFLOWS.get(known(1 << bit).name, ("mujoco_warp reports an overflow: nvmax", ""))
            assert message.startswith(meaning.split("{")[0])


@cases("mark, said")
def test_an_overflow_says_what_is_missing_and_the_remedy(mark: str, said: str) -> None:
    assert re.search(said, spelled(overflow_message(mark, LIMITS)))


def test_every_sentence_can_be_told() -> None:
    assert not any("{" in overflow_message(mark, LIMITS) for mark in OVERFLOWS)
