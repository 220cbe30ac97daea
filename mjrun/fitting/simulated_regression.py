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

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from mjrun.dataclass import dataclass
from mjrun.fitting.correlated_noise import portmanteau, slow_power, whitened
from mjrun.fitting.gauss_newton import solve_normal, state_spread
from mjrun.fitting.shooting_problem import (
    PENALTY,
    Advanced,
    Floats,
    RoughMotionEstimate,
    ShootingProblem,
    Simulating,
    Solution,
    Unknowns,
    UnmodelledEffect,
    loss_weights,
)
from mjrun.model.override import Override

SIMULATIONS = 200  # per round
LEAST_SIMULATIONS = 50  # that must not fail
BATCH, BATCH_NUMBERS = (16, 50), 10**6  # points that are simulated at once, and their residuals if the log is long
NEIGHBOURS = 2  # rows before and after another that show whether it is an outlier
PART = 4096  # numbers of all logs that are multiplied at once
MOST_ROUNDS = 16
MOST_BEYOND = 3  # rounds whose estimates may lie beyond what was drawn, as those of a wrong model do
WIDE = 0.3  # standard deviation of coordinates in the first round
DOUBTFUL = 3.0  # standard deviation of states in the first round, in errors of the first rows by white noise
FARTHEST = 0.3  # largest deviation of a state in the first round
BEYOND = 2.0  # standard deviation of later rounds, in errors of the one before
SETTLED = 0.8  # ratio of errors to the least before at which a round is no better
LONG_SETTLED = 2  # consecutive rounds that are no better and end the search
LEAST_GAIN = 0.25  # least explained share of a variance, in the correction for the width of the last round
FOLDS = 10  # parts of the simulations, each of which is compared with the others
NOISE_TOLERANCE = 1.25  # ratio of squared distances that an error of the noise may cause
LINEAR_ROUNDS = 3  # last rounds that show how simulations depend on the unknowns
CHANGED = 20  # simulations of a change of the model, per approximation of what compensates for it
APPROXIMATIONS = 2
REACH = 100.0  # standard deviation of what compensates for a change of the model, in those of the last round
CERTAIN = 3.0  # standard deviations beyond which a log shows a change: 1 % for three, with `NOISE_TOLERANCE`
MOST_TRIALS = 20  # draws of a point until its coordinates are within bounds
# Correlations of consecutive samples, and standard deviations in those of white noise, that are compared.
CORRELATIONS = np.append(np.arange(0, 10) / 10, (0.95, 0.98))
SCALES = np.geomspace(0.1, 100, 61)
CORRELATED = 15.0  # twice the difference of logarithmic likelihoods beyond which noise is correlated
LEAST_RATIO = 4.0  # of the gain by correlated noise to that by what a model lacks: below, the model lacks something
LEAST_WHITENESS = 0.01  # probability below which what simulations do not explain is more than noise
RIDGES = np.geomspace(0.1, 1e6, 29)  # penalties that are compared, in variances of the noise


@dataclass(frozen=True, eq=False)
class _Round:
    """Points of a round, and their simulated logs.

    Attributes:
      unknowns: coordinates, then the deviations of all states, `(points, unknowns)`.
      residuals: residuals of the simulations, and those of priors, `(points, numbers)`.
      weights: weights of the residuals under the loss, `(numbers,)`.
    """

    unknowns: Floats
    residuals: Floats
    weights: Floats

    def parts(self) -> Iterator[tuple[slice, Floats]]:
        """Returns weighted residuals of consecutive numbers, `(points, at most PART)`, as logs may be long."""
        for first in range(0, len(self.weights), PART):
            part = slice(first, first + PART)
            yield part, self.residuals[:, part] * self.weights[part]

    def centred(self) -> Floats:
        """Returns the unknowns without their means, `(points, unknowns)`."""
        return self.unknowns - self.unknowns.mean(axis=0)

    def covariance(self) -> tuple[Floats, Floats]:
        """Returns the scatter of the unknowns, `(unknowns, unknowns)`, and theirs with the residuals."""
        centred = self.centred()
        return centred.T @ centred, np.concatenate([centred.T @ rows for _, rows in self.parts()], axis=1)


