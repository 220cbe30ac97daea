"""A model that every kind of rig can look at, and the poses of rigs in it."""

import math

import mujoco
import pytest

from mjrun.camera.pose import CameraPose, pose_of
from mjrun.camera.rigs.rig import MujocoCameras, Rig, ShotTime

SENSOR = 'resolution="320 240" sensorsize=".0064 .0048"'
CAMERAS = {
    "fixed": 'fovy="30"',
    "track": 'mode="track"',
    "trackcom": 'mode="trackcom"',
    "targetbody": 'mode="targetbody" target="mark"',
    "targetbodycom": 'mode="targetbodycom" target="mark"',
    "focal": f'{SENSOR} focal=".008 .009" principal=".0004 -.0003"',
    "flat": 'projection="orthographic" fovy="3"',
}
MODEL = mujoco.MjModel.from_xml_string(
    f"""
    <mujoco>
      <statistic center="0 0 1" extent="4"/>
      <visual><global azimuth="20" elevation="-10"/></visual>
      <worldbody>
        <body name="box" pos="1 2 3">
          <freejoint/><geom name="edge" pos=".1 0 0" size=".1"/><site name="tip" pos="0 0 .5"/>
          <body name="arm" pos="0 0 1"><joint axis="0 1 0"/><geom size=".1" pos="1 0 0"/></body>
          {"".join(f'<camera name="{n}" pos="0 -2 .5" euler="70 10 5" {c}/>' for n, c in CAMERAS.items())}
        </body>
        <body name="mark" pos="0 0 1"><geom size=".1"/></body>
      </worldbody>
    </mujoco>
    """
)
CAMERAS_OF_MODEL = MujocoCameras(MODEL)
STILL = ShotTime(0.0, 0.0, 0.0)


def moved(yaw: float = 0.0) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    half = math.radians(yaw) / 2
    data.qpos[:] = [4, 5, 6, math.cos(half), 0, 0, math.sin(half), 0.3]
    mujoco.mj_forward(MODEL, data)
    return data


def posed(rig: Rig, time: ShotTime = STILL, data: mujoco.MjData | None = None) -> CameraPose:
    return rig.bind(CAMERAS_OF_MODEL, "camera a").pose(data or moved(), time)


def updated(camera: mujoco.MjvCamera, data: mujoco.MjData) -> CameraPose:
    """Where MuJoCo places `camera`."""
    scene = mujoco.MjvScene(MODEL, 1)
    mujoco.mjv_updateCamera(MODEL, data, camera, scene)
    return pose_of(scene)


def same(one: CameraPose, other: CameraPose) -> bool:
    return (
        one.position == pytest.approx(other.position, abs=1e-5)
        and one.rotation == pytest.approx(other.rotation, abs=1e-5)
        and vars(one.frustum) == pytest.approx(vars(other.frustum))
    )
