"""Curves through points, and the length along them."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

SAMPLES = 512  # samples of a curve between two waypoints, for measuring its length
SAME_POINT = 1e-9  # share of a curve's length below which two points count as the same
_NUDGE = 1e-3  # share of a segment after which the direction of a curve is clear beyond a halt


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


class ArcLength:
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
