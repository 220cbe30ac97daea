"""Least squares of multiple shooting: residuals and derivatives of all chunks, by finite differences of rollouts.

Functions that simulate are generators: each yields the rollouts that it needs and receives their predictions, so that
several problems are simulated in one batch on all cores (`together`).
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.free_parameter import FreeParameter, values_at
from mjrun.fitting.measurements import LEAST_NOISE, NORMAL_MEDIAN, Floats
from mjrun.fitting.prediction import Chunk, ChunkInitialStates, ChunkRolloutInputs, Predictor
from mjrun.model.override import Override

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
NUDGE = 1e-5  # step of finite differences of coordinates, which go from 0 to 1
STATE_NUDGE = 1e-6  # step of finite differences of positions, velocities and activations
STATE_SCALE = 10.0  # standard deviation of a prior of states, for components that no signal determines
UNLIKELY = 0.05  # probability below which a log is not one of the model
PENALTY = 1e3  # residual where a simulation fails, in standard deviations of the noise


@dataclass(frozen=True)
class UnmodelledEffect:
    """A change of the model that explains a log better, beside all values of the parameters.

    Attributes:
      path: path of the override that adds it.
      value: its estimated size.
      deviations: distance of the log from simulated ones in its direction, in standard deviations of these.
    """

    path: str
    value: float
    deviations: float


@dataclass(frozen=True, eq=False)
class RoughMotionEstimate:
    """Parameters by regression on simulated logs, or by steps between exact states.

    Attributes:
      draws: coordinates that the log permits, `(draws, p)`.
      probability: probability that a log of this model differs as much from the simulations as the real one does.
      lack: what the model lacks, if the log shows it.
      correlations: correlations of consecutive samples of the noise of each signal, `(signals,)`, if correlated noise
        explains the log; otherwise None.
    """

    draws: Floats
    probability: float
    lack: UnmodelledEffect | None = None
    correlations: Floats | None = None

    @property
    def is_likely(self) -> bool:
        """True if the log may be one of this model."""
        return self.probability >= UNLIKELY


@dataclass(frozen=True, eq=False)
class Solution:
    """A solution of least squares.

    Attributes:
      chunks: simulated stretches.
      coordinates: coordinates of the parameters, `(p,)`.
      states: integration states at the beginning of each chunk, `(chunks, nstate)`.
      residuals: residuals of each chunk in standard deviations of the noise, `(n, signals)`; NaN where nothing was
        measured.
      sensitivities: derivatives of the residuals with respect to the coordinates, `(n, signals, p)`, and to the states,
        `(n, signals, size)`.
      noise: assumed standard deviation of each signal, `(signals,)`.
      loss: loss function of the residuals.
      estimate: parameters and their errors if contacts make the motion rough.
    """

    chunks: Sequence[Chunk]
    coordinates: Floats
    states: Floats
    residuals: Sequence[Floats]
    sensitivities: Sequence[tuple[Floats, Floats]]
    noise: Floats
    loss: str = "linear"
    estimate: RoughMotionEstimate | None = None

    @property
    def cost(self) -> float:
        """Root mean square of the residuals under the loss; about 1 if the model explains all but noise."""
        squares = np.concatenate([each[np.isfinite(each)] for each in self.residuals]) ** 2
        return float(np.sqrt(LOSSES[self.loss](squares).mean()))

    @property
    def reduced(self) -> float:
        """Reduced χ²: sum of squares of the residuals under the loss per degree of freedom."""
        numbers = sum(int(np.isfinite(each).sum()) for each in self.residuals)
        return self.cost**2 * numbers / max(numbers - self.unknowns, 1)

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        (of_coordinates, of_states), count = self.sensitivities[0], len(self.chunks)
        return of_coordinates.shape[-1] + count * of_states.shape[-1]

    @property
    def observed_noise(self) -> Floats:
        """Root mean square residual of each signal in its unit, `(signals,)`."""
        squares = np.concatenate(list(self.residuals)) ** 2
        return np.sqrt(np.nanmean(squares, axis=0)) * self.noise

    @property
    def noise_scale(self) -> Floats:
        """Standard deviation of the noise of each signal, `(signals,)`.

        With a robust loss, medians estimate it, so that outliers do not count. It is never 0.
        """
        if self.loss == "linear":
            scale = self.observed_noise
        else:
            scale = np.nanmedian(np.abs(np.concatenate(list(self.residuals))), axis=0) * NORMAL_MEDIAN * self.noise
        return np.maximum(scale, LEAST_NOISE * self.noise)

    @property
    def weights(self) -> list[Floats]:
        """Weights of the squared residuals, in the shape of `residuals`; 1 with a linear loss."""
        return [loss_weights(self.loss, each) for each in self.residuals]


def loss_weights(loss: str, residuals: Floats) -> Floats:
    """Returns the weights of squared residuals: derivatives of the loss by these squares."""
    return LOSS_SLOPES[loss](residuals**2)


def with_noise(solution: Solution, noise: Floats) -> Solution:
    """Returns the same solution with residuals in other standard deviations."""
    factor = solution.noise / noise
    residuals = [each * factor for each in solution.residuals]
    jacobians = [(a * factor[:, None], b * factor[:, None]) for a, b in solution.sensitivities]
    return replace(solution, residuals=residuals, sensitivities=jacobians, noise=noise)


Result = TypeVar("Result")
Simulating = Generator[Sequence[ChunkRolloutInputs], Sequence[Floats], Result]
Advanced = Callable[[Solution], None]


def together(predictor: Predictor, tasks: Sequence[Simulating[Result]]) -> list[Result]:
    """Runs generators side by side and simulates their requests as one batch."""
    results: dict[int, Result] = {}
    waiting: dict[int, Sequence[ChunkRolloutInputs]] = {}

    def advance(index: int, predicted: Sequence[Floats] | None) -> None:
        try:
            waiting[index] = tasks[index].send(predicted)  # pyright: ignore[reportArgumentType]  (None starts)
        except StopIteration as end:
            results[index] = end.value

    for index in range(len(tasks)):
        advance(index, None)
    while waiting:
        asked, waiting = waiting, {}
        predicted = iter(predictor.predict([rollout for rollouts in asked.values() for rollout in rollouts]))
        for index, rollouts in asked.items():
            advance(index, [next(predicted) for _ in rollouts])
    return [results[index] for index in range(len(tasks))]


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Values of all unknowns: coordinates of the parameters, and deviations of the initial states.

    Attributes:
      coordinates: coordinates of the parameters, `(p,)`.
      deviations: deviations of the states of the chunks from their guesses, `(chunks, size)`.
    """

    coordinates: Floats
    deviations: Floats


