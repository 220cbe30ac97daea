"""Rigs, against MuJoCo's own cameras and closed forms."""

import itertools
import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.pose import Pose, pose_of, rotation
from mjrun.camera.rigs import Moment, Viewer, aim
from mjrun.camera.script import AroundRig, LookRig, ModelRig, PathRig, Place, Ramp, Rig, Waypoint
from mjrun.errors import MjrunError

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
VIEWER = Viewer(MODEL)
STILL = Moment(0.0, 0.0, 0.0)

turns = st.floats(-720, 720)
slopes = st.floats(-90, 90)
lengths = st.floats(0.1, 9)
points = st.tuples(*[st.floats(-3, 3)] * 3)


def moved(yaw: float = 0.0) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    half = math.radians(yaw) / 2
    data.qpos[:] = [4, 5, 6, math.cos(half), 0, 0, math.sin(half), 0.3]
    mujoco.mj_forward(MODEL, data)
    return data


def posed(rig: Rig, moment: Moment = STILL, data: mujoco.MjData | None = None) -> Pose:
    return aim(rig, VIEWER, "camera a").pose(data or moved(), moment)


def at(phase: float, duration: float = 1.0) -> Moment:
    return Moment(7 + phase * duration, phase * duration, phase)


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


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_of_the_model_is_where_mujoco_has_it(name: str) -> None:
    data, camera = moved(40), mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, MODEL.camera(name).id
    found = posed(ModelRig(name), data=data)
    assert same(found, updated(camera, data))
    assert found.position == pytest.approx(data.cam(name).xpos)
    assert found.rotation == pytest.approx(data.cam(name).xmat.reshape(3, 3), abs=1e-6)
    assert found.frustum.orthographic == (name == "flat")


def test_a_camera_of_the_model_looks_as_far_as_the_point_of_its_axis_nearest_to_the_centre() -> None:
    pose = posed(ModelRig("fixed"), data=VIEWER.data)
    toward = np.array([0, 0, 1]) - pose.position
    assert pose.distance == pytest.approx(max(toward @ pose.forward, 0.4), rel=1e-6)
    near = np.linalg.norm([0, 0, 1] - pose.lookat)
    assert all(near <= np.linalg.norm([0, 0, 1] - pose.position - d * pose.forward) for d in (0.4, 1, 3, 9))


@given(points, lengths, turns, slopes)
def test_around_a_point_is_mujoco_s_free_camera(
    target: tuple[float, float, float], distance: float, azimuth: float, elevation: float
) -> None:
    camera, data = mujoco.MjvCamera(), moved()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = target, distance, azimuth, elevation
    rig = AroundRig(target, Ramp.still(distance), Ramp.still(azimuth), Ramp.still(elevation))
    assert same(posed(rig, data=data), updated(camera, data))


def test_what_is_not_said_is_the_free_camera_s() -> None:
    camera, data = mujoco.MjvCamera(), moved()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    assert same(posed(AroundRig(), data=data), updated(camera, data))
    camera.azimuth += 90
    assert same(posed(AroundRig(turn="linear"), at(0.25), data), updated(camera, data))


@given(st.floats(0, 1))
def test_each_number_goes_from_start_to_end_by_its_own_ease(phase: float) -> None:
    rig = AroundRig((0, 0, 0), Ramp(1, 3, "in"), Ramp(140, 240, "cosine"), Ramp(-30, 10))
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
    assert posed(AroundRig(target)).lookat == pytest.approx(np.array(expected))
    looking = posed(LookRig((0.0, 0.0, 9.0), target))
    assert looking.lookat == pytest.approx(np.array(expected))
    assert looking.position == pytest.approx(np.array([0, 0, 9]))


@given(turns, turns, points)
def test_with_a_heading_a_camera_moves_as_if_it_were_fastened_to_the_object(
    yaw: float, azimuth: float, offset: tuple[float, float, float]
) -> None:
    rig = AroundRig("box", Ramp.still(2), Ramp.still(azimuth), Ramp.still(-10), heading=True, offset=offset)
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
    rig = AroundRig("box", offset=(1.0, 2.0, 3.0))
    assert posed(rig, data=moved(50)).lookat == pytest.approx(np.array([5, 7, 9]))


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


SQUARE = tuple(Waypoint(eye=eye) for eye in ((0.0, 0.0, 0.0), (2.0, 0.0, 0.5), (2.0, 3.0, 0.0), (0.0, 3.0, 1.0)))


