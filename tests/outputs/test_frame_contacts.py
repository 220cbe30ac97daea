"""Contacts of frames, against MuJoCo's own functions."""

import mujoco
import numpy as np
import pytest

from mjrun.outputs.export import BLOCK, ContactRecorder
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import PhysicsStepper

MODEL = """
<mujoco>
  <option cone="{cone}"/>
  <worldbody>
    <geom type="plane" size="1 1 .1" euler="0 10 0"/>
    <body pos="0 0 .2"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
    <body pos="0 0 .4"><freejoint/><geom size=".05" condim="1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_positions_normals_and_forces_are_those_of_mujoco(cone: str) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(cone=cone))
    frames = range(0, 3 * BLOCK + 10, 2)
    recorder = ContactRecorder(model)
    run_with_taps(PhysicsStepper(model, mujoco.MjData(model)), [Tap(frames, recorder.record)], frames[-1])
    found = recorder.contacts(len(frames) - 1)
    recorder.close()

    data, counts, rows = mujoco.MjData(model), list[int](), list[np.ndarray]()
    for step in range(frames[-1]):
        mujoco.mj_forward(model, data)
        if step in frames:
            counts.append(data.ncon)
            for index, contact in enumerate(data.contact):
                wrench, axes = np.zeros(6), contact.frame.reshape(3, 3)
                mujoco.mj_contactForce(model, data, index, wrench)
                rows.append(np.concatenate([contact.pos, axes[0], wrench[:3] @ axes]))
        mujoco.mj_step(model, data)
    assert found.counts.tolist() == counts
    assert sum(counts) > 100
    np.testing.assert_allclose(found.values, np.array(rows), atol=2e-4)
