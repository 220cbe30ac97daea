"""A camera on a path through waypoints: a curve, straight or smooth, travelled at a constant pace or by times."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import ClassVar

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, around, heading, rotation
from mjrun.camera.rigs.rig import EASINGS, MujocoCameras, ObjectOrPointKind, Rig, ShotTime, looking_at
from mjrun.camera.targets import BoundObjectOrPoint, ObjectOrPoint, Vector, find_target
from mjrun.errors import UsageError, concerning
from mjrun.options.kinds import ChoiceKind, optional
from mjrun.options.number_kinds import PointKind, RealKind
from mjrun.options.option import Options, option, positional_options, required
from mjrun.options.schema_validation import Path
from mjrun.options.structured_kinds import ListKind, OptionsMappingKind, mappings_in

SAMPLES = 512  # samples of a curve between two waypoints, for measuring its length
SAME_POINT = 1e-9  # share of a curve's length below which two points count as the same
_NUDGE = 1e-3  # share of a segment after which the direction of a curve is clear beyond a halt
CURVES = ("spline", "linear")
AROUND = ("distance", "azimuth", "elevation")


class Curve:
    """A curve through points, each at its knot: straight, or a cubic spline with a continuous velocity.

    The velocity at a point is that of the parabola through it and its neighbours. With `centripetal` knots
    this is the Catmull-Rom spline of P. Barry and R. Goldman, "A Recursive Evaluation
    Algorithm for a Class of Catmull-Rom Splines", 1988. Between two equal points the curve pauses.

    Args:
      knots: `(n,)`, ascending, at least two.
      points: `(n, d)`.
      straight: whether to connect points by straight lines.
      bounded: columns that must not leave the range of the two adjacent points.
    """

    def __init__(self, knots: np.ndarray, points: np.ndarray, straight: bool, bounded: tuple[int, ...] = ()) -> None:
        self.knots, self._points = knots, points
        self._slopes = np.diff(points, axis=0) / np.diff(knots)[:, None]
        self._velocities = None if straight else self._smooth(bounded)

    def _smooth(self, bounded: tuple[int, ...]) -> np.ndarray:
        slopes = np.gradient(self._points, self.knots, axis=0, edge_order=2 if len(self.knots) > 2 else 1)
        before = np.concatenate([self._slopes[:1], self._slopes])
        after = np.concatenate([self._slopes, self._slopes[-1:]])
        still = ~before.any(axis=1) | ~after.any(axis=1)
        slopes[still] = 0.0
        for column in bounded:
            # F. Fritsch and R. Carlson, "Monotone Piecewise Cubic Interpolation", 1980: enough to be monotone.
            left, right = before[:, column], after[:, column]
            most = np.where(left * right > 0, 3 * np.minimum(abs(left), abs(right)), 0.0) * np.sign(left)
            slopes[:, column] = np.clip(slopes[:, column], np.minimum(most, 0), np.maximum(most, 0))
        return slopes

    def _segment(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the segment of each of `x`, and the position in it from 0 to 1."""
        i = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        return i, np.clip((x - self.knots[i]) / (self.knots[i + 1] - self.knots[i]), 0.0, 1.0)

    def at(self, x: np.ndarray) -> np.ndarray:
        """Returns points `(m, d)` at `x` `(m,)`; beyond the ends, the ends."""
        i, u = self._segment(x)
        span, u = (self.knots[i + 1] - self.knots[i])[:, None], u[:, None]
        start, end = self._points[i], self._points[i + 1]
        if self._velocities is None:
            return start + u * (end - start)
        leaving, arriving = (self._velocities[k] * span for k in (i, i + 1))
        rise = u * u * (3 - 2 * u)
        return start + rise * (end - start) + u * (1 - u) * ((1 - u) * leaving - u * arriving)

    def velocity(self, segment: int, u: float) -> np.ndarray:
        """Returns the derivative `(d,)` of the curve by its knots, `u` of the way through a segment."""
        slope = self._slopes[segment]
        if self._velocities is None:
            return slope
        leaving, arriving = self._velocities[segment], self._velocities[segment + 1]
        return 6 * u * (1 - u) * slope + (1 - u) * (1 - 3 * u) * leaving + u * (3 * u - 2) * arriving

    def direction(self, x: float) -> np.ndarray:
        """Returns the unit direction of the curve `(d,)`; at a halt, its next direction, or its last.

        The curve must not be at rest throughout.
        """
        segments, shares = self._segment(np.array([x]))
        i, u = int(segments[0]), float(shares[0])
        moving = np.flatnonzero(self._slopes.any(axis=1))
        later = moving[moving >= i]
        k = int(later[0] if later.size else moving[-1])
        share = min(max(u, _NUDGE), 1 - _NUDGE) if k == i else _NUDGE if later.size else 1 - _NUDGE
        still = SAME_POINT * np.abs(self._slopes).sum(axis=1).max()
        for candidate in (self.velocity(i, u), self.velocity(k, share)):
            if np.linalg.norm(candidate) > still:
                return candidate / np.linalg.norm(candidate)
        return self._slopes[k] / np.linalg.norm(self._slopes[k])


