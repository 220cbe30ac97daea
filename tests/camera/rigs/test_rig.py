"""Rigs around objects, on paths and at places, and the settings that they refuse."""

import itertools
import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.pose import rotation
from mjrun.camera.rigs.free_camera import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import PathRig, Waypoint
from mjrun.camera.rigs.rig import EasedNumber, Rig, ShotTime
from mjrun.camera.script import RIGS
from mjrun.camera.targets import ObjectOrPoint
from mjrun.errors import MjrunError
from tests.camera.rigs.posed_model import CAMERAS_OF_MODEL, MODEL, moved, posed, same, updated

SQUARE = tuple(Waypoint(eye=eye) for eye in ((0.0, 0.0, 0.0), (2.0, 0.0, 0.5), (2.0, 3.0, 0.0), (0.0, 3.0, 1.0)))


def orbit(*points: tuple[float, float, float], lookat: ObjectOrPoint | None = None) -> list[Waypoint]:
    return [Waypoint(distance=d, azimuth=a, elevation=e, lookat=lookat) for d, a, e in points]


TWO = SQUARE[:2]


TIMED = [Waypoint(eye=(0.0, 0.0, 0.0), at=1.0), Waypoint(eye=(1.0, 0.0, 0.0), at=1.0)]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ModelRig("fixde"), "no camera 'fixde' (did you mean 'fixed'?)"),
        (lambda: FreeRig("bxo"), "no object 'bxo' (did you mean 'box'?)"),
        (lambda: FreeRig(distance=EasedNumber(1, 0)), "distance: '0' is not a positive number of metres"),
        (lambda: FreeRig(distance=-1), "distance: '-1' is not a positive number of metres"),
        (
            lambda: FreeRig(distance=EasedNumber(1, 2, "smoth")),
            "distance: 'smoth' is not one of linear, cosine, smooth,",
        ),
        (lambda: FreeRig(distance=EasedNumber(1, 2, "smoth")), "(did you mean 'smooth' or 'smoother'?)"),
        (lambda: FreeRig(elevation=EasedNumber(1, math.nan)), "elevation: 'nan' is not finite"),
        (lambda: OrbitRig(azimuth=EasedNumber(1, 2), ease="in"), "ease: set the ease within azimuth: {from, to, ease}"),
        (lambda: OrbitRig(ease="quick"), "ease: 'quick' is not one of linear, cosine"),
        (lambda: FreeRig((1.0, 2.0, math.inf)), "lookat: '1, 2, inf' is not made of finite numbers"),
        (lambda: LookRig("box", "box"), "at: the camera cannot look at its own position"),
        (lambda: LookRig("box", "bxo"), "no object 'bxo'"),
        (lambda: PathRig(TWO[:1]), "waypoints: '1' is not at least 2"),
        (lambda: PathRig(TWO, curve="bezier"), "curve: 'bezier' is not one of spline, linear"),
        (lambda: PathRig(TWO, pace="slow"), "pace: 'slow' is not one of constant, time"),
        (lambda: PathRig(TWO, ease="slow"), "ease: 'slow' is not one of linear"),
        (lambda: PathRig(TIMED, pace="time", ease="in"), "ease: ease requires pace: constant"),
        (lambda: PathRig(TIMED, pace="time"), "waypoint 2: at: expected a time later than 1"),
        (lambda: PathRig(TIMED), "waypoint 1: at: at needs pace: time"),
        (
            lambda: PathRig([TIMED[0], TWO[1]], pace="time"),
            "waypoint 2: with pace: time each waypoint needs its at",
        ),
        (
            lambda: PathRig([TWO[0], *orbit((1, 2, 3))], "box"),
            "waypoint 2: either all waypoints have an eye, or all",
        ),
        (lambda: PathRig([TWO[0], TWO[0]], "box"), "camera a: waypoints 1 and 2 coincide"),
        (
            lambda: PathRig(orbit((1, 0, 90), (1, 90, 90)), "box"),
            "camera a: waypoints 1 and 2 coincide",
        ),
        (lambda: PathRig(orbit((1, 2, 3), (2, 3, 4))), "waypoint 1: no point to look at"),
        (lambda: PathRig([TWO[0], Waypoint((1, 1, 1), lookat="box")]), "waypoint 1: no point to look at"),
        (lambda: Waypoint(distance=0, azimuth=3, elevation=4), "distance: '0' is not a positive number"),
        (Waypoint, "expected eye, or distance, azimuth and elevation, got none"),
        (lambda: Waypoint((0, 0, 0), azimuth=3), "azimuth: a waypoint with an eye has no azimuth"),
        (lambda: Waypoint((0, 0, math.nan)), "eye: '0, 0, nan' is not made of finite numbers"),
        (lambda: PathRig([Waypoint((0, 0, 0), at=t) for t in (0, 1)], pace="time"), "no direction of view"),
        (lambda: PathRig(TWO, lookat="bxo"), "no object 'bxo'"),
        (lambda: Waypoint(distance=1, azimuth=2, elevation=math.inf), "elevation: 'inf' is not a finite number"),
        (lambda: Waypoint((0, 0, 0), at=-1), "at: '-1' is not a number of at least 0"),
        (lambda: TrackRig("box", offset=(0, 0, math.nan)), "offset: '0, 0, nan' is not made of finite numbers"),
    ],
)
def test_a_wrong_rig_is_refused_with_what_is_right(make: Callable[[], Rig], message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        make().bind(CAMERAS_OF_MODEL, "camera a")
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_rigs_are_found_by_the_names_that_documents_have_for_them() -> None:
    assert {*RIGS} == {"camera", "auto", "free", "orbit", "track", "look", "path"}
    assert all(kind == rig.kind for kind, rig in RIGS.items())


turns = st.floats(-720, 720)
slopes = st.floats(-90, 90)
lengths = st.floats(0.1, 9)
points = st.tuples(*[st.floats(-3, 3)] * 3)


def at(phase: float, duration: float = 1.0) -> ShotTime:
    return ShotTime(7 + phase * duration, phase * duration, phase)


@given(points, lengths, turns, slopes)
def test_around_a_point_is_mujoco_s_free_camera(
    target: tuple[float, float, float], distance: float, azimuth: float, elevation: float
) -> None:
    camera, data = mujoco.MjvCamera(), moved()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = target, distance, azimuth, elevation
    rig = FreeRig(target, EasedNumber.still(distance), EasedNumber.still(azimuth), EasedNumber.still(elevation))
    assert same(posed(rig, data=data), updated(camera, data))


def test_what_is_not_said_is_the_free_camera_s() -> None:
    camera, data = mujoco.MjvCamera(), moved()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    assert same(posed(FreeRig(), data=data), updated(camera, data))
    camera.azimuth += 90
    assert same(posed(OrbitRig(), at(0.25), data), updated(camera, data))


@given(st.floats(0, 1))
def test_each_number_goes_from_start_to_end_by_its_own_ease(phase: float) -> None:
    rig = FreeRig((0, 0, 0), EasedNumber(1, 3, "in"), EasedNumber(140, 240, "cosine"), EasedNumber(-30, 10))
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
def test_an_object_is_followed_where_it_is_now(target: ObjectOrPoint, expected: list[float]) -> None:
    assert posed(FreeRig(target)).lookat == pytest.approx(np.array(expected))
    looking = posed(LookRig((0.0, 0.0, 9.0), target))
    assert looking.lookat == pytest.approx(np.array(expected))
    assert looking.position == pytest.approx(np.array([0, 0, 9]))


@given(turns, turns, points)
def test_with_a_heading_a_camera_moves_as_if_it_were_fastened_to_the_object(
    yaw: float, azimuth: float, offset: tuple[float, float, float]
) -> None:
    rig = TrackRig(
        "box", EasedNumber.still(2), EasedNumber.still(azimuth), EasedNumber.still(-10), heading=True, offset=offset
    )
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
    with pytest.raises(MjrunError, match=r"camera a: at 7\.5 s the camera coincides with the point that it looks at"):
        posed(LookRig((4.0, 5.0, 6.0), "box"), at(0.5))


SQUARE = tuple(Waypoint(eye=eye) for eye in ((0.0, 0.0, 0.0), (2.0, 0.0, 0.5), (2.0, 3.0, 0.0), (0.0, 3.0, 1.0)))


@pytest.mark.parametrize("curve", ["linear", "spline"])
def test_a_path_of_constant_pace_has_a_constant_speed(curve: str) -> None:
    found = PathRig(SQUARE, "mark", curve).bind(CAMERAS_OF_MODEL, "")
    places = np.array([found.pose(CAMERAS_OF_MODEL.data, at(u)).position for u in np.linspace(0, 1, 1001)])
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
        assert posed(rig, ShotTime(time, time, 0.1)).position == pytest.approx(np.array(point.eye))


@given(st.floats(0, 1))
def test_a_path_around_something_is_an_arc_by_angles_as_given(u: float) -> None:
    pose = posed(PathRig(orbit((2, 10, -20), (2, 190, -20), (2, 640, -20)), "box"), at(u))
    assert pose.distance == pytest.approx(2)
    assert pose.lookat == pytest.approx(np.array([4, 5, 6]))
    assert pose.rotation == pytest.approx(rotation(10 + 630 * u, -20), abs=1e-3)


def test_a_path_around_something_keeps_its_speed() -> None:
    found = PathRig(orbit((2, 0, -20), (4, 200, -60), (3, 300, 0)), "mark").bind(CAMERAS_OF_MODEL, "")
    places = np.array([found.pose(CAMERAS_OF_MODEL.data, at(u)).position for u in np.linspace(0, 1, 1001)])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert speeds == pytest.approx(speeds.mean(), rel=0.01)


@given(st.floats(0, 2))
def test_a_path_that_comes_close_to_something_does_not_go_through_it(time: float) -> None:
    near = [Waypoint(distance=d, azimuth=0, elevation=0, at=at) for d, at in ((10, 0), (0.1, 1), (5, 2))]
    pose = posed(PathRig(near, "box", pace="time"), ShotTime(time, time, 0))
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
    assert posed(rig, ShotTime(1.5, 1.5, 0.5)).position == pytest.approx(np.array(b))
    assert posed(rig, ShotTime(1.5, 1.5, 0.5)).forward == pytest.approx(np.array([0, 1, 0]), abs=1e-9)


TWO = SQUARE[:2]
TIMED = [Waypoint(eye=(0.0, 0.0, 0.0), at=1.0), Waypoint(eye=(1.0, 0.0, 0.0), at=1.0)]


def test_the_wait_of_a_camera_that_circles_something_is_a_wait() -> None:
    timed = [Waypoint(distance=1, azimuth=a, elevation=0, at=t) for a, t in ((0, 0), (90, 1), (90, 2), (0, 3))]
    found = PathRig(timed, "box", pace="time").bind(CAMERAS_OF_MODEL, "")
    poses = [found.pose(moved(), ShotTime(t, t, 0)) for t in (1, 1.3, 1.7, 2)]
    assert all(np.allclose(a.position, b.position, atol=1e-12) for a, b in itertools.pairwise(poses))
