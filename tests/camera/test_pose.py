"""Poses as plain values, against MuJoCo's own cameras and closed forms."""

import math
import pickle
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.camera.pose import (
    CameraPose,
    CameraPoseArray,
    Frustum,
    around,
    fitted,
    heading,
    pose_of,
    rotation,
    user_camera,
)

MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
DATA = mujoco.MjData(MODEL)
SCENE = mujoco.MjvScene(MODEL, 1)
SQUARE = Frustum(0.0, 0.0, -0.01, 0.01, 0.02, 40.0)
SIDEWAYS = Frustum(0.03, 0.02, -0.005, 0.015, 0.02, 40.0)  # all of it lies to the right of its axis
FLAT = Frustum(0.0, 0.0, -1.0, 1.0, 0.02, 40.0, orthographic=True)

turns = st.floats(-720, 720)
slopes = st.floats(-89, 89)
lengths = st.floats(0.1, 9)
points = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
clouds = st.lists(points, min_size=2, max_size=9).map(np.array).filter(lambda p: np.ptp(p, axis=0).min() > 0.1)


def at(frustum: Frustum = SQUARE) -> CameraPose:
    return CameraPose(np.array([1.0, 2, 3]), rotation(30, -20, 10), frustum, 2.0)


def same_direction(a: float, b: float) -> bool:
    return abs((a - b + 180) % 360 - 180) < 1e-7


@given(turns, st.floats(-180, 180), turns)
def test_a_rotation_is_one(azimuth: float, elevation: float, roll: float) -> None:
    matrix = rotation(azimuth, elevation, roll)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)


@given(turns, slopes, turns)
def test_angles_come_back_from_a_rotation(azimuth: float, elevation: float, roll: float) -> None:
    found = CameraPose(np.zeros(3), rotation(azimuth, elevation, roll), SQUARE).angles
    assert all(same_direction(a, b) for a, b in zip(found, (azimuth, elevation, roll), strict=True))


@given(turns, st.sampled_from([-90, 90]), turns)
def test_straight_up_and_down_angles_still_tell_the_rotation(azimuth: float, elevation: float, roll: float) -> None:
    matrix = rotation(azimuth, elevation, roll)
    assert rotation(*CameraPose(np.zeros(3), matrix, SQUARE).angles) == pytest.approx(matrix, abs=1e-9)


def test_noise_of_float32_does_not_turn_a_camera_that_looks_down() -> None:
    noisy = rotation(45, -90) + np.array([[0, 0, 1e-7], [0, 0, -2e-7], [0, 0, 0]])
    azimuth, elevation, roll = CameraPose(np.zeros(3), noisy, SQUARE).angles
    assert (azimuth, elevation, roll) == pytest.approx((45, -90, 0), abs=1e-4)


@given(points, lengths, turns, st.floats(-90, 90))
def test_around_is_where_mujoco_places_its_free_camera(
    lookat: np.ndarray, distance: float, azimuth: float, elevation: float
) -> None:
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = lookat, distance, azimuth, elevation
    mujoco.mjv_updateCamera(MODEL, DATA, camera, SCENE)
    expected, found = pose_of(SCENE), around(lookat, distance, azimuth, elevation, SQUARE)
    assert found.position == pytest.approx(expected.position, abs=5e-6)
    assert found.rotation == pytest.approx(expected.rotation, abs=2e-6)
    assert found.lookat == pytest.approx(lookat, abs=1e-12)


@given(points, turns, slopes, turns, st.sampled_from([SQUARE, SIDEWAYS, FLAT]))
def test_a_scene_is_seen_from_the_pose_in_which_it_is_placed(
    position: np.ndarray, azimuth: float, elevation: float, roll: float, frustum: Frustum
) -> None:
    pose = CameraPose(position, rotation(azimuth, elevation, roll), frustum)
    pose.place(SCENE)
    mujoco.mjv_updateCamera(MODEL, DATA, user_camera(), SCENE)
    found = pose_of(SCENE)
    assert found.position == pytest.approx(position, abs=1e-6)
    assert found.rotation == pytest.approx(pose.rotation, abs=1e-6)
    assert vars(found.frustum) == pytest.approx(vars(frustum))


