"""Regression on simulated logs, for motions that contacts make rough.

A box that sticks and slides rattles differently after every change of a last digit, so the sum of squares jumps between
neighbouring points: derivatives mislead, and searches end wherever a simulation happens to resemble the log. But the
log differs from simulations as these differ from each other. Each round draws parameters and states, simulates them and
adds the noise of the log. A ridge regression of what was drawn on the simulated logs, applied to the real one, gives
estimates, and its errors for simulated logs that it has not seen are those of the estimates. The next round draws
nearer to them. Sources: M. A. Beaumont, W. Zhang, D. J. Balding, "Approximate Bayesian computation in population
genetics" (2002); P. Fearnhead, D. Prangle, "Constructing summary statistics for approximate Bayesian computation"
(2012).
"""

from collections.abc import Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.gauss_newton import state_spread
from mjrun.fitting.shooting_problem import (
    PENALTY,
    Advanced,
    Floats,
    RegressionEstimate,
    ShootingProblem,
    Simulating,
    Solution,
    Unknowns,
    loss_weights,
)

SIMULATIONS = 200  # per round
LEAST_SIMULATIONS = 50  # that must not fail
BATCH = 50  # points that are simulated at once
MOST_ROUNDS = 16
MOST_BEYOND = 3  # rounds whose estimates may lie beyond what was drawn, as those of a wrong model do
WIDE = 0.3  # standard deviation of coordinates in the first round
DOUBTFUL = 3.0  # standard deviation of states in the first round, in errors of the first rows
FARTHEST = 0.3  # largest deviation of a state in the first round
BEYOND = 2.0  # standard deviation of later rounds, in errors of the one before
SETTLED = 0.8  # ratio of errors to the least before at which a round is no better
LONG_SETTLED = 2  # consecutive rounds that are no better and end the search
LEAST_GAIN = 0.25  # least explained share of a variance, in the correction for the width of the last round
MOST_TRIALS = 20  # draws of a point until its coordinates are within bounds
RIDGES = np.geomspace(0.1, 1e6, 29)  # penalties that are compared, in variances of the noise


@dataclass(frozen=True, eq=False)
class _Round:
    """Points of a round, and their simulated logs.

    Attributes:
      unknowns: coordinates, then the deviations of all states, `(points, unknowns)`.
      residuals: weighted residuals of the simulations, `(points, numbers)`.
    """

    unknowns: Floats
    residuals: Floats


