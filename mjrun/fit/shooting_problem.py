"""Least squares of multiple shooting: residuals and slopes of all chunks, by finite differences of rollouts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.prediction import Chunk, Predictor, Rollout, States
from mjrun.fit.solution import Floats, Solution

NUDGE = 1e-5  # of a coordinate from 0 to 1, for finite differences
STATE_NUDGE = 1e-6  # of positions, velocities and activations
COARSE = 1000.0  # times these where contacts make a motion rough, so that fine differences tell of nothing else
ROUGH = 2.0  # ratio of slopes by fine and by coarse differences that tells so
STATE_SCALE = 10.0  # standard deviation that keeps in place what no signal tells of a state
PENALTY = 1e3  # residual, in standard deviations of the noise, where a simulation fails


@dataclass(frozen=True, eq=False)
class _Linearized:
    """Residuals of the chunks at `x`, `(n, signals)`, and their slopes, `(n, signals, p)` and `(n, signals, size)`."""

    x: Floats
    residuals: Sequence[Floats]
    of_coordinates: Sequence[Floats]
    of_states: Sequence[Floats]


class ShootingProblem:
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
        linearized = self._linearized_at(x)
        shown = [np.where(known, each, np.nan) for each, known in zip(linearized.residuals, self._known, strict=True)]
        slopes = list(zip(linearized.of_coordinates, linearized.of_states, strict=True))
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

    def _linearized_at(self, x: Floats) -> _Linearized:
        """What finite differences say about `x`; remembered, as optimizers end where they have asked before."""
        if self._linearized is None or not np.array_equal(self._linearized.x, x):
            self._linearized = self._differences(x.copy())
        return self._linearized

    def _differences(self, x: Floats) -> _Linearized:
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


def _lengths(slopes: Sequence[Floats]) -> Floats:
    """Of the slopes to each unknown, over all rows and signals: `(unknowns,)`."""
    return np.sqrt(sum(np.nansum(each**2, axis=(0, 1)) for each in slopes))
