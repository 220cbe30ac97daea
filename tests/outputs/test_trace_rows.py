"""Rows of a table: read in blocks, at single instants and from a recording, they are the same to the last bit."""

import mujoco
import numpy as np
import pytest

from mjrun.outputs.event_detection import EventDetector
from mjrun.outputs.overlay_probes import overlay_probes
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.observe import observe
from mjrun.physics.replay import ReplayStepper
from mjrun.physics.state_buffer import StateBuffer
from mjrun.physics.stepper import PhysicsStepper
from mjrun.timeline import Timeline, rational

MODEL = """
<mujoco>
  <option integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .12"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 1"><joint name="h" axis="0 1 0" damping=".3"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
</mujoco>
"""
PROBES = ("qpos", "qvel", "energy", "contact", "speed", "momentum", "xmat")
STEPS = 400


def table_of(integrator: str = "Euler") -> ProbeSampler:
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator=integrator))
    return ProbeSampler(model, PROBES, Timeline.of_steps(rational(model.opt.timestep), STEPS))


def stepper_of(table: ProbeSampler) -> PhysicsStepper:
    return PhysicsStepper(table.model, mujoco.MjData(table.model))


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_single_instant_is_the_row_of_the_whole_table(integrator: str) -> None:
    table = table_of(integrator)
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    drift = [column.name for column in table.columns].index("energy/drift")
    assert whole[0, drift] == 0
    assert whole[-1, drift] < -0.01  # damping takes it
    recorded = stepper_of(table)
    with StateBuffer(table.model) as states:
        for step in range(STEPS + 1):
            recorded.advance(step)
            states.append(recorded.state())
        for step in (0, 3, 150, STEPS):
            for stepper in (stepper_of(table), ReplayStepper(table.model, states)):
                stepper.advance(step)
                assert table.read(stepper).values.tobytes() == whole[step, 1:].tobytes()


def test_text_over_one_late_image_says_what_the_trace_says() -> None:
    table = table_of()
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), [0, 150, STEPS])])
    drift = [column.name for column in table.columns].index("energy/drift")
    timeline = Timeline.of_steps(rational(table.model.opt.timestep), STEPS)
    overlay = overlay_probes(table.model, timeline, "{energy/drift:.17g}")
    stepper = PhysicsStepper(overlay.model, mujoco.MjData(overlay.model))
    stepper.advance(150)
    (values,) = overlay.read(stepper)
    assert values.tolist() == [whole[1, drift]]
    assert values[0] < 0


def test_an_event_sees_the_drift_since_the_start() -> None:
    table = table_of()
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    drift = whole[:, [column.name for column in table.columns].index("energy/drift")]
    limit = float(drift[200])
    detector = EventDetector(table.model, Timeline.of_steps(rational("0.002"), STEPS), [f"energy/drift < {limit!r}"])
    observe(stepper_of(table), detector.taps(STEPS), STEPS)
    (steps,) = detector.event_steps.values()
    assert steps[0] == int(np.argmax(drift < limit)) > 0
    detector.close()


def test_an_event_may_be_about_energy_in_a_model_that_leaves_it_out() -> None:
    table = table_of()
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    kinetic = whole[:, [column.name for column in table.columns].index("energy/kinetic")]
    limit = float(kinetic[60])
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator="Euler"))
    detector = EventDetector(model, Timeline.of_steps(rational("0.002"), STEPS), [f"energy/kinetic > {limit!r}"])
    observe(PhysicsStepper(model, mujoco.MjData(model)), detector.taps(STEPS), STEPS)
    (steps,) = detector.event_steps.values()
    assert steps[0] == int(np.argmax(kinetic > limit)) > 0
    detector.close()
