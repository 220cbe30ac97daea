"""Curves through points, against the definition of the spline and measured lengths."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mjrun.camera.pose import rotation
from mjrun.camera.rigs.path import ArcLengthParametrization, Curve, centripetal, orbital_lengths, orbital_position

numbers = st.integers(-20, 20).map(lambda i: i / 4)
ways = st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=7).map(lambda p: np.array(p, float))
moving = ways.filter(lambda p: bool((np.linalg.norm(np.diff(p, axis=0), axis=1) > 0).all()))


def chords(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(points, axis=0), axis=1)


def spline(points: np.ndarray, straight: bool = False) -> Curve:
    return Curve(centripetal(chords(points)), points, straight)


@given(moving, st.booleans())
def test_a_curve_goes_through_its_points(points: np.ndarray, straight: bool) -> None:
    curve = spline(points, straight)
    assert curve.at(curve.knots) == pytest.approx(points, abs=1e-12)
    beyond = np.array([curve.knots[0] - 1, curve.knots[-1] + 1])
    assert np.array_equal(curve.at(beyond), points[[0, -1]])


@given(moving, st.floats(0, 1))
def test_a_straight_curve_goes_straight(points: np.ndarray, u: float) -> None:
    curve = spline(points, straight=True)
    for i, (a, b) in enumerate(itertools.pairwise(points)):
        x = curve.knots[i] + u * (curve.knots[i + 1] - curve.knots[i])
        assert curve.at(np.array([x]))[0] == pytest.approx(a + u * (b - a), abs=1e-9)


def pyramid(points: np.ndarray, knots: np.ndarray, x: float) -> np.ndarray:
    """The Catmull-Rom spline between the middle two of four points, by Barry and Goldman's recursion."""

    def mix(a: np.ndarray, b: np.ndarray, s: float, t: float) -> np.ndarray:
        return ((t - x) * a + (x - s) * b) / (t - s)

    t = knots
    first = [mix(points[i], points[i + 1], t[i], t[i + 1]) for i in range(3)]
    second = [mix(first[i], first[i + 1], t[i], t[i + 2]) for i in range(2)]
    return mix(second[0], second[1], t[1], t[2])


@given(moving, st.floats(0, 1))
def test_between_inner_points_a_spline_is_that_of_barry_and_goldman(points: np.ndarray, u: float) -> None:
    assume(len(points) >= 4)
    curve = spline(points)
    x = curve.knots[1] + u * (curve.knots[2] - curve.knots[1])
    expected = pyramid(points[:4], curve.knots[:4], x)
    assert curve.at(np.array([x]))[0] == pytest.approx(expected, abs=1e-9)


def test_centripetal_knots_are_the_square_roots_of_lengths_apart() -> None:
    assert list(centripetal(np.array([1, 4, 9.0]))) == [0, 1, 3, 6]


@given(moving)
def test_a_spline_has_no_kinks(points: np.ndarray) -> None:
    curve, h = spline(points), 1e-7
    for knot in curve.knots[1:-1]:
        before, here, after = curve.at(np.array([knot - h, knot, knot + h]))
        assert (after - here) / h == pytest.approx((here - before) / h, abs=1e-3)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 5))
def test_a_spline_through_points_of_a_parabola_is_the_parabola_up_to_its_ends(a: float, b: float, x: float) -> None:
    knots = np.array([0, 1, 2, 4, 5.0])
    curve = Curve(knots, np.stack([a * knots**2 + b * knots, knots], axis=1), straight=False)
    assert curve.at(np.array([x]))[0] == pytest.approx(np.array([a * x * x + b * x, x]), abs=1e-9)


@given(ways, st.floats(0, 1))
def test_a_bounded_column_stays_between_the_points_that_it_is_between(points: np.ndarray, u: float) -> None:
    curve = Curve(np.arange(len(points), dtype=float), points, straight=False, bounded=(0,))
    for i in range(len(points) - 1):
        value = curve.at(np.array([i + u]))[0, 0]
        low, high = sorted(points[i : i + 2, 0])
        assert low - 1e-12 <= value <= high + 1e-12


@given(ways, st.floats(0, 1))
def test_between_equal_points_a_spline_stands_still(points: np.ndarray, u: float) -> None:
    points = np.insert(points, 1, points[1], axis=0)
    curve = Curve(np.arange(len(points), dtype=float), points, straight=False)
    assert np.array_equal(curve.at(np.array([1 + u]))[0], points[1])


@given(moving, st.floats(0, 1), st.booleans())
def test_a_direction_is_that_of_the_next_little_way(points: np.ndarray, u: float, straight: bool) -> None:
    curve, h = spline(points, straight), 1e-6
    x = u * (curve.knots[-1] - 2 * h)
    assume(np.abs(curve.knots - x).min() > 2 * h)
    way = np.subtract(*curve.at(np.array([x + h, x])))
    assume(np.linalg.norm(way) > 1e-2 * h)
    assert curve.direction(x) == pytest.approx(way / np.linalg.norm(way), abs=1e-2)


def test_where_a_curve_halts_it_leads_to_where_it_goes_next_or_came_from_at_last() -> None:
    points = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 0.0]])
    for straight in (True, False):
        curve = Curve(np.arange(6.0), points, straight)
        assert [list(curve.direction(x).round(9)) for x in (0, 0.5, 1.5, 2.5, 3.5, 4.5, 5)] == [
            [1, 0, 0],
            [1, 0, 0],
            [1, 0, 0],
            [0, 1, 0],
            [0, 1, 0],
            [0, 1, 0],
            [0, 1, 0],
        ]


@settings(deadline=None, max_examples=25)
@given(moving, st.booleans())
def test_equal_shares_of_a_path_are_equally_long(points: np.ndarray, straight: bool) -> None:
    curve = spline(points, straight)
    odometer = ArcLengthParametrization(curve.knots, curve.at)
    places = curve.at(np.array([odometer.at(share) for share in np.linspace(0, 1, 2001)]))
    ways = np.diff(places, axis=0)
    steps = chords(places)
    # Chords are shorter than the path where it bends: leave out what is near a bend.
    bends = np.einsum("ij,ij->i", ways[1:], ways[:-1]) < 0.999 * steps[1:] * steps[:-1]
    smooth = ~(np.append(bends, False) | np.insert(bends, 0, False))
    assert smooth.sum() > 1500
    assert steps[smooth] == pytest.approx(odometer.length / 2000, rel=0.01)


def test_the_length_of_a_straight_path_is_that_of_its_parts() -> None:
    points = np.array([[0, 0, 0], [3, 4, 0], [3, 4, 2.0]])
    odometer = ArcLengthParametrization(np.array([0, 1, 5.0]), Curve(np.array([0, 1, 5.0]), points, straight=True).at)
    assert odometer.length == pytest.approx(7)
    assert [odometer.at(share) for share in (0, 5 / 7, 6 / 7, 1)] == pytest.approx([0, 1, 3, 5])


@given(st.floats(0.1, 9), st.floats(-400, 400), st.floats(-90, 90))
def test_an_orbit_is_behind_what_it_looks_at(distance: float, azimuth: float, elevation: float) -> None:
    place = orbital_position(np.array([[distance, azimuth, elevation]]))[0]
    assert place == pytest.approx(distance * rotation(azimuth, elevation)[:, 2], abs=1e-12)


def test_ways_around_something_are_as_long_as_their_arcs() -> None:
    points = np.array([[2, 0, 0], [2, 360, 0], [2, 360, 90], [5, 360, 90.0]])
    assert orbital_lengths(points) == pytest.approx([4 * math.pi, math.pi, 3])