@pytest.mark.parametrize("curve", ["linear", "spline"])
def test_a_path_of_constant_pace_has_a_constant_speed(curve: str) -> None:
    found = aim(PathRig(SQUARE, "mark", curve), VIEWER, "")
    places = np.array([found.pose(VIEWER.data, at(u)).position for u in np.linspace(0, 1, 1001)])
    assert places[[0, -1]] == pytest.approx(np.array([SQUARE[0].eye, SQUARE[-1].eye]))
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1)
    usual = np.median(speeds)
    assert np.sum(np.abs(speeds / usual - 1) > 0.01) <= (2 if curve == "linear" else 0)  # but at the two corners


@given(st.floats(0, 1))
def test_a_path_s_ease_is_that_of_its_length(u: float) -> None:
    straight = (Waypoint(eye=(0.0, 0.0, 0.0)), Waypoint(eye=(1.0, 0.0, 0.0)), Waypoint(eye=(5.0, 0.0, 0.0)))
    pose = posed(PathRig(straight, "mark", "linear", ease="smooth"), at(u))
    assert pose.position == pytest.approx(np.array([5 * u * u * (3 - 2 * u), 0, 0]), abs=1e-9)


@pytest.mark.parametrize("curve", ["linear", "spline"])
def test_a_path_with_times_is_at_each_waypoint_when_it_says(curve: str) -> None:
    times = (0.5, 1.0, 4.0, 4.5)
    timed = tuple(Waypoint(eye=point.eye, at=time) for point, time in zip(SQUARE, times, strict=True))
    rig = PathRig(timed, "mark", curve, pace="time")
    for time, point in [*zip(times, SQUARE, strict=True), (0.0, SQUARE[0]), (9.0, SQUARE[-1])]:
        assert posed(rig, Moment(time, time, 0.1)).position == pytest.approx(np.array(point.eye))


def orbit(*points: tuple[float, float, float], lookat: Place | None = None) -> list[Waypoint]:
    return [Waypoint(distance=d, azimuth=a, elevation=e, lookat=lookat) for d, a, e in points]


@given(st.floats(0, 1))
def test_a_path_around_something_is_an_arc_by_angles_as_given(u: float) -> None:
    pose = posed(PathRig(orbit((2, 10, -20), (2, 190, -20), (2, 640, -20)), "box"), at(u))
    assert pose.distance == pytest.approx(2)
    assert pose.lookat == pytest.approx(np.array([4, 5, 6]))
    assert pose.rotation == pytest.approx(rotation(10 + 630 * u, -20), abs=1e-3)


def test_a_path_around_something_keeps_its_speed() -> None:
    found = aim(PathRig(orbit((2, 0, -20), (4, 200, -60), (3, 300, 0)), "mark"), VIEWER, "")
    places = np.array([found.pose(VIEWER.data, at(u)).position for u in np.linspace(0, 1, 1001)])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert speeds == pytest.approx(speeds.mean(), rel=0.01)


@given(st.floats(0, 2))
def test_a_path_that_comes_close_to_something_does_not_go_through_it(time: float) -> None:
    near = [Waypoint(distance=d, azimuth=0, elevation=0, at=at) for d, at in ((10, 0), (0.1, 1), (5, 2))]
    pose = posed(PathRig(near, "box", pace="time"), Moment(time, time, 0))
    assert 0.1 - 1e-9 <= pose.distance <= 10 + 1e-9


def test_what_is_looked_at_goes_from_waypoint_to_waypoint_too_and_moves() -> None:
    eyes = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    rig = PathRig([Waypoint(eye=eyes[0], lookat="box"), Waypoint(eye=eyes[1], lookat=(0.0, 0.0, 2.0))], "mark")
    for u, expected in ((0, [4, 5, 6]), (0.5, [2, 2.5, 4]), (1, [0, 0, 2])):
        assert posed(rig, at(u)).lookat == pytest.approx(np.array(expected))


def test_waypoints_around_different_things_go_from_one_to_the_other() -> None:
    rig = PathRig([*orbit((1, 0, 0), lookat="box"), *orbit((1, 0, 0), lookat="mark")])
    assert posed(rig, at(0)).position == pytest.approx(np.array([3, 5, 6]))
    assert posed(rig, at(1)).position == pytest.approx(np.array([-1, 0, 1]))


@given(st.floats(0.01, 0.99))
def test_without_a_lookat_a_camera_looks_where_the_path_leads(u: float) -> None:
    rig = PathRig(SQUARE)
    before, after = (posed(rig, at(u + h)).position for h in (-1e-4, 1e-4))
    way = (after - before) / np.linalg.norm(after - before)
    pose = posed(rig, at(u))
    assert pose.forward == pytest.approx(way, abs=1e-2)
    assert pose.distance == 1


