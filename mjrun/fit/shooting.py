"""Multiple shooting: parameters and the states in which chunks begin, found together by least squares.

Chunks are short at first, where every rollout is almost linear in what is looked for, and grow to whole segments,
which tell most of slow effects. H. G. Bock, "Recent advances in parameter identification techniques for O.D.E."
(1983), is the source of shooting from several states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.measurements import Segment
from mjrun.fit.prediction import Chunk, Predictor, Rollout, States, chunks
from mjrun.fit.rotations import shared
from mjrun.fit.starting_states import StartingStates
from mjrun.fit.unmeasured_states import simulated_starts

NUDGE = 1e-5  # of a coordinate from 0 to 1, for finite differences
STATE_NUDGE = 1e-6  # of positions, velocities and activations
COARSE = 1000.0  # times these where contacts make a motion rough, so that fine differences tell of nothing else
ROUGH = 2.0  # ratio of slopes by fine and by coarse differences that tells so
LEAST_NOISE = 1e-7  # of the standard deviation of a signal: what simulated data are taken for
STATE_SCALE = 10.0  # standard deviation that keeps in place what no signal tells of a state
PENALTY = 1e3  # residual, in standard deviations of the noise, where a simulation fails
EVALUATIONS = 40  # of one stage, at most
FEW_EVALUATIONS = 12  # of each of several starts
SHORTEST = 24  # rows of the first chunks
GROWTH = 2
TOLERANCE = 1e-8  # relative change of the cost at which the last stage ends
ROUGH_TOLERANCE = 1e-5  # the same of stages that others follow, and where the states alone are looked for
EXPLAINED = 5.0  # cost of a solution, in standard deviations of the noise, with which no other is looked for
SHOTS = 5  # from one start, at most
WORTHWHILE = 0.95  # of the cost before, if another shot may follow
DENSE = 40  # unknowns up to which a Jacobian is factored as a whole

NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of absolute values

Floats = NDArray[np.float64]

# The losses of scipy's `least_squares`, of the square of a residual, and their derivatives by it.
LOSSES: dict[str, Callable[[Floats], Floats]] = {
    "linear": np.asarray,
    "soft_l1": lambda square: 2 * (np.sqrt(1 + square) - 1),
    "huber": lambda square: np.where(square <= 1, square, 2 * np.sqrt(square) - 1),
    "cauchy": np.log1p,
}
LOSS_SLOPES: dict[str, Callable[[Floats], Floats]] = {
    "linear": np.ones_like,
    "soft_l1": lambda square: (1 + square) ** -0.5,
    "huber": lambda square: np.maximum(square, 1.0) ** -0.5,
    "cauchy": lambda square: 1 / (1 + square),
}


@dataclass(frozen=True, eq=False)
class Solution:
    """What least squares has found.

    Attributes:
      chunks: the stretches that were simulated.
      coordinates: of the parameters, `(p,)`.
      states: integration states at the beginning of each chunk, `(chunks, nstate)`.
      residuals: of the rows of each chunk, in standard deviations of the noise, `(n, signals)`; NaN where nothing was
        measured.
      sensitivities: of these to the coordinates, `(n, signals, p)`, and to the states, `(n, signals, size)`.
      noise: standard deviation of each signal that was assumed, `(signals,)`.
      rollouts: how many were simulated.
      loss: how residuals counted.
      jitters: other residuals less these, after nudges so small that only a rough motion tells of them,
        `(n, signals, nudges)` of each chunk; no chunks where nothing is rough.
    """

    chunks: Sequence[Chunk]
    coordinates: Floats
    states: Floats
    residuals: Sequence[Floats]
    sensitivities: Sequence[tuple[Floats, Floats]]
    noise: Floats
    rollouts: int
    loss: str = "linear"
    jitters: Sequence[Floats] = ()

    @property
    def cost(self) -> float:
        """Root mean square of the residuals as the loss counts them; 1 or so where the model explains all but noise."""
        squares = np.concatenate([each[np.isfinite(each)] for each in self.residuals]) ** 2
        return float(np.sqrt(LOSSES[self.loss](squares).mean()))

    @property
    def observed_noise(self) -> Floats:
        """Root mean square of what is left of each signal, `(signals,)`."""
        squares = np.concatenate(list(self.residuals)) ** 2
        return np.sqrt(np.nanmean(squares, axis=0)) * self.noise

    @property
    def noise_scale(self) -> Floats:
        """The standard deviation of the noise of each signal, `(signals,)`.

        With a robust loss it is that of the middle half of the residuals: outliers are no part of it.
        """
        if self.loss == "linear":
            return self.observed_noise
        return np.nanmedian(np.abs(np.concatenate(list(self.residuals))), axis=0) * NORMAL_MEDIAN * self.noise

    @property
    def weights(self) -> list[Floats]:
        """How much residuals count, 1 with a linear loss: derivatives of the loss by their squares, as `residuals`."""
        slope = LOSS_SLOPES[self.loss]
        return [slope(each**2) for each in self.residuals]


Advanced = Callable[[Solution], None]


class Shooting:
    """Fits parameters to segments.

    Args:
      loss: of scipy's `least_squares`: `linear`, or one that outliers weigh less in.
    """

    def __init__(
        self, predictor: Predictor, parameters: Sequence[FreeParameter], starting: StartingStates, loss: str = "linear"
    ) -> None:
        self._predictor, self._parameters, self._starting, self._loss = predictor, parameters, starting, loss
        self._states = States(predictor.model)

    def cut(self, segments: Sequence[Segment], rows: int) -> list[Chunk]:
        """The chunks of about `rows` rows."""
        return chunks(segments, rows, self._predictor.timestep, self._predictor.lead)

    def guessed(self, parts: Sequence[Chunk], coordinates: Floats | None) -> Floats:
        """States to begin with, from what was measured, and else from the model.

        Args:
          coordinates: of the parameters; None for the model as it was.
        """
        if not self._starting.all_measured:
            values = None if coordinates is None else self._values(coordinates)
            return simulated_starts(self._predictor, self._starting, parts, values)
        return np.stack([self._starting.guess(part, self._predictor.timestep) for part in parts])

    def solve(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats,
        states: Floats,
        noise: Floats,
        *,
        evaluations: int = EVALUATIONS,
        tolerance: float = TOLERANCE,
        advanced: Advanced | None = None,
    ) -> Solution:
        """Minimizes the residuals of `parts`.

        Args:
          coordinates, states: where to begin.
          noise: standard deviation of each signal.
          evaluations: of the residuals, at most.
          tolerance: relative change of the cost at which it ends.
          advanced: is told of every solution that is better than the one before.
        """
        return self._solved(parts, coordinates, states, noise, evaluations, tolerance, advanced=advanced)

    def follow(self, parts: Sequence[Chunk], coordinates: Floats | None, states: Floats, noise: Floats) -> Solution:
        """The states alone that minimize the residuals of `parts`, the parameters being as they are.

        Args:
          coordinates: of the parameters; None for the model as it was.
        """
        return self._solved(parts, coordinates, states, noise, EVALUATIONS, ROUGH_TOLERANCE, fixed=True)

    def _solved(
        self,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        states: Floats,
        noise: Floats,
        evaluations: int,
        tolerance: float,
        *,
        fixed: bool = False,
        advanced: Advanced | None = None,
    ) -> Solution:
        from scipy.optimize import least_squares

        problem = _Problem(self._predictor, self._parameters, self._states, parts, coordinates, states, noise, fixed)
        low, high = problem.bounds
        dense = len(low) <= DENSE

        def jacobian(x: Floats):
            slopes = problem.jacobian(x)  # which is asked for wherever residuals have become less
            if advanced:
                advanced(replace(problem.solution(x), loss=self._loss))
            return slopes.toarray() if dense else slopes

        found = least_squares(
            problem.residuals,
            problem.start,
            jacobian,  # pyright: ignore[reportArgumentType]  (its types know of names alone)
            bounds=(low, high),
            method="trf",
            x_scale=1.0 if fixed else "jac",  # by slopes, the first steps from no deviation would be tiny
            loss=self._loss,
            tr_solver="exact" if dense else "lsmr",
            max_nfev=evaluations,
            xtol=1e-7,
            ftol=tolerance,
        )
        return replace(problem.solution(np.asarray(found.x, float)), loss=self._loss)

    def look(self, parts: Sequence[Chunk], coordinates: Floats, states: Floats, noise: Floats) -> Solution:
        """Residuals and sensitivities at a start, where nothing is minimized."""
        problem = _Problem(self._predictor, self._parameters, self._states, parts, coordinates, states, noise, False)
        return problem.solution(problem.start)

    def best_start(
        self, segments: Sequence[Segment], starts: Sequence[Floats], noise: Floats, advanced: Advanced | None = None
    ) -> Floats:
        """Where the shortest chunks lead from several starts: the coordinates with the least residuals.

        Args:
          advanced: is told of every solution that is better than the one before of the same start.
        """
        parts = self.cut(segments, SHORTEST)
        found = [
            self.solve(
                parts,
                start,
                self.guessed(parts, start),
                noise,
                evaluations=FEW_EVALUATIONS,
                tolerance=ROUGH_TOLERANCE,
                advanced=advanced,
            )
            for start in starts
        ]
        return min(found, key=lambda solution: solution.cost).coordinates

    def stages(self, segments: Sequence[Segment]) -> list[list[Chunk]]:
        """The chunks of the stages of a fit: longer and longer ones, to whole segments."""
        rows, found = SHORTEST, [self.cut(segments, SHORTEST)]
        while len(found[-1]) > len(segments):
            rows *= GROWTH
            found.append(self.cut(segments, rows))
        return found

    def grown(
        self, segments: Sequence[Segment], start: Floats, noise: Floats, advanced: Advanced | None = None
    ) -> list[Solution]:
        """Solutions with longer and longer chunks, to whole segments; each stage begins at the one before.

        Args:
          advanced: is told of every solution that is better than the one before.
        """
        solutions: list[Solution] = []
        coordinates, stages = start, self.stages(segments)
        for parts in stages:
            states = self._taken_over(parts, solutions[-1]) if solutions else self.guessed(parts, start)
            tolerance = TOLERANCE if parts is stages[-1] else ROUGH_TOLERANCE
            solution = self.solve(parts, coordinates, states, noise, tolerance=tolerance, advanced=advanced)
            noise = self._noise(solution)
            solutions.append(solution)
            coordinates = solution.coordinates
        return solutions

    def searched(
        self, found: Solution, starts: Sequence[Floats], noise: Floats, advanced: Advanced | None = None
    ) -> list[Solution]:
        """Further solutions of the chunks of `found`, the best one last; none if `found` is good or none is better.

        Short chunks say little of a state that is not measured, and may lead to a wrong basin. Whole segments that are
        shot from several starts may lead to another.

        Args:
          found: of whole segments.
          starts: coordinates, tried in turn until one explains the measurements.
          noise: by which solutions are compared.
          advanced: is told of every solution that is better than all before.
        """
        tried: list[Solution] = []
        best = with_noise(found, noise)
        for start in () if self._starting.all_measured else starts:
            if best.cost < EXPLAINED:
                break
            shots = self._shots(found.chunks, start, noise)
            tried += shots
            if shots[-1].cost < best.cost:
                best = shots[-1]
                if advanced:
                    advanced(best)
        if best not in tried:
            return []
        return [*(each for each in tried if each is not best), best]

    def _shots(self, parts: Sequence[Chunk], start: Floats, noise: Floats) -> list[Solution]:
        """Solutions from a start, the best one last, each from where the one before ended.

        The states are guessed anew: those of a fit that is far from the truth have been bent to make up for it.
        """
        shots: list[Solution] = []
        coordinates = start
        for _ in range(SHOTS):
            shot = self.solve(parts, coordinates, self.guessed(parts, coordinates), noise)
            if shots and shot.cost > WORTHWHILE * shots[-1].cost:
                return sorted([*shots, shot], key=lambda solution: -solution.cost)
            shots.append(shot)
            coordinates = shot.coordinates
        return shots

    def _noise(self, solution: Solution) -> Floats:
        """The noise that the residuals show."""
        values = np.concatenate([part.values for part in solution.chunks])
        groups = self._predictor.rotations
        return np.maximum(shared(solution.noise_scale, groups), LEAST_NOISE * shared(np.nanstd(values, axis=0), groups))

    def _taken_over(self, parts: Sequence[Chunk], before: Solution) -> Floats:
        """States for `parts` from chunks that began at the same step; guesses elsewhere."""
        known = {(id(c.segment), c.first_step): s for c, s in zip(before.chunks, before.states, strict=True)}
        guesses = self.guessed(parts, before.coordinates)
        return np.stack([known.get((id(p.segment), p.first_step), g) for p, g in zip(parts, guesses, strict=True)])

    def _values(self, coordinates: Floats) -> tuple[float, ...]:
        return tuple(each.value(c) for each, c in zip(self._parameters, coordinates, strict=True))


def spread_of(values: Floats, loss: str = "linear") -> Floats:
    """The standard deviation of each signal, `(signals,)`; under a robust loss that of its middle half."""
    if loss == "linear":
        return np.nanstd(values, axis=0)
    return np.nanmedian(np.abs(values - np.nanmedian(values, axis=0)), axis=0) * NORMAL_MEDIAN


def first_noise(segments: Sequence[Segment], rotations: Sequence[Sequence[int]] = ()) -> Floats:
    """The noise of each signal from third differences, in which smooth motion hardly shows: `(signals,)`.

    White noise of standard deviation s has third differences of √20·s.
    """
    differences = np.concatenate([np.diff(segment.values, 3, axis=0) for segment in segments])
    spread = np.nanmedian(np.abs(differences), axis=0) * NORMAL_MEDIAN / np.sqrt(20)
    values = np.concatenate([segment.values for segment in segments])
    return np.maximum(shared(spread, rotations), LEAST_NOISE * shared(np.nanstd(values, axis=0), rotations))


class _Problem:
    """Least squares of one stage: unknowns are the coordinates, unless fixed, then the deviations of each chunk."""

    def __init__(
        self,
        predictor: Predictor,
        parameters: Sequence[FreeParameter],
        states: States,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        guesses: Floats,
        noise: Floats,
        fixed: bool,
    ) -> None:
        self._predictor, self._parameters, self._states, self._parts = predictor, parameters, states, parts
        self._guesses, self._noise, self._fixed = guesses, noise, fixed
        self._free, self._is_nominal = 0 if fixed else len(parameters), coordinates is None
        self._coordinates = np.array([p.first_coordinate for p in parameters]) if coordinates is None else coordinates
        self._known = [np.isfinite(part.values) for part in parts]
        self._rollouts = 0
        self._linearized: _Linearized | None = None
        self._factors, self._are_factors_known = np.ones(self._free + states.size), False
        self._jitters: Sequence[Floats] = ()

    @property
    def start(self) -> Floats:
        first = self._coordinates[: self._free]
        return np.concatenate([first, np.zeros(len(self._parts) * self._states.size)])

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        free = np.full(len(self._parts) * self._states.size, np.inf)
        return np.concatenate([np.zeros(self._free), -free]), np.concatenate([np.ones(self._free), free])

    def residuals(self, x: Floats) -> Floats:
        """In standard deviations of the noise, then of what is known of the states and parameters beforehand."""
        coordinates, deviations = self._split(x)
        left = self._left(coordinates, deviations)
        parts = [each[known] for each, known in zip(left, self._known, strict=True)]
        return np.concatenate([*parts, deviations.ravel() / STATE_SCALE, self._priors(coordinates)])

    def jacobian(self, x: Floats):
        """A sparse matrix: chunks know of the parameters and of their own state."""
        from scipy import sparse

        coordinates, _ = self._split(x)
        linearized = self._linearized_at(x)
        of_coordinates, of_states = linearized.of_coordinates, linearized.of_states
        size, count = self._states.size, len(self._parts)
        top = sparse.block_diag([d[known] for d, known in zip(of_states, self._known, strict=True)])
        middle = sparse.identity(count * size) / STATE_SCALE
        right = sparse.vstack([top, middle])
        if not self._free:
            return right.tocsr()
        left = np.concatenate([d[known] for d, known in zip(of_coordinates, self._known, strict=True)])
        left = np.concatenate([left, np.zeros((count * size, self._free))])
        priors = self._prior_slopes(coordinates)
        below = sparse.csr_matrix((len(priors), count * size))
        return sparse.hstack([sparse.csr_matrix(np.concatenate([left, priors])), sparse.vstack([right, below])]).tocsr()

    def solution(self, x: Floats) -> Solution:
        coordinates, deviations = self._split(x)
        found = self._linearized_at(x)
        shown = [np.where(known, each, np.nan) for each, known in zip(found.residuals, self._known, strict=True)]
        slopes = list(zip(found.of_coordinates, found.of_states, strict=True))
        states = np.stack([self._states.moved(g, d) for g, d in zip(self._guesses, deviations, strict=True)])
        return Solution(
            self._parts, coordinates, states, shown, slopes, self._noise, self._rollouts, jitters=self._jitters
        )

    def _split(self, x: Floats) -> tuple[Floats, Floats]:
        coordinates = self._coordinates if self._fixed else x[: self._free]
        return coordinates, x[self._free :].reshape(len(self._parts), self._states.size)

    def _left(self, coordinates: Floats, deviations: Floats) -> list[Floats]:
        rollouts = [self._rollout(i, coordinates, deviations[i]) for i in range(len(self._parts))]
        return self._residuals_of(rollouts)

    def _residuals_of(self, rollouts: Sequence[Rollout]) -> list[Floats]:
        self._rollouts += len(rollouts)
        predicted = self._predictor.predict(rollouts)
        left = [(p - each.chunk.values) / self._noise for each, p in zip(rollouts, predicted, strict=True)]
        return [np.where(np.isfinite(p), each, PENALTY) for each, p in zip(left, predicted, strict=True)]

    def _rollout(self, index: int, coordinates: Floats, deviation: Floats) -> Rollout:
        values = None
        if not self._is_nominal:
            values = tuple(each.value(c) for each, c in zip(self._parameters, coordinates, strict=True))
        return Rollout(self._parts[index], values, self._states.moved(self._guesses[index], deviation))

    def _linearized_at(self, x: Floats) -> "_Linearized":
        """What finite differences say about `x`; remembered, as optimizers end where they have asked before."""
        if self._linearized is None or not np.array_equal(self._linearized.x, x):
            self._linearized = self._differences(x.copy())
        return self._linearized

    def _differences(self, x: Floats) -> "_Linearized":
        free = self._free
        left, slopes = self._slopes(x, self._factors)
        if not self._are_factors_known:
            _, coarse = self._slopes(x, COARSE * self._factors)
            is_rough = _lengths(slopes) > ROUGH * _lengths(coarse)
            if is_rough.any():  # some fine nudges show it by chance only, so that all are coarse
                steps = np.concatenate([np.full(free, NUDGE), np.full(self._states.size, STATE_NUDGE)])
                lengths = _lengths(slopes) * steps
                is_shown = is_rough & (lengths > lengths[is_rough].max() / ROUGH)
                self._jitters = [(each * steps)[..., is_shown] for each in slopes]
                slopes, self._factors = coarse, COARSE * self._factors
            self._are_factors_known = True
        return _Linearized(x, left, [e[..., :free] for e in slopes], [e[..., free:] for e in slopes])

    def _slopes(self, x: Floats, factors: Floats) -> tuple[list[Floats], list[Floats]]:
        """Residuals of each chunk, and their slopes to the coordinates and its state, `(n, signals, unknowns)`.

        Args:
          factors: of the usual steps of the finite differences, `(unknowns,)`.
        """
        coordinates, deviations = self._split(x)
        count, size = len(self._parts), self._states.size
        rollouts = [self._rollout(i, coordinates, deviations[i]) for i in range(count)]
        signs = np.where(coordinates[: self._free] < 0.5, 1.0, -1.0)  # away from the nearer bound
        steps = factors * np.concatenate([NUDGE * signs, np.full(size, STATE_NUDGE)])
        for j in range(self._free):
            moved = coordinates.copy()
            moved[j] += steps[j]
            rollouts += [self._rollout(i, moved, deviations[i]) for i in range(count)]
        for j in range(size):
            for i in range(count):
                moved = deviations[i].copy()
                moved[j] += steps[self._free + j]
                rollouts.append(self._rollout(i, coordinates, moved))
        left = self._residuals_of(rollouts)
        slopes = [np.stack(left[i + count :: count], axis=-1) - left[i][..., None] for i in range(count)]
        return left[:count], [each / steps for each in slopes]

    def _priors(self, coordinates: Floats) -> Floats:
        pairs = zip(self._parameters, coordinates, strict=True)
        return np.array([(p.value(c) - p.prior[0]) / p.prior[1] for p, c in pairs if p.prior and not self._fixed])

    def _prior_slopes(self, coordinates: Floats) -> Floats:
        rows: list[Floats] = []
        for j, each in enumerate(self._parameters):
            if each.prior:
                row = np.zeros(len(self._parameters))
                c = coordinates[j]
                row[j] = (each.value(c + NUDGE) - each.value(c - NUDGE)) / (2 * NUDGE * each.prior[1])
                rows.append(row)
        return np.array(rows).reshape(len(rows), len(self._parameters))


@dataclass(frozen=True, eq=False)
class _Linearized:
    """Residuals of the chunks at `x`, `(n, signals)`, and their slopes, `(n, signals, p)` and `(n, signals, size)`."""

    x: Floats
    residuals: Sequence[Floats]
    of_coordinates: Sequence[Floats]
    of_states: Sequence[Floats]


def _lengths(slopes: Sequence[Floats]) -> Floats:
    """Of the slopes to each unknown, over all rows and signals: `(unknowns,)`."""
    return np.sqrt(sum(np.nansum(each**2, axis=(0, 1)) for each in slopes))


def with_noise(solution: Solution, noise: Floats) -> Solution:
    """The same, with residuals in other standard deviations."""
    factor = solution.noise / noise
    residuals = [each * factor for each in solution.residuals]
    slopes = [(a * factor[:, None], b * factor[:, None]) for a, b in solution.sensitivities]
    jitters = [each * factor[:, None] for each in solution.jitters]
    return replace(solution, residuals=residuals, sensitivities=slopes, noise=noise, jitters=jitters)
