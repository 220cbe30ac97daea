"""Damped Gauss-Newton steps for multiple shooting: parameters within bounds, and the state of every chunk.

The states of a chunk show in its own rows alone, so that they are eliminated chunk by chunk, and only a matrix of the
size of the parameters is left. Slopes to the states, most of the cost, are kept from step to step by secant updates and
taken again only where a step does less than they promise. D. W. Marquardt, "An algorithm for least-squares estimation
of nonlinear parameters" (1963); C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations"
(1965).

Contacts make a motion rough: a box that slides rattles, and states that measurements cannot distinguish lead to other
rattling. Slopes there are those that fit the residuals at an ensemble of points all around best, as far away as
standard errors reach (as in M. A. Iglesias, K. J. H. Law, A. M. Stuart, "Ensemble Kalman methods for inverse problems",
2013).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.fit.shooting_problem import (
    STATE_SCALE,
    Point,
    ShootingProblem,
    Simulating,
    Steps,
)
from mjrun.fit.solution import LOSS_SLOPES, LOSSES, Floats, Solution

EVALUATIONS = 120  # of the residuals, at most, until the widths of steps change
TOLERANCE = 1e-6  # relative change of the cost at which a search ends
ROUGH_TOLERANCE = 1e-3  # the same where it is rough
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e8
STRONG = 1e-5  # damping with which little gain is no end: it may be that of a direction that hardly shows
DAMPINGS = (10.0, 100.0, 1000.0)  # times the damping of a step that has failed, all tried at once
GOOD = 0.5  # share of the promised decrease with which slopes are kept
TRIED = (0.0, 0.1, 1.0, 10.0, 100.0)  # dampings of the steps of an ensemble
ROUNDS = 12  # of an ensemble, at most
SLOW = 0.003  # relative gain of a round, after which points come nearer to the middle
LEAST_SPREAD = 0.2  # standard errors between the points of an ensemble and its middle, at the end
FARTHEST = 0.1  # that a point of an ensemble is from the middle, in any unknown
ROUNDING = 1e-14  # smallest share of the largest eigenvalue of normal equations that counts
COARSE = 100.0  # times the steps that suit smooth motions, where an ensemble begins

Advanced = Callable[[Solution], None]


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Slopes of the residuals of each chunk.

    Attributes:
      of_coordinates: `(n, signals, p)`.
      of_states: `(n, signals, size)`.
      is_fresh: whether both are differences at the point itself.
    """

    of_coordinates: Sequence[Floats]
    of_states: Sequence[Floats]
    is_fresh: bool = True


@dataclass(frozen=True, eq=False)
class _Place:
    """A point and what is known there: residuals of each chunk, `(n, signals)`, and half the sum of squares."""

    point: Point
    residuals: list[Floats]
    cost: float


