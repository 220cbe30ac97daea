"""From one place at another."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.pose import Pose
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.rig import ModelCameras, Rig, ShotTime
from mjrun.errors import MjrunError

MODEL = mujoco.MjModel.from_xml_string(
    """
    <mujoco>
      <statistic center="0 0 1" extent="4"/>
      <visual><global azimuth="20" elevation="-10"/></visual>
      <worldbody>
        <body name="box" pos="1 2 3">
          <freejoint/><geom name="edge" pos=".1 0 0" size=".1"/><site name="tip" pos="0 0 .5"/>
          <body name="arm" pos="0 0 1"><joint axis="0 1 0"/><geom size=".1" pos="1 0 0"/></body>
          <camera name="fixed" pos="0 -2 .5" euler="70 10 5"/>
        </body>
        <body name="mark" pos="0 0 1"><geom size=".1"/></body>
      </worldbody>
    </mujoco>
    """
)


CAMERAS_OF_MODEL = ModelCameras(MODEL)


STILL = ShotTime(0.0, 0.0, 0.0)


points = st.tuples(*[st.floats(-3, 3)] * 3)


def moved(yaw: float = 0.0) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    half = math.radians(yaw) / 2
    data.qpos[:] = [4, 5, 6, math.cos(half), 0, 0, math.sin(half), 0.3]
    mujoco.mj_forward(MODEL, data)
    return data


def posed(rig: Rig, time: ShotTime = STILL, data: mujoco.MjData | None = None) -> Pose:
    return rig.bind(CAMERAS_OF_MODEL, "camera a").pose(data or moved(), time)


def at(phase: float, duration: float = 1.0) -> ShotTime:
    return ShotTime(7 + phase * duration, phase * duration, phase)


@given(points, points)
def test_a_look_is_upright_and_meets_its_target(
    eye: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    if np.linalg.norm(np.subtract(eye, target)) < 1e-3:
        return
    pose = posed(LookRig(eye, target))
    assert pose.lookat == pytest.approx(np.array(target), abs=1e-5)
    assert pose.rotation[2, 0] == pytest.approx(0, abs=1e-12)  # what is right in the picture is level
    assert pose.up[2] >= -1e-12


@pytest.mark.parametrize("height", [-2.0, 2.0])
def test_a_look_straight_up_or_down_is_defined(height: float) -> None:
    pose = posed(LookRig((1.0, 1.0, 0.0), (1.0, 1.0, height)))
    assert pose.forward == pytest.approx(np.array([0, 0, math.copysign(1, height)]))
    assert pose.rotation[:, 0] == pytest.approx(np.array([1, 0, 0]))


def test_a_look_at_where_the_camera_is_names_the_time() -> None:
    with pytest.raises(MjrunError, match=r"camera a: at 7\.5 s the camera is at the very point that it looks at"):
        posed(LookRig((4.0, 5.0, 6.0), "box"), at(0.5))
