"""Least squares of multiple shooting: residuals and slopes of all chunks, by finite differences of rollouts.

Functions that simulate are generators: each yields the rollouts that it needs and is sent what they predict, so that
several problems are simulated in one batch, over all cores (`together`).
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from mjrun.fit.free_parameter import FreeParameter, values_at
from mjrun.fit.prediction import Chunk, Predictor, Rollout, States
from mjrun.fit.solution import LOSSES, Floats, Solution

NUDGE = 1e-5  # of a coordinate from 0 to 1, for finite differences
STATE_NUDGE = 1e-6  # of positions, velocities and activations
STATE_SCALE = 10.0  # standard deviation that keeps in place what no signal tells of a state
PENALTY = 1e3  # residual, in standard deviations of the noise, where a simulation fails

Result = TypeVar("Result")
Simulating = Generator[Sequence[Rollout], Sequence[Floats], Result]
Advanced = Callable[[Solution], None]


def together(predictor: Predictor, tasks: Sequence[Simulating[Result]]) -> list[Result]:
    """Runs generators side by side: what all of them ask for is simulated as one batch."""
    results: dict[int, Result] = {}
    waiting: dict[int, Sequence[Rollout]] = {}

    def advance(index: int, predicted: Sequence[Floats] | None) -> None:
        try:
            waiting[index] = tasks[index].send(predicted)  # pyright: ignore[reportArgumentType]  (None begins)
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
class Point:
    """Values of the unknowns.

    Attributes:
      coordinates: of the parameters, `(p,)`.
      deviations: of the states of the chunks from their guesses, `(chunks, size)`.
    """

    coordinates: Floats
    deviations: Floats


class ShootingProblem:
    """Least squares of one stage: unknowns are the coordinates, unless fixed, then the deviations of each chunk.

    Args:
      coordinates: where to begin; None for the model as it was, whose parameters are fixed.
      guesses: states at the beginning of the chunks, `(chunks, nstate)`.
      noise: standard deviation of each signal, `(signals,)`.
      loss: of scipy's `least_squares`.

    Attributes:
      parts: the chunks.
      start: where to begin.
      noise, loss: as above.
      known: which values of each chunk are measured.
      free: how many coordinates are looked for.
      size: numbers of the deviation of a state.
    """

    def __init__(
        self,
        predictor: Predictor,
        parameters: Sequence[FreeParameter],
        states: States,
        parts: Sequence[Chunk],
        coordinates: Floats | None,
        guesses: Floats,
        noise: Floats,
        loss: str,
        fixed: bool,
    ) -> None:
        self._predictor, self._parameters, self._states, self.parts = predictor, parameters, states, parts
        self._guesses, self.noise, self.loss = guesses, noise, loss
        self._is_nominal = coordinates is None
        self.free, self.size = 0 if fixed or self._is_nominal else len(parameters), states.size
        first = np.array([p.first_coordinate for p in parameters]) if coordinates is None else coordinates
        self.start = Point(first, np.zeros((len(parts), states.size)))
        self.known = [np.isfinite(part.values) for part in parts]

    def states(self, point: Point) -> Floats:
        """Integration states at the beginning of the chunks, `(chunks, nstate)`."""
        return np.stack([self._states.moved(g, d) for g, d in zip(self._guesses, point.deviations, strict=True)])

    def residuals(self, points: Sequence[Point]) -> Simulating[list[list[Floats]]]:
        """In standard deviations of the noise, `(n, signals)` of each chunk at each of `points`."""
        starts = [(i, p.coordinates, p.deviations[i]) for p in points for i in range(len(self.parts))]
        left = yield from self._left(starts)
        count = len(self.parts)
        return [left[i * count : (i + 1) * count] for i in range(len(points))]

    def slopes(
        self, point: Point, residuals: Sequence[Floats], *, of_states: bool = True, wider: float = 1.0
    ) -> Simulating[tuple[list[Floats], list[Floats]]]:
        """Of the residuals of each chunk to the coordinates, `(n, signals, p)`, and to its state, `(n, signals, size)`.

        Args:
          residuals: at `point`.
          of_states: whether the second is asked for; it is empty otherwise.
          wider: factor of the steps of finite differences that suit smooth motions.
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
            return [np.zeros((*r.shape, 0)) for r in residuals], []
        left = yield from self._left(starts)
        all_moves = np.concatenate([moves, np.full(size, nudge)])
        slopes = [(np.stack(left[i::count], axis=-1) - residuals[i][..., None]) / all_moves for i in range(count)]
        return [each[..., : self.free] for each in slopes], [each[..., self.free :] for each in slopes if size]

    def cost(self, point: Point, residuals: Sequence[Floats]) -> float:
        """Half the sum of squares, as the loss counts them, with what holds states and parameters in place."""
        loss = LOSSES[self.loss]
        squares = sum(float(loss(r[k] ** 2).sum()) for r, k in zip(residuals, self.known, strict=True))
        priors, _ = self.priors(point.coordinates)
        return 0.5 * (squares + float(((point.deviations / STATE_SCALE) ** 2).sum()) + float(priors @ priors))

    def solution(self, point: Point, residuals: Sequence[Floats], slopes: Sequence[tuple[Floats, Floats]]) -> Solution:
        """A point as a solution; slopes are those of the coordinates and of the states for each chunk."""
        shown = [np.where(known, r, np.nan) for r, known in zip(residuals, self.known, strict=True)]
        return Solution(self.parts, point.coordinates, self.states(point), shown, list(slopes), self.noise, self.loss)

    def priors(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """What is known beforehand: residuals of the coordinates, `(p,)`, 0 without a prior, and their slopes."""
        left, slopes = np.zeros(self.free), np.zeros(self.free)
        for j, each in enumerate(self._parameters[: self.free]):
            if each.prior:
                left[j] = (each.value(coordinates[j]) - each.prior[0]) / each.prior[1]
                slopes[j] = each.prior_slope(coordinates[j])
        return left, slopes

    def _left(self, starts: Sequence[tuple[int, Floats, Floats]]) -> Simulating[list[Floats]]:
        """Residuals `(n, signals)` of a chunk, by its place, with coordinates and the deviation of its state."""
        predicted = yield [self._rollout(*start) for start in starts]
        left = [(rows - self.parts[i].values) / self.noise for (i, _, _), rows in zip(starts, predicted, strict=True)]
        return [np.where(np.isfinite(p), each, PENALTY) for each, p in zip(left, predicted, strict=True)]

    def _rollout(self, index: int, coordinates: Floats, deviation: Floats) -> Rollout:
        values = None if self._is_nominal else values_at(self._parameters, coordinates)
        return Rollout(self.parts[index], values, self._states.moved(self._guesses[index], deviation))