class ShootingProblem:
    """The least-squares problem of one stage: its unknowns are coordinates, unless fixed, and the state of each chunk.

    Args:
      parts: chunks to simulate.
      coordinates: initial coordinates; None for the original model with fixed parameters.
      guesses: initial states of the chunks, `(chunks, nstate)`.
      noise: standard deviation of each signal, `(signals,)`.
      loss: loss function of scipy's `least_squares`.
      fixed: whether the coordinates are fixed.
      fixed_states: whether the states are fixed at their guesses.

    Attributes:
      parts, noise, loss: the arguments.
      start: initial point of a search.
      known: masks of the measured values of each chunk.
      free: number of free coordinates.
      size: number of unknowns of a state.
    """

    def __init__(
        self,
        predictor: Predictor,
        parameters: Sequence[FreeParameter],
        states: ChunkInitialStates,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        guesses: Floats,
        noise: Floats,
        loss: str,
        fixed: bool,
        fixed_states: bool = False,
    ) -> None:
        self._predictor, self._parameters, self._states, self.parts = predictor, parameters, states, parts
        self._guesses, self.noise, self.loss = guesses, noise, loss
        self._is_nominal = coordinates is None
        self.free, self.size = 0 if fixed or self._is_nominal else len(parameters), 0 if fixed_states else states.size
        first = np.array([p.first_coordinate for p in parameters]) if coordinates is None else coordinates
        self.start = Unknowns(first, np.zeros((len(parts), self.size)))
        self.known = [np.isfinite(part.values) for part in parts]

    def states(self, point: Unknowns) -> Floats:
        """Returns the integration states at the beginning of the chunks, `(chunks, nstate)`."""
        return np.stack([self._states.moved(g, d) for g, d in zip(self._guesses, point.deviations, strict=True)])

    def residuals(self, points: Sequence[Unknowns], added: tuple[Override, ...] = ()) -> Simulating[list[list[Floats]]]:
        """Computes residuals of each chunk at each point, `(n, signals)`, in standard deviations of the noise.

        Args:
          added: changes of the model beside the parameters.
        """
        starts = [(i, p.coordinates, p.deviations[i]) for p in points for i in range(len(self.parts))]
        left = yield from self._left(starts, added)
        count = len(self.parts)
        return [left[i * count : (i + 1) * count] for i in range(len(points))]

    def jacobians(
        self, point: Unknowns, residuals: Sequence[Floats], *, of_states: bool = True, wider: float = 1.0
    ) -> Simulating[tuple[list[Floats], list[Floats]]]:
        """Computes the derivatives of each chunk.

        They are those with respect to the coordinates, `(n, signals, p)`, and to its state, `(n, signals, size)`.

        Args:
          residuals: residuals at `point`.
          of_states: whether to compute derivatives with respect to states; they are empty otherwise.
          wider: factor of the steps of finite differences.
        """
        count, size = len(self.parts), self.size if of_states else 0
        x, nudge = point.coordinates, wider * STATE_NUDGE
        moves = np.where(x[: self.free] < 0.5, 1.0, -1.0) * wider * NUDGE  # away from the nearer bound
        starts: list[tuple[int, Floats, Floats]] = []
        for j in range(self.free):
            moved = x.copy()
            moved[j] += moves[j]
            starts += [(i, moved, point.deviations[i]) for i in range(count)]
        for j in range(size):
            for i in range(count):
                deviation = point.deviations[i].copy()
                deviation[j] += nudge
                starts.append((i, x, deviation))
        if not starts:
            empty = [np.zeros((*r.shape, 0)) for r in residuals]
            return empty, empty
        left = yield from self._left(starts)
        all_moves = np.concatenate([moves, np.full(size, nudge)])
        jacobians = [(np.stack(left[i::count], axis=-1) - residuals[i][..., None]) / all_moves for i in range(count)]
        return [each[..., : self.free] for each in jacobians], [each[..., self.free :] for each in jacobians]

    def cost(self, point: Unknowns, residuals: Sequence[Floats]) -> float:
        """Returns half the sum of squares under the loss, including the priors of states and parameters."""
        loss = LOSSES[self.loss]
        squares = sum(float(loss(r[k] ** 2).sum()) for r, k in zip(residuals, self.known, strict=True))
        priors, _ = self.priors(point.coordinates)
        return 0.5 * (squares + float(((point.deviations / STATE_SCALE) ** 2).sum()) + float(priors @ priors))

    def solution(
        self, point: Unknowns, residuals: Sequence[Floats], jacobians: Sequence[tuple[Floats, Floats]]
    ) -> Solution:
        """Returns a point as a solution; `jacobians` has those to the coordinates and to the state for each chunk."""
        shown = [np.where(known, r, np.nan) for r, known in zip(residuals, self.known, strict=True)]
        return Solution(
            self.parts, point.coordinates, self.states(point), shown, list(jacobians), self.noise, self.loss
        )

    def priors(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Returns the residuals of coordinates under their priors, `(p,)`, 0 without a prior, and their derivatives."""
        left, derivatives = np.zeros(self.free), np.zeros(self.free)
        for j, each in enumerate(self._parameters[: self.free]):
            if each.prior:
                left[j] = (each.value(coordinates[j]) - each.prior[0]) / each.prior[1]
                derivatives[j] = each.prior_slope(coordinates[j])
        return left, derivatives

    def _left(
        self, starts: Sequence[tuple[int, Floats, Floats]], added: tuple[Override, ...] = ()
    ) -> Simulating[list[Floats]]:
        """Computes residuals `(n, signals)` for each index of a chunk, coordinates, and deviation of its state."""
        predicted = yield [replace(self._rollout(*start), added=added) for start in starts]
        return [
            np.where(np.isfinite(rows), (rows - self.parts[i].values) / self.noise, PENALTY)
            for (i, _, _), rows in zip(starts, predicted, strict=True)
        ]

    def _rollout(self, index: int, coordinates: Floats, deviation: Floats) -> ChunkRolloutInputs:
        values = None if self._is_nominal else values_at(self._parameters, coordinates)
        return ChunkRolloutInputs(self.parts[index], values, self._states.moved(self._guesses[index], deviation))