def centripetal(lengths: np.ndarray) -> np.ndarray:
    """Returns knots `(n + 1,)` whose steps are the roots of `lengths` `(n,)` from point to point.

    With such knots a spline has no cusps and no loops: C. Yuksel, S. Schaefer and J. Keyser,
    "Parameterization and applications of Catmull-Rom curves", 2011.
    """
    return np.concatenate([[0.0], np.cumsum(np.sqrt(lengths))])


def orbital_position(points: np.ndarray) -> np.ndarray:
    """Converts distances [m], azimuths and elevations [deg] to positions `(m, 3)` [m] relative to the target.

    Angles are those of MuJoCo's free camera: its direction of view. `points` is `(m, 3)`.
    """
    distance, azimuth, elevation = points[:, 0], *np.radians(points[:, 1:]).T
    across = np.cos(elevation)
    return -distance[:, None] * np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], axis=1
    )


def orbital_lengths(points: np.ndarray) -> np.ndarray:
    """Returns approximate path lengths `(n - 1,)` [m] between successive `points` `(n, 3)`, without wrapping angles."""
    distance, _, elevation = ((points[1:] + points[:-1]) / 2).T
    radial, *turns = np.diff(points, axis=0).T
    azimuth, tilt = np.radians(turns)
    return np.sqrt(radial**2 + (distance * tilt) ** 2 + (distance * np.cos(np.radians(elevation)) * azimuth) ** 2)


class ArcLengthParametrization:
    """The relation between a curve's knots and its length, accurate to a thousandth.

    Args:
      knots: knots of the curve.
      position: returns points `(m, 3)` [m] of the curve at `(m,)`.
    """

    def __init__(self, knots: np.ndarray, position: Callable[[np.ndarray], np.ndarray]) -> None:
        parts = [np.linspace(a, b, SAMPLES, endpoint=False) for a, b in pairwise(map(float, knots))]
        self._x = np.concatenate([*parts, knots[-1:]])
        steps = np.linalg.norm(np.diff(position(self._x), axis=0), axis=1)
        self._lengths = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """The length of the whole curve [m]."""
        return float(self._lengths[-1])

    def at(self, share: float) -> float:
        """Returns the knot value up to which the curve has `share` of its length, from 0 to 1."""
        return float(np.interp(share * self.length, self._lengths, self._x))


@positional_options
class Waypoint(Options):
    """A point on the camera's path: an eye, or distance, azimuth and elevation around the target."""

    eye: Vector | None = option(converter=optional(PointKind()), default=None, help="Position of the camera [m].")
    distance: float | None = option(
        converter=optional(RealKind(above=0)), default=None, help="Distance from the target [m]."
    )
    azimuth: float | None = option(
        converter=optional(RealKind(least=None)),
        default=None,
        help="Direction of view, counter-clockwise from above [deg].",
    )
    elevation: float | None = option(
        converter=optional(RealKind(least=None)), default=None, help="Upward angle of the view [deg]."
    )
    lookat: ObjectOrPoint | None = option(
        converter=optional(ObjectOrPointKind()),
        default=None,
        help="Point to look at from here: an object, or a point [m]; the path's lookat if left out.",
    )
    at: float | None = option(
        converter=optional(RealKind()),
        default=None,
        help="Time at this waypoint [s], from the beginning of the shot; only with pace: time.",
    )

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        present = [key for key in AROUND if key in values]
        if "eye" in values:
            yield from (((key,), f"a waypoint with an eye has no {key}") for key in present)
        elif len(present) < len(AROUND):
            text = " and ".join(present) or "none of them"
            yield (), f"expected eye, or distance, azimuth and elevation, got {text}"


@positional_options
class PathRig(Rig):
    """A camera on a path through waypoints."""

    kind: ClassVar[str] = "path"
    help: ClassVar[str] = "Through waypoints."

    waypoints: tuple[Waypoint, ...] = required(
        converter=ListKind[Waypoint](OptionsMappingKind(Waypoint, Waypoint), least=2),
        help="The points, in order; all by eye, or all by distance, azimuth and elevation.",
    )
    lookat: ObjectOrPoint | None = option(
        converter=optional(ObjectOrPointKind()),
        default=None,
        help="Point to look at on the way: an object, or a point [m]; the direction of the path if left out.",
    )
    curve: str = option(
        converter=ChoiceKind(CURVES),
        default="spline",
        help="Path between waypoints: a smooth curve, or straight lines.",
    )
    pace: str = option(
        converter=ChoiceKind(("constant", "time")),
        default="constant",
        help="Constant speed along the path, or the times of the waypoints.",
    )
    ease: str = option(
        converter=ChoiceKind((*EASINGS,)), default="linear", help="Easing of start and stop; with pace: constant only."
    )

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundPathRig":
        return BoundPathRig(self, cameras, where)

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        timed = values.get("pace") == "time"
        if timed and "ease" in values:
            yield ("ease",), "ease requires pace: constant; with pace: time the waypoints set the times"
        points = mappings_in(values.get("waypoints"))
        yield from _mixed_waypoints(points, "lookat" in values)
        for i, point in enumerate(points):
            if ("at" in point) != timed:
                where: Path = ("waypoints", i) if timed else ("waypoints", i, "at")
                yield where, "with pace: time each waypoint needs its at [s]" if timed else "at needs pace: time"
        if timed:
            yield from _unordered_times(points)