class GaussNewton:
    """Minimizes the sum of squares of a problem.

    Args:
      loss: of scipy's `least_squares`.
      advanced: called with every solution that is better than the one before, without slopes.
    """

    def __init__(
        self, problem: ShootingProblem, loss: str, seed: int, is_rough: bool, advanced: Advanced | None = None
    ) -> None:
        self._problem, self._loss, self._is_rough, self._advanced = problem, loss, is_rough, advanced
        self._generator = np.random.default_rng(seed)
        self._steps = problem.fine

    def minimize(self, evaluations: int = EVALUATIONS, tolerance: float = TOLERANCE) -> Simulating[Solution]:
        """Searches from the start of the problem.

        Args:
          evaluations: of the residuals, at most, for each width of steps.
          tolerance: relative change of the cost at which it ends.
        """
        place = yield from self._place(self._problem.start)
        if self._is_rough:
            self._steps = Steps(COARSE * self._steps.coordinates, COARSE * self._steps.states)
        slopes = yield from self._slopes(place)
        if self._is_rough:
            place, slopes = yield from self._ensemble(place, slopes)
        else:
            place, slopes = yield from self._descended(place, slopes, evaluations, tolerance)
            if not slopes.is_fresh:
                slopes = yield from self._slopes(place)
        return self._solution(place, slopes)

    def _ensemble(self, place: _Place, slopes: _Slopes) -> Simulating[tuple[_Place, _Slopes]]:
        """Steps downhill by slopes that fit points all around, as far away as measurements cannot tell.

        The best of these points and of the steps is the next middle.
        """
        size, spread = self._problem.free + self._problem.size, 1.0
        for _ in range(ROUNDS):
            normal = self._normal(place, slopes, 0.0)
            scales = [_inverse_root(self._own(slopes, i)) for i in range(len(self._problem.parts))]
            scale = _inverse_root(normal.matrix)
            turned, _ = np.linalg.qr(self._generator.normal(size=(size, size)))
            directions = spread * np.concatenate([turned, -turned])
            places = yield from self._places(
                [self._around(place.point, normal, scale, scales, each) for each in directions]
            )
            slopes = self._regressed(place, places)
            steps = yield from self._places([self._step(place, slopes, damping)[0] for damping in TRIED])
            best = min([*places, *steps], key=lambda each: each.cost)
            gain, before = place.cost - best.cost, place.cost
            if gain > 0:
                place = best
                if self._advanced:
                    self._advanced(self._solution(place, slopes))
            if gain < SLOW * before:
                spread *= 0.5
            if spread < LEAST_SPREAD:
                break
        return place, slopes

    def _around(
        self, middle: Point, normal: "_NormalEquations", scale: Floats, scales: Sequence[Floats], direction: Floats
    ) -> Point:
        """A point in a direction in which all unknowns have unit variance; states follow the coordinates."""
        free = self._problem.free
        coordinates = middle.coordinates.copy()
        coordinates[:free] = np.clip(coordinates[:free] + np.clip(scale @ direction[:free], -FARTHEST, FARTHEST), 0, 1)
        turn = (coordinates - middle.coordinates)[:free]
        moves = np.stack([each @ direction[free:] for each in scales]) - normal.state_slopes @ turn
        return Point(coordinates, middle.deviations + np.clip(moves, -FARTHEST, FARTHEST))

    def _regressed(self, middle: _Place, places: Sequence[_Place]) -> _Slopes:
        """The slopes that fit the residuals at `places` best."""
        free = self._problem.free
        turns = np.stack([(each.point.coordinates - middle.point.coordinates)[:free] for each in places])
        of_coordinates: list[Floats] = []
        of_states: list[Floats] = []
        for i, residuals in enumerate(middle.residuals):
            moves = np.stack([each.point.deviations[i] - middle.point.deviations[i] for each in places])
            unknowns = np.concatenate([turns, moves], axis=1)
            lengths_of_unknowns = np.maximum(np.sqrt((unknowns**2).mean(axis=0)), 1e-300)
            all_residuals = np.stack([each.residuals[i].ravel() for each in places])
            fitted = np.linalg.lstsq(
                unknowns / lengths_of_unknowns, all_residuals - all_residuals.mean(axis=0), rcond=1e-9
            )[0]
            slopes = (fitted / lengths_of_unknowns[:, None]).T.reshape(*residuals.shape, -1)
            of_coordinates.append(slopes[..., :free])
            of_states.append(slopes[..., free:])
        return _Slopes(of_coordinates, of_states)

    def look(self) -> Simulating[Solution]:
        """The start itself, with slopes."""
        place = yield from self._place(self._problem.start)
        slopes = yield from self._slopes(place)
        return self._solution(place, slopes)

    def _place(self, point: Point) -> Simulating[_Place]:
        (place,) = yield from self._places([point])
        return place

    def _places(self, points: Sequence[Point]) -> Simulating[list[_Place]]:
        all_residuals = yield from self._problem.residuals(points)
        return [_Place(p, r, self._cost(p, r)) for p, r in zip(points, all_residuals, strict=True)]

    def _cost(self, point: Point, residuals: Sequence[Floats]) -> float:
        loss, problem = LOSSES[self._loss], self._problem
        squares = sum(float(loss(r[k] ** 2).sum()) for r, k in zip(residuals, problem.known, strict=True))
        priors, _ = problem.priors(point.coordinates)
        return 0.5 * (squares + float(((point.deviations / STATE_SCALE) ** 2).sum()) + float(priors @ priors))

    def _slopes(self, place: _Place) -> Simulating[_Slopes]:
        pair = yield from self._problem.slopes(place.point, place.residuals, self._steps)
        return _Slopes(*pair)

    def _descended(
        self, place: _Place, slopes: _Slopes, evaluations: int, tolerance: float
    ) -> Simulating[tuple[_Place, _Slopes]]:
        """Steps downhill until there is no more to gain."""
        damping, used, has_failed = FIRST_DAMPING, 0, False
        while used < evaluations:
            trials = [damping * factor for factor in (DAMPINGS if has_failed else (1.0,))]
            steps = [self._step(place, slopes, trial) for trial in trials]
            points = [point for point, _ in steps]
            places = yield from self._places(points)
            used += len(points)
            best = min(range(len(places)), key=lambda index: places[index].cost)
            gain, promise = place.cost - places[best].cost, steps[best][1]
            had_failed, has_failed = has_failed, gain <= 0
            is_end = max(gain, promise) <= tolerance * place.cost and trials[best] <= STRONG
            if gain > 0:
                before, place = place, places[best]
                if self._advanced:
                    self._advanced(self._solution(place, slopes))
                if is_end and slopes.is_fresh:
                    return place, slopes
                is_good = gain > GOOD * promise and not is_end
                slopes = yield from self._renewed(before, place, slopes, is_good)
                is_easier = gain > GOOD * promise and not had_failed
                damping = max(trials[best] / (10.0 if is_easier else 1.0), LEAST_DAMPING)
            elif not slopes.is_fresh:
                slopes = yield from self._slopes(place)
            elif is_end or trials[-1] >= MOST_DAMPING:
                break
            else:
                damping = trials[-1]
        return place, slopes

    def _renewed(self, before: _Place, place: _Place, slopes: _Slopes, is_good: bool) -> Simulating[_Slopes]:
        """Slopes at `place`: to the coordinates by differences, to the states by secants if these have been good."""
        if not is_good:
            return (yield from self._slopes(place))
        of_coordinates, _ = yield from self._problem.slopes(place.point, place.residuals, self._steps, of_states=False)
        moves = place.point.deviations - before.point.deviations
        turned = place.point.coordinates[: self._problem.free] - before.point.coordinates[: self._problem.free]
        of_states: list[Floats] = []
        for i, (slope, move) in enumerate(zip(slopes.of_states, moves, strict=True)):
            lengths_of_chunk = np.sqrt((slope**2).sum(axis=(0, 1)))
            scaled = move * np.maximum(lengths_of_chunk, 1e-9) ** 2  # so that numbers of all units count alike
            change = place.residuals[i] - before.residuals[i] - slopes.of_coordinates[i] @ turned - slope @ move
            size = float(move @ scaled)
            of_states.append(slope + change[..., None] * scaled / size if size > 0 else slope)
        return _Slopes(of_coordinates, of_states, is_fresh=False)

    def _step(self, place: _Place, slopes: _Slopes, damping: float) -> tuple[Point, float]:
        """A damped step within bounds, and by how much it promises to reduce the cost."""
        normal = self._normal(place, slopes, damping)
        coordinates = place.point.coordinates
        turn = np.zeros(len(coordinates))
        turn[: self._problem.free] = _within(normal.matrix, normal.gradient, coordinates[: self._problem.free])
        move = -normal.state_steps - normal.state_slopes @ turn[: self._problem.free]
        point = Point(np.clip(coordinates + turn, 0, 1), place.point.deviations + move)
        return point, place.cost - self._promised(place, slopes, turn[: self._problem.free], point)

    def _promised(self, place: _Place, slopes: _Slopes, turn: Floats, point: Point) -> float:
        """The cost that the slopes promise at a point."""
        moves = point.deviations - place.point.deviations
        expected = [
            r + a @ turn + b @ move
            for r, a, b, move in zip(place.residuals, slopes.of_coordinates, slopes.of_states, moves, strict=True)
        ]
        return self._cost(point, expected)

    def _normal(self, place: _Place, slopes: _Slopes, damping: float) -> "_NormalEquations":
        problem, size = self._problem, self._problem.size
        priors, prior_slopes = problem.priors(place.point.coordinates)
        matrix, gradient = np.diag(prior_slopes**2), prior_slopes * priors
        diagonal = prior_slopes**2
        state_steps, state_slopes = (
            np.zeros((len(problem.parts), size)),
            np.zeros((len(problem.parts), size, problem.free)),
        )
        for i, (residuals, known) in enumerate(zip(place.residuals, problem.known, strict=True)):
            r = residuals[known]
            weights = np.sqrt(LOSS_SLOPES[self._loss](r**2))
            r, a, b = (
                weights * r,
                weights[:, None] * slopes.of_coordinates[i][known],
                weights[:, None] * slopes.of_states[i][known],
            )
            own = _information(b)
            own += damping * np.diag(np.diag(own))
            right = np.column_stack([b.T @ a, b.T @ r + place.point.deviations[i] / STATE_SCALE**2])
            solved = _solved(own, right)
            state_slopes[i], state_steps[i] = solved[:, :-1], solved[:, -1]
            matrix += a.T @ a - right[:, :-1].T @ solved[:, :-1]
            gradient += a.T @ r - right[:, :-1].T @ solved[:, -1]
            diagonal += (a**2).sum(axis=0)
        matrix += np.diag(damping * diagonal + 1e-12 * max(float(diagonal.max(initial=0.0)), 1e-12))
        return _NormalEquations(matrix, gradient, state_steps, state_slopes)

    def _own(self, slopes: _Slopes, chunk: int) -> Floats:
        """What the rows of a chunk say of its state, `(size, size)`."""
        return _information(slopes.of_states[chunk][self._problem.known[chunk]])

    def _solution(self, place: _Place, slopes: _Slopes) -> Solution:
        problem = self._problem
        shown = [np.where(known, r, np.nan) for r, known in zip(place.residuals, problem.known, strict=True)]
        return Solution(
            problem.parts,
            place.point.coordinates,
            problem.states(place.point),
            shown,
            list(zip(slopes.of_coordinates, slopes.of_states, strict=True)),
            problem.noise,
            self._loss,
        )


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Of the coordinates alone, `(p, p)` and `(p,)`; and how states follow: a step each, and slopes to coordinates."""

    matrix: Floats
    gradient: Floats
    state_steps: Floats
    state_slopes: Floats


def _within(matrix: Floats, gradient: Floats, coordinates: Floats) -> Floats:
    """The step that solves the normal equations, `(p,)`; coordinates that would leave 0 to 1 stop at the bound."""
    step, is_free = np.zeros(len(gradient)), np.ones(len(gradient), bool)
    while is_free.any():
        inner = np.ix_(is_free, is_free)
        right = gradient[is_free] + matrix[np.ix_(is_free, ~is_free)] @ step[~is_free]
        step[is_free] = -np.linalg.lstsq(matrix[inner], right, rcond=None)[0]
        beyond = is_free & ((coordinates + step < 0) | (coordinates + step > 1))
        if not beyond.any():
            break
        step[beyond] = np.where(step[beyond] < 0, 0.0, 1.0) - coordinates[beyond]
        is_free &= ~beyond
    return step


def _information(slopes: Floats) -> Floats:
    """What rows say of a state, `(size, size)`, with what holds it in place."""
    return slopes.T @ slopes + np.eye(slopes.shape[1]) / STATE_SCALE**2


def _solved(matrix: Floats, right: Floats) -> Floats:
    """The solution of normal equations; steep slopes can hide what holds a state in place, beyond rounding."""
    scale = np.sqrt(np.diag(matrix))
    return np.linalg.lstsq(matrix / scale / scale[:, None], right / scale[:, None], rcond=ROUNDING)[0] / scale[:, None]


def _inverse_root(matrix: Floats) -> Floats:
    """Columns that have unit length by `matrix`, orthogonally: standard errors in all directions."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors / np.sqrt(np.maximum(values, 1e-12 * max(float(values.max(initial=0.0)), 1e-300)))
