"""Free, orbiting and tracking rigs, against MuJoCo's free camera."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.easing import Ramp
from mjrun.camera.pose import Pose, pose_of, rotation
from mjrun.camera.rigs.around import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.rig import ShotTime
from mjrun.camera.targets import Place
from tests.camera.rigs.posed_model import MODEL, moved, posed

turns = st.floats(-720, 720)


slopes = st.floats(-90, 90)


lengths = st.floats(0.1, 9)


points = st.tuples(*[st.floats(-3, 3)] * 3)


def at(phase: float, duration: float = 1.0) -> ShotTime:
    return ShotTime(7 + phase * duration, phase * duration, phase)


def updated(camera: mujoco.MjvCamera, data: mujoco.MjData) -> Pose:
    """Where MuJoCo places `camera`."""
    scene = mujoco.MjvScene(MODEL, 1)
    mujoco.mjv_updateCamera(MODEL, data, camera, scene)
    return pose_of(scene)


def same(one: Pose, other: Pose) -> bool:
    return (
        one.position == pytest.approx(other.position, abs=1e-5)
        and one.rotation == pytest.approx(other.rotation, abs=1e-5)
        and vars(one.frustum) == pytest.approx(vars(other.frustum))
    )


@given(points, lengths, turns, slopes)
def test_around_a_point_is_mujoco_s_free_camera(
    target: tuple[float, float, float], distance: float, azimuth: float, elevation: float
) -> None:
    camera, data = mujoco.MjvCamera(), moved()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = target, distance, azimuth, elevation
    rig = FreeRig(target, Ramp.still(distance), Ramp.still(azimuth), Ramp.still(elevation))
    assert same(posed(rig, data=data), updated(camera, data))


def test_what_is_not_said_is_the_free_camera_s() -> None:
    camera, data = mujoco.MjvCamera(), moved()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    assert same(posed(FreeRig(), data=data), updated(camera, data))
    camera.azimuth += 90
    assert same(posed(OrbitRig(), at(0.25), data), updated(camera, data))


@given(st.floats(0, 1))
def test_each_number_goes_from_start_to_end_by_its_own_ease(phase: float) -> None:
    rig = FreeRig((0, 0, 0), Ramp(1, 3, "in"), Ramp(140, 240, "cosine"), Ramp(-30, 10))
    pose = posed(rig, at(phase))
    azimuth = 140 + 100 * (1 - math.cos(math.pi * phase)) / 2
    assert pose.distance == pytest.approx(1 + 2 * phase**2)
    assert pose.rotation == pytest.approx(rotation(azimuth, -30 + 40 * phase))


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("box", [4, 5, 6]),
        ("edge", [4.1, 5, 6]),
        ("site:tip", [4, 5, 6.5]),
        ("geom:edge", [4.1, 5, 6]),
        ((1, 2, 3), [1, 2, 3]),
        ("subtree:mark", [0, 0, 1]),
    ],
)
def test_an_object_is_followed_where_it_is_now(target: Place, expected: list[float]) -> None:
    assert posed(FreeRig(target)).lookat == pytest.approx(np.array(expected))
    looking = posed(LookRig((0.0, 0.0, 9.0), target))
    assert looking.lookat == pytest.approx(np.array(expected))
    assert looking.position == pytest.approx(np.array([0, 0, 9]))


@given(turns, turns, points)
def test_with_a_heading_a_camera_moves_as_if_it_were_fastened_to_the_object(
    yaw: float, azimuth: float, offset: tuple[float, float, float]
) -> None:
    rig = TrackRig("box", Ramp.still(2), Ramp.still(azimuth), Ramp.still(-10), heading=True, offset=offset)
    data, turned = moved(), moved(yaw)
    local = [
        (d.body("box").xmat.reshape(3, 3).T @ (p.position - d.body("box").xpos), d.body("box").xmat.reshape(3, 3).T)
        for d, p in ((data, posed(rig, data=data)), (turned, posed(rig, data=turned)))
    ]
    assert local[0][0] == pytest.approx(local[1][0], abs=1e-9)
    directions = [local[0][1] @ posed(rig, data=data).forward, local[1][1] @ posed(rig, data=turned).forward]
    assert directions[0] == pytest.approx(directions[1], abs=1e-9)
    assert posed(rig, data=data).lookat == pytest.approx(np.array([4, 5, 6]) + offset, abs=1e-9)


def test_without_a_heading_an_offset_stays_in_the_world() -> None:
    rig = TrackRig("box", offset=(1.0, 2.0, 3.0))
    assert posed(rig, data=moved(50)).lookat == pytest.approx(np.array([5, 7, 9]))