class RegressionSearch:
    """A search for the unknowns of a problem by regression on simulated logs.

    Args:
      opening: the same problem with only the first rows of each chunk, which tell how far the guesses of its states may
        be off.
      seed: seed of all draws.
      advanced: called with the nearest simulation of each round.
    """

    def __init__(
        self, problem: ShootingProblem, opening: ShootingProblem, seed: int, advanced: Advanced | None = None
    ) -> None:
        self._problem, self._opening, self._advanced = problem, opening, advanced
        self._generator = np.random.default_rng(seed)

    def estimate(self) -> Simulating[tuple[Unknowns, RegressionEstimate | None]]:
        """Draws and regresses until the errors no longer decrease.

        Returns the simulation nearest to the log with the estimated coordinates, and the estimate; None if most
        simulations fail.
        """
        free = self._problem.free
        unknowns, nearest = (yield from self._first()), self._problem.start
        limits, before = np.full(unknowns.shape[1], np.inf), np.full(unknowns.shape[1], np.inf)
        rounds, beyond, settled = 0, 0, 0
        while True:
            rounds += 1
            drawn, nearest = yield from self._simulated(unknowns, nearest)
            if len(drawn.unknowns) < LEAST_SIMULATIONS:
                return nearest, None
            if self._advanced:
                self._advanced((yield from self._solution(nearest)))
            regressed, errors = self._regressed(drawn)
            estimate = self._near(regressed, drawn)
            is_beyond = bool((estimate != regressed)[:free].any())
            beyond += is_beyond
            widths = np.sqrt((errors**2).mean(axis=0))
            limits = np.minimum(limits, drawn.unknowns.std(axis=0))
            wider = np.minimum(BEYOND, limits / np.maximum(widths, 1e-300))
            unknowns = self._within(estimate, wider * errors / np.sqrt(len(errors)))
            decisive = slice(free) if free else slice(None)
            is_better = is_beyond or (widths < SETTLED * before)[decisive].any()
            settled = 0 if is_better else settled + 1
            if settled == LONG_SETTLED or rounds == MOST_ROUNDS or beyond == MOST_BEYOND:
                break
            before = np.minimum(before, widths)

        gains = 1 - widths**2 / np.maximum(drawn.unknowns.var(axis=0), 1e-300)
        errors = errors / np.sqrt(np.maximum(gains, LEAST_GAIN))  # draws near an estimate hold it there, like a prior
        draws = np.clip(estimate[:free] + errors[:, :free], 0, 1)
        unknowns[:, :free] = estimate[:free]
        _, nearest = yield from self._simulated(unknowns, self._point(estimate))
        return nearest, RegressionEstimate(draws, self._probability(drawn))

    def _solution(self, point: Unknowns) -> Simulating[Solution]:
        (residuals,) = yield from self._problem.residuals([point])
        jacobians = yield from self._problem.jacobians(point, residuals)
        return self._problem.solution(point, residuals, list(zip(*jacobians, strict=True)))

    def _first(self) -> Simulating[Floats]:
        roots = yield from state_spread(self._opening)
        start, free = self._problem.start, self._problem.free
        coordinates = self._within(start.coordinates[:free], WIDE * np.eye(free))
        drawn = DOUBTFUL * self._generator.normal(size=(SIMULATIONS, *roots.shape[:2]))
        moves = np.clip(np.einsum("cij,ncj->nci", roots, drawn), -FARTHEST, FARTHEST)
        return np.concatenate([coordinates, (start.deviations + moves).reshape(SIMULATIONS, -1)], axis=1)

    def _within(self, middle: Floats, roots: Floats) -> Floats:
        """Draws points from a normal distribution, where possible with coordinates from 0 to 1.

        Args:
          roots: rows that add up to deviations, multiplied by independent normal numbers.
        """
        free = self._problem.free
        points = middle + self._generator.normal(size=(SIMULATIONS, len(roots))) @ roots
        for _ in range(MOST_TRIALS):
            is_outside = ((points[:, :free] < 0) | (points[:, :free] > 1)).any(axis=1)
            points[is_outside] = middle + self._generator.normal(size=(int(is_outside.sum()), len(roots))) @ roots
        points[:, :free] = np.clip(points[:, :free], 0, 1)
        return points

    def _point(self, unknowns: Floats) -> Unknowns:
        problem = self._problem
        coordinates = problem.start.coordinates.copy()
        coordinates[: problem.free] = unknowns[: problem.free]
        return Unknowns(coordinates, unknowns[problem.free :].reshape(len(problem.parts), problem.size))

    def _simulated(self, unknowns: Floats, nearest: Unknowns) -> Simulating[tuple[_Round, Unknowns]]:
        """Simulates points; returns those that do not fail, and the nearest to the log, which `nearest` may remain."""
        points = [nearest, *map(self._point, unknowns)]
        residuals = list[list[Floats]]()
        for first in range(0, len(points), BATCH):
            residuals += yield from self._problem.residuals(points[first : first + BATCH])
        costs = [self._problem.cost(*each) for each in zip(points, residuals, strict=True)]
        best = int(np.argmin(costs))
        weights = [np.sqrt(loss_weights(self._problem.loss, each)) for each in residuals[best]]
        whole = [i for i, one in enumerate(residuals) if i and not any((each == PENALTY).any() for each in one)]
        rows = np.stack([self._row(points[i], residuals[i], weights) for i in whole or [0]])
        return _Round(unknowns[[i - 1 for i in whole]], rows[: len(whole)]), points[best]

    def _row(self, point: Unknowns, residuals: Sequence[Floats], weights: Sequence[Floats]) -> Floats:
        """Returns the weighted residuals of a point, and those of priors, which count as measurements."""
        priors, _ = self._problem.priors(point.coordinates)
        known = zip(residuals, weights, self._problem.known, strict=True)
        return np.concatenate([*((r * w)[is_known] for r, w, is_known in known), priors])

    def _regressed(self, drawn: _Round) -> tuple[Floats, Floats]:
        """Returns the unknowns of the log, `(unknowns,)`, and the errors for the simulated ones, `(points, unknowns)`.

        Each error is that of a regression without the log in question. The penalty of each unknown is the one with the
        least errors.
        """
        logs = self._generator.normal(size=drawn.residuals.shape)
        logs += drawn.residuals
        middle, offset = drawn.unknowns.mean(axis=0), logs.mean(axis=0)
        logs -= offset  # in place, as logs may be long
        targets = drawn.unknowns - middle
        squares, vectors = np.linalg.eigh(logs @ logs.T)
        squares = np.maximum(squares, 0.0)
        projected = vectors.T @ targets
        real = vectors.T @ (logs @ -offset)

        least = np.full(targets.shape[1], np.inf)
        estimate, errors = np.zeros(targets.shape[1]), np.zeros_like(targets)
        for ridge in RIDGES * len(targets):
            shares = squares / (squares + ridge)
            leverages = (vectors**2 * shares).sum(axis=1) + 1 / len(targets)
            left = (targets - vectors @ (shares[:, None] * projected)) / (1 - leverages)[:, None]
            means = (left**2).mean(axis=0)
            is_less = means < least
            least[is_less], errors[:, is_less] = means[is_less], left[:, is_less]
            estimate[is_less] = ((real / (squares + ridge)) @ projected)[is_less]
        estimate += middle
        estimate[: self._problem.free] = np.clip(estimate[: self._problem.free], 0, 1)
        return estimate, errors

    def _near(self, estimate: Floats, drawn: _Round) -> Floats:
        """Returns an estimate moved towards the points of a round, as a regression does not extrapolate."""
        middle, reach = drawn.unknowns.mean(axis=0), BEYOND * drawn.unknowns.std(axis=0)
        return np.clip(estimate, middle - reach, middle + reach)

    def _probability(self, drawn: _Round) -> float:
        """Returns the rank of the log among simulated ones by the median distance to the simulations."""
        rows = drawn.residuals
        logs = np.concatenate([np.zeros((1, rows.shape[1])), rows + self._generator.normal(size=rows.shape)])
        lengths = (rows**2).sum(axis=1)
        distances = (logs**2).sum(axis=1)[:, None] - 2 * logs @ rows.T + lengths
        others = ~np.eye(len(rows), dtype=bool)
        real = np.median(distances[0])
        simulated = np.array([np.median(each[is_other]) for each, is_other in zip(distances[1:], others, strict=True)])
        return float((1 + (simulated >= real).sum()) / (1 + len(simulated)))