def _mixed_waypoints(points: Sequence[Mapping[str, object]], has_lookat: bool) -> Iterator[tuple[Path, str]]:
    """Yields conflicts between the waypoints of one path."""
    for i, point in enumerate(points):
        if ("eye" in point) != ("eye" in points[0]) and {"eye", "distance"} & point.keys():
            yield ("waypoints", i), "either all waypoints have an eye, or all distance, azimuth and elevation"
    needed = any("lookat" in point or "distance" in point for point in points)
    for i, point in enumerate(points):
        if needed and not has_lookat and "lookat" not in point:
            yield ("waypoints", i), "no point to look at: set lookat here or for the path"


def _unordered_times(points: Sequence[Mapping[str, object]]) -> Iterator[tuple[Path, str]]:
    latest = -math.inf
    for i, point in enumerate(points):
        time = point.get("at")
        if isinstance(time, int | float):
            if time <= latest:
                yield ("waypoints", i, "at"), f"expected a time later than {latest:g}, that of the previous waypoint"
            latest = max(latest, time)


class BoundPathRig:
    """A camera on a path with resolved places.

    The speed is constant in the model's initial state: where the path leads around moving objects, it is constant
    relative to them.
    """

    def __init__(self, rig: PathRig, cameras: MujocoCameras, where: str) -> None:
        self._rig, self._where, self.frustum = rig, where, cameras.frustum
        self._around = rig.waypoints[0].eye is None
        self._lookats = _lookats(rig, cameras.model)
        points = np.array([_coordinates(point) for point in rig.waypoints], float)
        times = [point.at for point in rig.waypoints]
        knots = np.array(times, float) if rig.pace == "time" else self._centripetal(points, cameras.data)
        self._straight = rig.curve == "linear"
        self._curve = Curve(knots, points, self._straight, bounded=(0,) if self._around else ())
        self._arc_length = (
            None if rig.pace == "time" else ArcLengthParametrization(knots, lambda x: self._eyes(x, cameras.data))
        )
        if not self._lookats and (points == points[0]).all():
            raise UsageError(f"{where}: no direction of view: the waypoints coincide, and there is no lookat")

    def _centripetal(self, points: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        lengths = orbital_lengths(points) if self._around else np.linalg.norm(np.diff(points, axis=0), axis=1)
        if self._around:
            targets = np.array([target.position(data) for target in self._lookats])
            lengths = np.hypot(lengths, np.linalg.norm(np.diff(targets, axis=0), axis=1))
        least = SAME_POINT * np.abs(points[:, :1] if self._around else points).max()
        for i, length in enumerate(lengths, 1):
            if length <= least:
                raise UsageError(
                    f"{self._where}: waypoints {i} and {i + 1} coincide, which constant speed does not allow; "
                    "give the waypoints times with pace: time"
                )
        return centripetal(lengths)

    def _targets(self, x: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        """Returns the targets `(m, 3)` [m]."""
        points = np.array([target.position(data) for target in self._lookats])
        return Curve(self._curve.knots, points, self._straight).at(x)

    def _eyes(self, x: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        """Returns positions of the camera `(m, 3)` [m]."""
        points = self._curve.at(x)
        return self._targets(x, data) + orbital_position(points) if self._around else points

    def pose(self, data: mujoco.MjData, at: ShotTime) -> CameraPose:
        x = self._arc_length.at(EASINGS[self._rig.ease](at.phase)) if self._arc_length else at.elapsed
        here = np.array([x])
        if self._around:
            distance, azimuth, elevation = self._curve.at(here)[0]
            return around(self._targets(here, data)[0], float(distance), azimuth, elevation, self.frustum)
        eye = self._curve.at(here)[0]
        if not self._lookats:
            return CameraPose(eye, rotation(*heading(self._curve.direction(x))), self.frustum)
        return looking_at(eye, self._targets(here, data)[0], self.frustum, self._where, at)


def _coordinates(point: Waypoint) -> Sequence[float]:
    if point.eye is not None:
        return point.eye
    assert point.distance is not None
    assert point.azimuth is not None
    assert point.elevation is not None
    return point.distance, point.azimuth, point.elevation


def _lookats(rig: PathRig, model: mujoco.MjModel) -> list[BoundObjectOrPoint]:
    """Returns the target of each waypoint; empty if the camera looks along the path."""
    targets: list[BoundObjectOrPoint] = []
    for i, point in enumerate(rig.waypoints):
        place = rig.lookat if point.lookat is None else point.lookat
        if place is not None:
            with concerning(*(("lookat",) if point.lookat is None else ("waypoints", i, "lookat"))):
                targets.append(find_target(place, model))
    return targets
