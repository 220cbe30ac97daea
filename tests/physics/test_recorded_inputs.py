"""Physics under recorded inputs is the recorded simulation, bit for bit."""

from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.model import state
from mjrun.options.simulation import PushKind
from mjrun.outputs.trace_rows import blocks
from mjrun.physics.control import ControlSources, PeriodicController, PushForces
from mjrun.physics.recorded_states import AHEAD, RecordedInputs
from mjrun.physics.stepper import PhysicsStepper
from tests.physics.tumbler import Kept, model

STEP = Fraction(1, 500)
LAST = 240


def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Moves every input, now and then."""
    data.ctrl[:] = np.sin(20 * data.time), data.time
    data.xfrc_applied[2, :3] = [round(3 * data.time), 0, 1]
    data.qfrc_applied[6] = 0.1 * round(5 * data.time)
    data.mocap_pos[0, 2] = round(9 * data.time)


def recorded() -> Kept:
    controller = PeriodicController(act, Fraction(1, 50), STEP)
    data = mujoco.MjData(model())
    data.qvel[:] = 1
    pushes = PushForces(model(), [PushKind()("pelvis=20/0/5@0+0.1"), PushKind()("head=0/9/0@0.2+0.05")], STEP)
    stepper = PhysicsStepper(model(), data, ControlSources(STEP, data.ctrl.copy(), controller=controller), pushes)
    rows = [stepper.state()]
    for step in range(1, LAST + 1):
        stepper.advance(step)
        rows.append(stepper.state())
    return Kept(np.arange(LAST + 1), np.stack(rows))


def again(kept: Kept) -> PhysicsStepper:
    data, inputs = mujoco.MjData(model()), RecordedInputs(model(), kept)
    state.restore(model(), data, kept.state(0))
    return PhysicsStepper(model(), data, ControlSources(STEP, data.ctrl.copy(), inputs, inputs=inputs))


@pytest.mark.parametrize("stride", [1, 7, LAST])
def test_physics_under_recorded_inputs_is_the_recorded_simulation(stride: int) -> None:
    kept = recorded()
    stepper = again(kept)
    for step in range(0, LAST + 1, stride):
        stepper.advance(step)
        assert stepper.state().tobytes() == kept.rows[step].tobytes(), step


def test_so_it_is_in_c() -> None:
    kept = recorded()
    qpos = np.concatenate([block["qpos"][0] for _, _, block in blocks(again(kept), ["qpos"], LAST, 32)])
    assert qpos.tobytes() == kept.rows[:, state.fields(state.sizes(model()))["qpos"]].tobytes()


def test_the_last_inputs_hold_to_the_end() -> None:
    kept = recorded()
    inputs = RecordedInputs(model(), kept)
    assert np.array_equal(inputs.at(10 * LAST), inputs.at(LAST))
    assert inputs.next_change(LAST) == LAST + AHEAD
    stepper = again(kept)
    stepper.advance(LAST + 20)
    bare = mujoco.MjData(model())
    state.restore(model(), bare, kept.state(LAST))
    mujoco.mj_step(model(), bare, 20)
    assert stepper.state().tobytes() == state.save(model(), bare).tobytes()