class RegressionSearch:
    """A search for the unknowns of a problem by regression on simulated logs.

    Args:
      opening: the same problem with only the first rows of each chunk, which tell how far the guesses of its states may
        be off.
      seed: seed of all draws.
      advanced: called with the nearest simulation of each round.
      noise: noise that is correlated from sample to sample, to begin with; None for white noise with the standard
        deviations of the problem.

    Attributes:
      correlated_noise: noise that explains the log better, after an estimate with white noise; None without any.
    """

    def __init__(
        self,
        problem: ShootingProblem,
        opening: ShootingProblem,
        seed: int,
        advanced: Advanced | None = None,
        *,
        noise: "CorrelatedNoise | None" = None,
    ) -> None:
        self._problem, self._opening, self._advanced = problem, opening, advanced
        self._generator = np.random.default_rng(seed)
        self._covariances = deque[tuple[Floats, Floats]](maxlen=LINEAR_ROUNDS)
        self._widths = np.zeros(0)  # standard deviations of the unknowns in the last round
        self._last: _Round | None = None  # simulations with the estimated coordinates
        self._noise, self.correlated_noise = noise, None
        self._samples = _places_of_samples(problem.known)

    def estimate(self) -> Simulating[tuple[Unknowns, RoughMotionEstimate | None]]:
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
            if self._noise:
                self._noise = self._likeliest_noise(drawn)
                self._whiten(drawn)
            if self._advanced:
                self._advanced((yield from self._solution(nearest)))
            regressed, errors = self._regressed(drawn)
            self._covariances.append(drawn.covariance())
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
            del drawn  # it may take hundreds of megabytes, as the next round does

        gains = 1 - widths**2 / np.maximum(drawn.unknowns.var(axis=0), 1e-300)
        errors = errors / np.sqrt(np.maximum(gains, LEAST_GAIN))  # draws near an estimate hold it there, like a prior
        draws = np.clip(estimate[:free] + errors[:, :free], 0, 1)
        probability = self._probability(drawn)
        correlations = None
        if self._noise:
            if self._noise.correlations.any() and self._has_white_rest(drawn.residuals):
                correlations = self._noise.correlations
        elif self._problem.loss == "linear" and free:
            noise = self._likeliest_noise(drawn)
            self.correlated_noise = noise if noise.correlations.any() else None
        self._widths = drawn.unknowns.std(axis=0)
        del drawn
        unknowns[:, :free] = estimate[:free]
        self._last, nearest = yield from self._simulated(unknowns, self._point(estimate))
        self._whiten(self._last)
        return nearest, RoughMotionEstimate(draws, probability, correlations=correlations)

    def lack(self, changes: Sequence[Override]) -> Simulating[UnmodelledEffect | None]:
        """Returns the change of the model that the log shows most clearly, or None; after an estimate.

        This is a score test: of how simulations change, only what the unknowns cannot compensate for counts, and the
        log is compared with simulated ones in this direction alone. Source: C. R. Rao, "Large sample tests of
        statistical hypotheses concerning several parameters with applications to problems of estimation" (1948).

        Args:
          changes: changes whose sizes change simulations about linearly.
        """
        shown = list[UnmodelledEffect]()
        for change in changes:
            size, deviations = yield from self._shown(change)
            shown.append(UnmodelledEffect(change.path, size * float(change.value), deviations))
        most = max(shown, key=lambda each: each.deviations, default=None)
        return most if most and most.deviations > CERTAIN else None

    def _shown(self, change: Override) -> Simulating[tuple[float, float]]:
        """Returns the size of a change, in its own, and the distance of the log from simulations in its direction."""
        assert self._last
        last, reach = self._last, REACH * np.maximum(self._widths, 1e-12)
        slopes = solve_normal(*(np.sum(each, axis=0) for each in zip(*self._covariances, strict=True)))
        middle = np.concatenate([rows.mean(axis=0) for _, rows in last.parts()])
        shift, products = np.zeros(len(slopes)), None
        for _ in range(APPROXIMATIONS):
            drawn = self._generator.choice(last.unknowns, CHANGED) + shift
            drawn[:, : self._problem.free] = np.clip(drawn[:, : self._problem.free], 0, 1)
            moved, _ = yield from self._simulated(drawn, self._point(drawn[0]), (change,))
            if not len(moved.unknowns):
                return 0.0, 0.0
            self._whiten(moved)
            offset = moved.unknowns.mean(axis=0) - shift - last.unknowns.mean(axis=0)
            effect = moved.residuals.mean(axis=0) * last.weights - middle - offset @ slopes
            products = self._products(slopes, middle, effect)
            shift = shift - products.compensation(reach)
        assert products
        return products.score(products.compensation(reach))

    def _products(self, slopes: Floats, middle: Floats, effect: Floats) -> "_Products":
        """Returns the scalar products for a change of the model with this effect on the simulations.

        Args:
          slopes: derivatives of simulations by the unknowns, `(unknowns, numbers)`.
          middle: mean of the simulations.
        """
        assert self._last
        centred, vectors = self._last.centred(), np.stack([*slopes, effect, -middle])
        count = len(centred)
        sums = [np.zeros((count, count)), np.zeros((count, count + len(vectors)))]
        sums.append(np.zeros((len(vectors), count + len(vectors))))
        for part, rows in self._last.parts():
            rest = rows - middle[part] - centred @ slopes[:, part]
            logs = rest + self._generator.normal(size=rest.shape)
            right = np.concatenate([vectors[:, part], logs])
            for total, left, each in zip(sums, (rest, rest, vectors[:, part]), (rest, right, right), strict=True):
                total += left @ each.T
        return _Products(*sums)

    def _solution(self, point: Unknowns) -> Simulating[Solution]:
        (residuals,) = yield from self._problem.residuals([point])
        jacobians = yield from self._problem.jacobians(point, residuals)
        return self._problem.solution(point, residuals, list(zip(*jacobians, strict=True)))

    def _first(self) -> Simulating[Floats]:
        roots = yield from state_spread(self._opening)
        start, free = self._problem.start, self._problem.free
        coordinates = self._within(start.coordinates[:free], WIDE * np.eye(free))
        doubt = DOUBTFUL * (float(self._noise.scales.max()) if self._noise else 1.0)
        drawn = doubt * self._generator.normal(size=(SIMULATIONS, *roots.shape[:2]))
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

    def _simulated(
        self, unknowns: Floats, nearest: Unknowns, added: tuple[Override, ...] = ()
    ) -> Simulating[tuple[_Round, Unknowns]]:
        """Simulates points; returns those that do not fail, and the nearest to the log, which `nearest` may remain.

        Args:
          added: changes of the model beside the parameters.
        """
        points, least, near = [nearest, *map(self._point, unknowns)], np.inf, list[Floats]()
        numbers = sum(int(each.sum()) for each in self._problem.known) + self._problem.free
        rows = np.empty((len(points), numbers))
        size = int(np.clip(BATCH_NUMBERS // numbers, *BATCH))
        for first in range(0, len(points), size):
            batch = points[first : first + size]
            all_residuals = yield from self._problem.residuals(batch, added)
            for row, point, residuals in zip(rows[first:], batch, all_residuals, strict=False):
                priors, _ = self._problem.priors(point.coordinates)
                np.concatenate([*self._known(residuals), priors], out=row)
                if (cost := self._problem.cost(point, residuals)) < least:
                    least, nearest, near = cost, point, residuals
        whole = [i for i, row in enumerate(rows) if i and not (row == PENALTY).any()]
        for place, i in enumerate(whole):  # in place, as logs may be long
            rows[place] = rows[i]
        weights = [loss_weights(self._problem.loss, _away_from_neighbours(each)) for each in near]
        all_weights = np.concatenate([*self._known(weights), np.ones(self._problem.free)])
        return _Round(unknowns[[i - 1 for i in whole]], rows[: len(whole)], all_weights), nearest

    def _known(self, values: Sequence[Floats]) -> list[Floats]:
        return [each[known] for each, known in zip(values, self._problem.known, strict=True)]

    def _likeliest_noise(self, drawn: _Round) -> "CorrelatedNoise":
        """Returns the noise with which the log is most likely one of the simulations of a round."""
        likeliest = [_likeliest_noise([drawn.residuals[:, each] for each in parts]) for parts in self._samples]
        return CorrelatedNoise(*np.transpose(likeliest))

    def _whiten(self, drawn: _Round) -> None:
        """Changes residuals in place so that their noise is white with a standard deviation of 1; logs may be long."""
        if not self._noise:
            return
        for parts, scale, correlation in zip(self._samples, self._noise.scales, self._noise.correlations, strict=True):
            for places in parts:
                drawn.residuals[:, places] = whitened(drawn.residuals[:, places] / scale, correlation)

    def _has_white_rest(self, rows: Floats) -> bool:
        """Returns whether the log, less what simulations explain of it, is as uncorrelated as simulated logs are.

        Args:
          rows: simulations and priors, `(points, numbers)`; they are centred in place.
        """
        middle, count, farther = rows.mean(axis=0), len(rows), 0
        rows -= middle
        between = rows @ rows.T
        for fold in range(FOLDS):
            is_tested = np.arange(count) % FOLDS == fold
            others = np.flatnonzero(~is_tested)
            tested = rows[is_tested]
            logs = np.concatenate([-middle[None], tested + self._generator.normal(size=tested.shape)])
            inner = between[np.ix_(others, others)] + len(others) * np.eye(len(others))
            shares = np.zeros((len(logs), count))
            shares[:, others] = np.linalg.solve(inner, (rows @ logs.T)[others]).T
            logs -= shares @ rows
            signals = [[logs[:, each] for each in parts] for parts in self._samples]
            own, *theirs = np.sum([portmanteau(parts) + slow_power(parts) for parts in signals], axis=0)
            farther += int((np.array(theirs) >= own).sum())
        return (1 + farther) / (1 + count) >= LEAST_WHITENESS

    def _regressed(self, drawn: _Round) -> tuple[Floats, Floats]:
        """Returns the unknowns of the log, `(unknowns,)`, and the errors for the simulated ones, `(points, unknowns)`.

        Each error is that of a regression without the log in question. The penalty of each unknown is the one with the
        least errors.
        """
        middle, count = drawn.unknowns.mean(axis=0), len(drawn.unknowns)
        targets = drawn.unknowns - middle
        products, of_log = np.zeros((count, count)), np.zeros(count)
        for _, rows in drawn.parts():
            logs = rows + self._generator.normal(size=rows.shape)
            offset = logs.mean(axis=0)
            logs -= offset
            products += logs @ logs.T
            of_log -= logs @ offset
        squares, vectors = np.linalg.eigh(products)
        squares = np.maximum(squares, 0.0)
        projected = vectors.T @ targets
        real = vectors.T @ of_log

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
        """Returns the rank of the log among simulated ones by distance from simulations that are not theirs.

        Distances are those of Mahalanobis (1936), in standard deviations of the simulations and the noise: simulations
        of a rough motion differ widely in some ways, and a log that differs from them in another way is still far off.
        """
        count = len(drawn.unknowns)
        between, to_logs = np.zeros((count, count)), np.zeros((count, 1 + count))
        squares = np.zeros(1 + count)
        for _, rows in drawn.parts():
            logs = np.concatenate([np.zeros((1, rows.shape[1])), rows + self._generator.normal(size=rows.shape)])
            middle = rows.mean(axis=0)
            rows, logs = rows - middle, logs - middle
            between += rows @ rows.T
            to_logs += rows @ logs.T
            squares += (logs**2).sum(axis=1)
        farther = 0
        for fold in range(FOLDS):
            is_tested = np.arange(count) % FOLDS == fold
            others, tested = np.flatnonzero(~is_tested), np.flatnonzero([True, *is_tested])
            own, *theirs = _distances(between[np.ix_(others, others)], to_logs[np.ix_(others, tested)], squares[tested])
            farther += int((NOISE_TOLERANCE * np.array(theirs) >= own).sum())
        return (1 + farther) / (1 + count)


@dataclass(frozen=True, eq=False)
class CorrelatedNoise:
    """Noise that is correlated from sample to sample.

    Attributes:
      scales: standard deviation of each signal, in those of white noise, `(signals,)`.
      correlations: correlation of consecutive samples of each signal, `(signals,)`.
      gains: twice the differences of the logarithmic likelihoods of signals from those with white noise, `(signals,)`.
    """

    scales: Floats
    correlations: Floats
    gains: Floats

    def explains_more(self, lack: UnmodelledEffect | None) -> bool:
        """Returns whether such noise explains the log much better than what the model may lack beside white noise."""
        return float(self.gains.sum()) > (LEAST_RATIO * lack.deviations**2 if lack else 0.0)


@dataclass(frozen=True, eq=False)
class _Products:
    """Scalar products of simulations, slopes, the effect of a change and the log, each without the mean simulation.

    Attributes:
      between: those of simulations without what their unknowns explain, `(n, n)`.
      to_others: those of these simulations, and `(unknowns + 2 + n)` others: slopes, effect, log, and simulated logs.
      others: those of slopes, effect and log with all others.
    """

    between: Floats
    to_others: Floats
    others: Floats

    def compensation(self, reach: Floats) -> Floats:
        """Returns the unknowns that explain the effect best, `(unknowns,)`, with these standard deviations at first."""
        metric = self._metric(np.arange(len(self.between)))
        count = len(reach)
        return solve_normal(metric[:count, :count] + np.diag(reach**-2.0), metric[:count, [count]])[:, 0]

    def score(self, compensation: Floats) -> tuple[float, float]:
        """Returns the size of the change by the log, and the distance of the log from simulated ones, in deviations."""
        effect = np.append(-compensation, 1.0)  # of the change, less what the unknowns explain
        sizes, scores, count = list[float](), list[float](), len(self.between)
        for fold in range(FOLDS):
            is_tested = np.arange(count) % FOLDS == fold
            along = effect @ self._metric(np.flatnonzero(~is_tested))[:-1]
            of_effect, of_log, theirs = along[: len(effect)] @ effect, along[len(effect)], along[len(effect) + 1 :]
            sizes.append(of_log / max(of_effect, 1e-300))
            scores += (theirs[is_tested] / max(of_effect, 1e-300)).tolist()
        size = float(np.mean(sizes))
        return size, size / max(float(np.sqrt(np.mean(np.square(scores)))), 1e-300)

    def _metric(self, chosen: NDArray[np.int64]) -> Floats:
        """Returns `others` in the metric of the inverse covariance of chosen simulations and the noise."""
        inner = self.between[np.ix_(chosen, chosen)] + len(chosen) * np.eye(len(chosen))
        to_others = self.to_others[chosen]
        return self.others - to_others[:, : len(self.others)].T @ np.linalg.solve(inner, to_others)


def _distances(between: Floats, to_logs: Floats, squares: Floats) -> Floats:
    """Returns the squared Mahalanobis distances of logs from simulations, `(logs,)`, from scalar products.

    Args:
      between: scalar products of the simulations, `(n, n)`.
      to_logs: those of simulations and logs, `(n, logs)`.
      squares: those of each log with itself, `(logs,)`.
    """
    means, count = between.mean(axis=0), len(between)
    values, vectors = np.linalg.eigh(between - means - means[:, None] + means.mean())
    cross = to_logs - means[:, None]
    lengths = squares - 2 * cross.mean(axis=0) - means.mean()
    shared = vectors.T @ (cross - cross.mean(axis=0))
    return lengths - (shared**2 / (count - 1 + np.maximum(values, 0.0))[:, None]).sum(axis=0)


def _places_of_samples(known: Sequence[NDArray[np.bool_]]) -> list[list[NDArray[np.int64]]]:
    """Returns the places of the samples of each signal in each chunk among all residuals.

    Args:
      known: masks of the measured values of each chunk, `(n, signals)`.
    """
    places: list[list[NDArray[np.int64]]] = [[] for _ in known[0].T]
    first = 0
    for mask in known:
        numbers = first + np.cumsum(mask).reshape(mask.shape) - 1
        for parts, column, is_known in zip(places, numbers.T, mask.T, strict=True):
            parts.append(column[is_known])
        first += int(mask.sum())
    return places


def _likeliest_noise(parts: Sequence[Floats]) -> tuple[float, float, float]:
    """Returns the standard deviation and the correlation of the noise of a signal; 1 and 0 if it may be white.

    The third number is twice the difference of logarithmic likelihoods from white noise with a standard deviation of 1.

    Args:
      parts: residuals of simulations in each chunk, `(points, n)`.
    """
    count, numbers = len(parts[0]), sum(each.shape[1] for each in parts)
    variances = SCALES[:, None] ** 2
    least, best, white, assumed = np.inf, (1.0, 0.0), np.inf, np.inf
    for correlation in CORRELATIONS:
        rows = np.concatenate([whitened(each, correlation) for each in parts], axis=1)
        middle = rows.mean(axis=0)
        rows -= middle
        squares, vectors = np.linalg.eigh(rows @ rows.T)
        squares = np.maximum(squares, 1e-12 * max(float(squares[-1]), 1e-300))
        along = (vectors.T @ (rows @ middle)) ** 2 / squares
        squares /= count
        rank = min(count - 1, numbers)
        squares, along = squares[-rank:], along[-rank:]
        rest = max(float(middle @ middle) - float(along.sum()), 0.0)
        cost = (np.log(variances + squares) + along / (variances + squares)).sum(axis=1)
        cost += (numbers - rank) * np.log(variances[:, 0]) + rest / variances[:, 0]
        cost += (numbers - len(parts)) * np.log(1 - correlation**2)
        place = int(cost.argmin())
        if correlation == 0:
            white, assumed = float(cost.min()), float(cost[int(np.abs(SCALES - 1).argmin())])
        if cost[place] < least:
            least, best = float(cost[place]), (float(SCALES[place]), float(correlation))
    return (*best, assumed - least) if least < white - CORRELATED else (1.0, 0.0, 0.0)


def _away_from_neighbours(residuals: Floats) -> Floats:
    """Returns residuals without the medians of their neighbours, so that only single outliers remain."""
    padded = np.pad(np.nan_to_num(residuals), ((NEIGHBOURS, NEIGHBOURS), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1, axis=0)
    return residuals - np.median(windows, axis=-1)