def test_a_path_that_waits_keeps_looking_ahead() -> None:
    a, b = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    eyes = [(a, 0.0), (b, 1.0), (b, 2.0), ((1.0, 4.0, 0.0), 3.0)]
    rig = PathRig([Waypoint(eye=eye, at=time) for eye, time in eyes], pace="time")
    assert posed(rig, Moment(1.5, 1.5, 0.5)).position == pytest.approx(np.array(b))
    assert posed(rig, Moment(1.5, 1.5, 0.5)).forward == pytest.approx(np.array([0, 1, 0]), abs=1e-9)


TWO = SQUARE[:2]
TIMED = [Waypoint(eye=(0.0, 0.0, 0.0), at=1.0), Waypoint(eye=(1.0, 0.0, 0.0), at=1.0)]


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        (ModelRig("fixde"), "no camera 'fixde' (did you mean 'fixed'?)"),
        (AroundRig("bxo"), "no object 'bxo' (did you mean 'box'?)"),
        (AroundRig(distance=Ramp(1, 0)), "camera a: distance: '0' is not a positive number of metres"),
        (AroundRig(distance=Ramp(1, 2, "quick")), "no ease 'quick' in camera a: distance\neases: linear, cosine"),
        (AroundRig(elevation=Ramp(1, math.nan)), "camera a: elevation: 'nan' is not finite"),
        (AroundRig(heading=True), "camera a: heading needs an object"),
        (AroundRig((1.0, 2.0, 3.0), heading=True), "camera a: heading needs an object"),
        (AroundRig((1.0, 2.0, math.inf)), "is not a point"),
        (LookRig("box", "box"), "camera a: the camera cannot look at where it is"),
        (LookRig("box", "bxo"), "no object 'bxo'"),
        (PathRig(TWO[:1]), "camera a: a path needs two waypoints or more"),
        (PathRig(TWO, curve="bezier"), "no curve 'bezier' in camera a\ncurves: spline, linear"),
        (PathRig(TWO, pace="slow"), "no pace 'slow' in camera a\npaces: constant, time"),
        (PathRig(TWO, ease="slow"), "no ease 'slow' in camera a\neases: linear"),
        (PathRig(TIMED, pace="time", ease="in"), "camera a: ease is for a path of constant speed"),
        (PathRig(TIMED, pace="time"), "camera a: waypoint 2: at: '1' is not later than 1 s"),
        (PathRig(TIMED), "camera a: waypoint 1: `at` goes with pace: time, all through a path"),
        (PathRig([TIMED[0], TWO[1]], pace="time"), "camera a: waypoint 2: `at` goes with pace: time"),
        (PathRig([TWO[0], *orbit((1, 2, 3))], "box"), "camera a: waypoints are either all given by eye, or all by"),
        (PathRig([TWO[0], TWO[0]], "box"), "camera a: waypoints 1 and 2 are at the same place"),
        (PathRig(orbit((1, 0, 90), (1, 90, 90)), "box"), "camera a: waypoints 1 and 2 are at the same place"),
        (PathRig(orbit((1, 2, 3), (2, 3, 4))), "camera a: waypoint 1: what does it look at?"),
        (PathRig([TWO[0], Waypoint(eye=(1.0, 1.0, 1.0), lookat="box")]), "waypoint 1: what does it look at?"),
        (PathRig(orbit((1, 2, 3), (0, 3, 4)), "box"), "camera a: waypoint 2: distance: '0' is not a positive number"),
        (PathRig([TWO[0], Waypoint()]), "camera a: waypoint 2: give it an eye, or distance, azimuth and elevation"),
        (PathRig([TWO[0], Waypoint(eye=(0.0, 0.0, 0.0), azimuth=3.0)]), "azimuth and elevation, not both"),
        (PathRig([TWO[0], Waypoint(eye=(0.0, 0.0, math.nan))]), "waypoint 2: '0, 0, nan' is not made of finite"),
        (PathRig([Waypoint(eye=(0, 0, 0), at=t) for t in (0, 1)], pace="time"), "what does the camera look at?"),
        (PathRig(TWO, lookat="bxo"), "no object 'bxo'"),
    ],
)
def test_a_wrong_rig_is_refused_with_what_is_right(rig: Rig, message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        aim(rig, VIEWER, "camera a")
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_the_wait_of_a_camera_that_circles_something_is_a_wait() -> None:
    timed = [Waypoint(distance=1, azimuth=a, elevation=0, at=t) for a, t in ((0, 0), (90, 1), (90, 2), (0, 3))]
    found = aim(PathRig(timed, "box", pace="time"), VIEWER, "")
    poses = [found.pose(moved(), Moment(t, t, 0)) for t in (1, 1.3, 1.7, 2)]
    assert all(np.allclose(a.position, b.position, atol=1e-12) for a, b in itertools.pairwise(poses))
