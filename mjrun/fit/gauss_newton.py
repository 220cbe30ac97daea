"""Damped Gauss-Newton steps for multiple shooting: parameters within bounds, and the state of every chunk.

Slopes to the states, most of the cost, are kept from step to step by secant updates and taken again only where a step
does less than they promise. D. W. Marquardt, "An algorithm for least-squares estimation of nonlinear parameters"
(1963); C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations" (1965).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.fit.normal_equations import Slopes, normal_equations
from mjrun.fit.shooting_problem import Advanced, Point, ShootingProblem, Simulating
from mjrun.fit.solution import Floats, Solution, loss_weights

EVALUATIONS = 120  # of the residuals, at most
TOLERANCE = 1e-6  # relative change of the cost at which a search ends
STAGE_EVALUATIONS = 40  # of stages that others follow, at most
ROUGH_TOLERANCE = 1e-4  # relative change of the cost at which stages end that others follow
EXPLAINED = 1.25  # reduced χ² with which no other way is tried
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e8
STRONG = 1e-5  # damping with which little gain is no end: it may be that of a direction that hardly shows
DAMPINGS = (10.0, 100.0, 1000.0)  # times the damping of a step that has failed, all tried at once
SLOW, STALLED = 0.01, 3  # relative gain of a step, and how many such steps end a search that is far from the noise
LONG_STALLED = 10  # such steps that end a search which explains the log
FAR = 100.0  # mean square of residuals from which on a search is far from the noise
GOOD = 0.5  # share of the promised decrease with which slopes are kept


@dataclass(frozen=True, eq=False)
class _Place:
    """A point and what is known there: residuals of each chunk, `(n, signals)`, and half the sum of squares."""

    point: Point
    residuals: list[Floats]
    cost: float


class GaussNewton:
    """Minimizes the sum of squares of a problem.

    Args:
      advanced: called with every solution that is better than the one before, without slopes.
    """

    def __init__(self, problem: ShootingProblem, advanced: Advanced | None = None) -> None:
        self._problem, self._advanced = problem, advanced

    def minimize(self, evaluations: int = EVALUATIONS, tolerance: float = TOLERANCE) -> Simulating[Solution]:
        """Searches from the start of the problem.

        Args:
          evaluations: of the residuals, at most.
          tolerance: relative change of the cost at which it ends.
        """
        place, slopes = yield from self._descended(evaluations, tolerance)
        if self._problem.free:  # otherwise only the states are of use
            if not slopes.is_fresh:
                slopes = yield from self._slopes(place)
            slopes = yield from self._sound(place, slopes)
        return self._solution(place, slopes)

    def approach(self, evaluations: int = STAGE_EVALUATIONS) -> Simulating[Solution]:
        """Searches for a point from which longer stretches are searched: it ends where the model explains the log.

        Slopes of the solution are rough.
        """
        return self._solution(*(yield from self._descended(evaluations, ROUGH_TOLERANCE, EXPLAINED)))

    def look(self) -> Simulating[Solution]:
        """The start itself, with slopes."""
        return self._solution(*(yield from self._descended(evaluations=0, tolerance=0.0)))

    def _places(self, points: Sequence[Point]) -> Simulating[list[_Place]]:
        all_residuals = yield from self._problem.residuals(points)
        return [_Place(p, r, self._problem.cost(p, r)) for p, r in zip(points, all_residuals, strict=True)]

    def _slopes(self, place: _Place) -> Simulating[Slopes]:
        pair = yield from self._problem.slopes(place.point, place.residuals)
        return Slopes(*pair)

    def _sound(self, place: _Place, slopes: Slopes) -> Simulating[Slopes]:
        """The smaller of differences forwards and backwards: one of them may cross a place where the motion jumps."""
        backwards = yield from self._problem.slopes(place.point, place.residuals, wider=-1.0)
        of_coordinates, of_states = (
            [np.where(np.abs(a) < np.abs(b), a, b) for a, b in zip(one, other, strict=True)]
            for one, other in zip((slopes.of_coordinates, slopes.of_states), backwards, strict=True)
        )
        return Slopes(of_coordinates, of_states)

    def _descended(self, evaluations: int, tolerance: float, enough: float = 0.0) -> Simulating[tuple[_Place, Slopes]]:
        """Steps downhill until there is no more to gain.

        Args:
          enough: reduced χ² at which it ends.
        """
        (place,) = yield from self._places([self._problem.start])
        slopes = yield from self._slopes(place)
        damping, used, slow, has_failed = FIRST_DAMPING, 0, 0, False
        numbers = sum(int(known.sum()) for known in self._problem.known)
        unknowns = self._problem.free + len(self._problem.parts) * self._problem.size
        far, explained = 0.5 * FAR * numbers, 0.5 * EXPLAINED * numbers
        near = 0.5 * enough * max(numbers - unknowns, 0)
        while used < evaluations and place.cost > near:
            is_lost = slow >= STALLED and (place.cost > far or enough > 0)
            if is_lost or (slow >= LONG_STALLED and place.cost < explained):
                break
            trials = [damping * factor for factor in (DAMPINGS if has_failed else (1.0,))]
            steps = [self._step(place, slopes, trial) for trial in trials]
            points = [point for point, _ in steps]
            places = yield from self._places(points)
            used += len(points)
            best = min(range(len(places)), key=lambda index: places[index].cost)
            gain, promise = place.cost - places[best].cost, steps[best][1]
            had_failed, has_failed = has_failed, gain <= 0
            slow = slow + 1 if gain <= SLOW * place.cost else 0
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

    def _renewed(self, before: _Place, place: _Place, slopes: Slopes, is_good: bool) -> Simulating[Slopes]:
        """Slopes at `place`: to the coordinates by differences, to the states by secants if these have been good."""
        if not is_good:
            return (yield from self._slopes(place))
        of_coordinates, _ = yield from self._problem.slopes(place.point, place.residuals, of_states=False)
        moves = place.point.deviations - before.point.deviations
        turned = place.point.coordinates[: self._problem.free] - before.point.coordinates[: self._problem.free]
        of_states: list[Floats] = []
        for i, (slope, move) in enumerate(zip(slopes.of_states, moves, strict=True)):
            lengths_of_chunk = np.sqrt((slope**2).sum(axis=(0, 1)))
            scaled = move * np.maximum(lengths_of_chunk, 1e-9) ** 2  # so that numbers of all units count alike
            change = place.residuals[i] - before.residuals[i] - slopes.of_coordinates[i] @ turned - slope @ move
            size = float(move @ scaled)
            of_states.append(slope + change[..., None] * scaled / size if size > 0 else slope)
        return Slopes(of_coordinates, of_states, is_fresh=False)

    def _step(self, place: _Place, slopes: Slopes, damping: float) -> tuple[Point, float]:
        """A damped step within bounds, and by how much it promises to reduce the cost."""
        problem, free = self._problem, self._problem.free
        weights = [loss_weights(problem.loss, r) for r in place.residuals]
        normal = normal_equations(problem, place.point, place.residuals, slopes, weights, damping)
        turn, moves = normal.step(place.point.coordinates[:free])
        coordinates = place.point.coordinates.copy()
        coordinates[:free] = np.clip(coordinates[:free] + turn, 0, 1)
        point = Point(coordinates, place.point.deviations + moves)
        expected = [
            r + a @ turn + b @ move
            for r, a, b, move in zip(place.residuals, slopes.of_coordinates, slopes.of_states, moves, strict=True)
        ]
        return point, place.cost - problem.cost(point, expected)

    def _solution(self, place: _Place, slopes: Slopes) -> Solution:
        pairs = zip(slopes.of_coordinates, slopes.of_states, strict=True)
        return self._problem.solution(place.point, place.residuals, list(pairs))
