"""The path rig, against closed forms."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.pose import rotation
from mjrun.camera.rigs.path import PathRig, Waypoint
from mjrun.camera.rigs.rig import ShotTime
from mjrun.camera.targets import Place
from tests.camera.rigs.posed_model import CAMERAS_OF_MODEL, moved, posed


def at(phase: float, duration: float = 1.0) -> ShotTime:
    return ShotTime(7 + phase * duration, phase * duration, phase)


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


def orbit(*points: tuple[float, float, float], lookat: Place | None = None) -> list[Waypoint]:
    return [Waypoint(distance=d, azimuth=a, elevation=e, lookat=lookat) for d, a, e in points]


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
