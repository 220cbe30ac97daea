"""Recorded runs are stepped again to the last bit; a bit that was flipped in one of their states is found there."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import FailedStepError
from mjrun.model import state
from mjrun.options.push import PushKind
from mjrun.physics.control import ControlSignal
from mjrun.physics.controller import PeriodicController
from mjrun.physics.native_rollout import blocks
from mjrun.physics.push_forces import PushForces
from mjrun.physics.stepper import PhysicsStepper
from mjrun.physics.verification import first_difference
from mjrun.timeline import rational
from tests.physics.test_replay import DELAYED, PLUGIN, SLEEPY, TUMBLE, Kept, live, recorded, wave

STEPS = 120
TUMBLER = mujoco.MjModel.from_xml_string(TUMBLE.format("Euler"))


def run(model: mujoco.MjModel, steps: Sequence[int] = range(STEPS + 1), driven: bool = False) -> Kept:
    return recorded(live(model, controller=wave if driven else None), steps)[0]


@pytest.mark.parametrize(
    ("source", "driven"),
    [
        *((TUMBLE.format(integrator), True) for integrator in ("Euler", "RK4", "implicit", "implicitfast")),
        (DELAYED, True),
        (PLUGIN, False),
        (SLEEPY, False),
        (SLEEPY, True),
    ],
)
def test_a_run_is_stepped_again_to_the_last_bit(source: str, driven: bool) -> None:
    model = mujoco.MjModel.from_xml_string(source)
    steps = range(700 if source == SLEEPY else STEPS + 1)
    assert first_difference(model, run(model, steps, driven), steps[-1]) is None


def test_a_run_that_is_pushed_by_many_and_recorded_in_c_is_stepped_again() -> None:
    model, timestep = TUMBLER, rational(TUMBLER.opt.timestep)
    pushes = PushForces(model, [PushKind()("body:1=0/3/0@0.03+0.1"), PushKind()("site:arm=1/0/0@0.1+0.05")], timestep)
    controller = PeriodicController(wave, Fraction(1, 50), timestep)
    control = ControlSignal(timestep, np.zeros(model.nu), controller=controller)
    stepper = PhysicsStepper(model, mujoco.MjData(model), control, pushes)
    rows = [stepper.state()]
    for _ in range(STEPS):
        for _ in blocks(stepper, ["qpos"], 1):
            pass
        rows.append(stepper.state())
    kept = Kept(np.arange(STEPS + 1), np.stack(rows))
    forces = kept.rows[:, state.fields(state.sizes(model))["xfrc_applied"]]
    assert len(np.unique(forces, axis=0)) > 20
    assert first_difference(model, kept, STEPS) is None


@given(st.integers(1, STEPS), st.sampled_from(["qpos", "qvel", "act", "time", "qacc_warmstart"]), st.data())
@settings(deadline=None, max_examples=40)
def test_a_bit_that_was_flipped_is_found_in_its_step_and_place(step: int, field: str, data: st.DataObject) -> None:
    kept = run(TUMBLER, driven=True)
    part = state.fields(state.sizes(TUMBLER))[field]
    place, bit = data.draw(st.integers(part.start, part.stop - 1)), data.draw(st.integers(0, 63))
    rows = kept.rows.copy()
    rows.view(np.uint64)[step, place] ^= np.uint64(1) << np.uint64(bit)

    found = first_difference(TUMBLER, replace(kept, rows=rows), STEPS)
    assert found
    assert (found.index, found.step) == (step, step)
    assert np.flatnonzero(found.recorded.view(np.uint64) != found.stepped.view(np.uint64)).tolist() == [place]
    assert found.stepped.tobytes() == kept.rows[step].tobytes()
    assert first_difference(TUMBLER, replace(kept, rows=rows), step - 1) is None


def test_controls_that_were_changed_are_found_a_step_later() -> None:
    kept = run(TUMBLER, driven=True)
    rows = kept.rows.copy()
    rows[50, state.controls(TUMBLER)] += 1
    found = first_difference(TUMBLER, replace(kept, rows=rows), STEPS)
    assert found
    assert found.step == 51


@pytest.mark.parametrize("every", [1, 2, 7])
def test_a_recording_of_some_steps_is_verified_at_those(every: int) -> None:
    steps = range(0, STEPS + 1, every)
    kept = run(TUMBLER, steps)
    assert first_difference(TUMBLER, kept, len(steps) - 1) is None
    rows = kept.rows.copy()
    rows[5, 1] += 1e-15
    found = first_difference(TUMBLER, replace(kept, rows=rows), len(steps) - 1)
    assert found
    assert (found.index, found.step) == (5, 5 * every)


def test_progress_is_told_and_the_model_is_left_alone() -> None:
    model, told = mujoco.MjModel.from_xml_string(TUMBLE.format("Euler")), list[int]()
    flags = model.opt.disableflags
    assert first_difference(model, run(model, range(2001)), 2000, told.append) is None
    assert told == [1000, 2000]
    assert model.opt.disableflags == flags


def test_physics_that_fails_is_told_with_its_step() -> None:
    spheres = "".join(f'<body pos="{x / 8} 0 .06"><freejoint/><geom size=".05"/></body>' for x in range(6))
    text = '<mujoco><size memory="{}"/><worldbody><geom type="plane" size="1 1 1"/>{}</worldbody></mujoco>'
    kept = run(mujoco.MjModel.from_xml_string(text.format("1M", spheres)))
    with pytest.raises(FailedStepError) as caught:
        first_difference(mujoco.MjModel.from_xml_string(text.format("20K", spheres)), kept, STEPS)
    assert 0 < caught.value.step < STEPS
