"""Camera scripts as values: what is not given changes nothing, and other processes get the same."""

import pickle
from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.camera.easing import Blend, Ramp
from mjrun.camera.motion import CameraMotion
from mjrun.camera.rigs.around import FreeRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import LEVEL, CameraScript, Event, Fit, Shot
from mjrun.camera.shake import Shake
from mjrun.model.state import save

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><camera name="side" pos="0 -2 1" xyaxes="1 0 0 0 .5 1" fovy="40"/>
    <body name="box"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
)
SIZE = (64, 48)


def test_a_shot_is_that_of_its_rig_alone() -> None:
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    pose = CameraMotion(CameraScript("a", [Shot(ModelRig("side"))]), MODEL, SIZE).pose(save(MODEL, data))
    assert pose.position == pytest.approx(data.cam_xpos[0])
    assert pose.rotation == pytest.approx(data.cam_xmat[0].reshape(3, 3))
    assert pose.frustum.fovy == pytest.approx(MODEL.cam_fovy[0])


@pytest.mark.parametrize("phase", [0.0, 0.3, 1.0])
def test_a_shot_is_level_at_every_time(phase: float) -> None:
    assert LEVEL.at(phase) == 0


def test_an_event_is_the_first_of_its_kind_as_it_happens_and_must_happen() -> None:
    assert Event("speed(box) > 0.02") == Event("speed(box) > 0.02", nth=1, offset=Fraction(0), otherwise=None)


def test_a_script_is_the_same_in_another_process() -> None:
    free = FreeRig((0, 0, 0), Ramp.still(2.0), Ramp(0.0, 90.0, "cosine"), Ramp.still(-20.0))
    script = CameraScript(
        "around",
        [
            Shot(ModelRig("side"), until=Event("speed(box) > 1", 2, Fraction(1, 3), "end"), speed=Fraction(1, 2)),
            Shot(free, lasting=Fraction(2), blend=Blend("sigmoid", 0.5), fovy=Ramp.still(30.0), shake=Shake(0.5)),
            Shot(free, roll=Ramp(0.0, 10.0, "linear"), fit=Fit("box")),
        ],
    )
    again = pickle.loads(pickle.dumps(script))
    assert again == script
    states = [save(MODEL, mujoco.MjData(MODEL))] * 3
    times, spans = [0.0, 1.0, 2.5], [(0.0, 0.5), (0.5, 2.0), (2.0, 3.0)]
    here, there = (list(CameraMotion(each, MODEL, SIZE).poses(states, times, times, spans)) for each in (script, again))
    for mine, theirs in zip(here, there, strict=True):
        assert np.array_equal(mine.position, theirs.position)
        assert np.array_equal(mine.rotation, theirs.rotation)
        assert mine.frustum == theirs.frustum