def rodrigues(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    a = math.radians(angle)
    return np.eye(3) + math.sin(a) * cross + (1 - math.cos(a)) * cross @ cross


@given(turns)
def test_a_roll_turns_clockwise_around_the_axis_of_view(roll: float) -> None:
    pose = at()
    turned = pose.rolled(roll)
    # Clockwise for who looks along `forward` is the right-handed turn around it.
    assert turned.rotation == pytest.approx(rodrigues(pose.forward, roll) @ pose.rotation, abs=1e-12)
    assert turned.rotation == pytest.approx(rotation(30, -20, 10 + roll), abs=1e-12)
    assert np.array_equal(turned.position, pose.position)


@given(st.floats(-30, 30), st.floats(-30, 30))
def test_a_pan_goes_left_and_a_tilt_up(pan: float, tilt: float) -> None:
    pose = at()
    panned = pose.panned(pan, 0)
    assert panned.rotation == pytest.approx(rodrigues(pose.up, pan) @ pose.rotation, abs=1e-12)
    right = panned.rotation[:, 0]
    assert pose.panned(pan, tilt).rotation == pytest.approx(rodrigues(right, tilt) @ panned.rotation, abs=1e-12)


@given(st.floats(1, 170))
def test_a_frustum_opens_to_the_field_of_view_that_is_asked_for(fovy: float) -> None:
    assert at(SIDEWAYS).opened(fovy).frustum.fovy == pytest.approx(fovy)
    assert FLAT.opened(fovy).fovy == pytest.approx(fovy)
    assert SQUARE.opened(fovy).halfwidth((200, 100)) == pytest.approx(2 * 0.02 * math.tan(math.radians(fovy) / 2))
    assert SIDEWAYS.halfwidth((200, 100)) == 0.02


@given(points.filter(lambda d: np.linalg.norm(d) > 1e-3))
def test_a_heading_points_where_its_direction_does(direction: np.ndarray) -> None:
    forward = -rotation(*heading(direction))[:, 2]
    assert forward == pytest.approx(direction / np.linalg.norm(direction), abs=2e-6)


def test_looking_straight_down_is_like_reading_a_map() -> None:
    down, up = rotation(*heading(np.array([0, 0, -3.0]))), rotation(*heading(np.array([0, 0, 0.5])))
    assert down == pytest.approx(np.eye(3), abs=1e-12)
    assert up == pytest.approx(np.diag([1, -1, -1]), abs=1e-12)


def pixels(pose: CameraPose, places: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Where `places` `(n, 3)` are in a picture [pixels], from its top left corner, by similar triangles."""
    x, y, back = ((places - pose.position) @ pose.rotation).T
    seen = pose.frustum
    scale = 1.0 if seen.orthographic else seen.near / -back
    assert (-back >= seen.near).all()
    left, width = seen.center - seen.halfwidth(size), 2 * seen.halfwidth(size)
    u = (scale * x - left) / width
    v = (seen.top - scale * y) / (seen.top - seen.bottom)
    return np.stack([u * size[0], v * size[1]], axis=1)


@settings(deadline=None)
@given(
    clouds,
    turns,
    st.floats(-90, 90),
    turns,
    st.sampled_from([SQUARE, SIDEWAYS, FLAT]),
    st.sampled_from([(160, 90), (90, 160), (100, 100)]),
    st.floats(1, 3),
)
def test_what_is_fitted_is_inside_the_margin_and_would_not_be_if_it_were_larger(
    cloud: np.ndarray,
    azimuth: float,
    elevation: float,
    roll: float,
    frustum: Frustum,
    size: tuple[int, int],
    margin: float,
) -> None:
    before = CameraPose(np.zeros(3), rotation(azimuth, elevation, roll), frustum, 0.1)
    pose = fitted(before, cloud, size, margin)
    assert np.array_equal(pose.rotation, before.rotation)
    share = np.abs(pixels(pose, cloud, size) / size - 0.5).max() * 2 * margin  # of the picture within the margin
    assert share <= 1 + 1e-9
    nearest = ((cloud - pose.position) @ pose.forward).min()
    if frustum.orthographic or nearest > 1.01 * frustum.near:
        assert share == pytest.approx(1)  # unless the camera stopped before it was inside
    assert pixels(pose, middle(cloud)[None], size)[0] == pytest.approx(np.array(size) / 2)


def middle(cloud: np.ndarray) -> np.ndarray:
    return (cloud.min(axis=0) + cloud.max(axis=0)) / 2


def test_fitting_changes_the_frustum_only_where_distance_changes_nothing() -> None:
    cloud = np.array([[-1.0, 0, -2], [1, 0, 2]])
    level = CameraPose(np.zeros(3), rotation(90, 0), SQUARE, 5.0)
    assert fitted(level, cloud, (100, 100), 1).frustum is SQUARE
    assert fitted(level, cloud, (100, 100), 1).position == pytest.approx(np.array([0, -4, 0]))  # tan(fovy/2) is 1/2
    assert fitted(replace(level, frustum=FLAT), cloud, (100, 100), 1.5).frustum.fovy == pytest.approx(6)


FRUSTUM = Frustum(0.01, 0.02, -0.005, 0.015, 0.02, 40.0)


def moving(count: int) -> list[CameraPose]:
    turns = [rotation(360 * k / count, -20, 10) for k in range(count)]
    return [CameraPose(np.array([1 / 3, k, 3]), turn, FRUSTUM, 2 + k) for k, turn in enumerate(turns)]


def still(count: int) -> list[CameraPose]:
    flat = replace(FRUSTUM, orthographic=True)
    return [CameraPose(np.array([0.1, 0.2, 0.3]), rotation(30, 0), flat) for _ in range(count)]


def same(one: CameraPose, other: CameraPose) -> bool:
    arrays = np.array_equal(one.position, other.position) and np.array_equal(one.rotation, other.rotation)
    return arrays and (one.frustum, one.distance) == (other.frustum, other.distance)


def test_each_frame_has_the_pose_of_each_camera() -> None:
    cameras = [moving(9), still(9), [*still(4), *moving(5)]]
    for table in (CameraPoseArray(cameras), pickle.loads(pickle.dumps(CameraPoseArray(cameras)))):
        assert len(table) == 9
        for index, poses in enumerate(table):
            assert all(same(pose, camera[index]) for pose, camera in zip(poses, cameras, strict=True))
        assert len(table[2:5]) == 3
        assert same(table[2:5][1][0], cameras[0][3])
        assert same(table[-1][2], cameras[2][-1])
    with pytest.raises(IndexError):
        CameraPoseArray(cameras)[9]


def test_a_camera_that_stands_still_is_held_once() -> None:
    sizes = [len(pickle.dumps(CameraPoseArray([poses(1000)]))) for poses in (still, moving)]
    assert sizes[0] < 10_000 < sizes[1] < 180_000
