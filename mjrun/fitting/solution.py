"""Solutions of least squares, and loss functions of their residuals."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.prediction import Chunk
from mjrun.fitting.rotations_and_noise import NORMAL_MEDIAN, Floats

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
    """A solution of least squares.

    Attributes:
      chunks: simulated stretches.
      coordinates: coordinates of the parameters, `(p,)`.
      states: integration states at the beginning of each chunk, `(chunks, nstate)`.
      residuals: residuals of each chunk in standard deviations of the noise, `(n, signals)`; NaN where nothing was
        measured.
      sensitivities: slopes of the residuals to the coordinates, `(n, signals, p)`, and to the states,
        `(n, signals, size)`.
      noise: assumed standard deviation of each signal, `(signals,)`.
      loss: loss function of the residuals.
      variances: variances of the residuals in the shape of `residuals`, if contacts make the motion rough; otherwise
        empty, and all are 1.
    """

    chunks: Sequence[Chunk]
    coordinates: Floats
    states: Floats
    residuals: Sequence[Floats]
    sensitivities: Sequence[tuple[Floats, Floats]]
    noise: Floats
    loss: str = "linear"
    variances: Sequence[Floats] = ()

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

        With a robust loss, medians estimate it, so that outliers do not count.
        """
        if self.loss == "linear":
            return self.observed_noise
        return np.nanmedian(np.abs(np.concatenate(list(self.residuals))), axis=0) * NORMAL_MEDIAN * self.noise

    @property
    def weights(self) -> list[Floats]:
        """Weights of the squared residuals, in the shape of `residuals`; 1 with a linear loss and smooth motion."""
        variances = self.variances or [np.ones_like(each) for each in self.residuals]
        return [loss_weights(self.loss, *each) for each in zip(self.residuals, variances, strict=True)]


def loss_weights(loss: str, residuals: Floats, variances: Floats | float = 1.0) -> Floats:
    """Returns the weights of squared residuals: derivatives of the loss by these squares."""
    return LOSS_SLOPES[loss](residuals**2 / variances) / variances


def with_noise(solution: Solution, noise: Floats) -> Solution:
    """Returns the same solution with residuals in other standard deviations."""
    factor = solution.noise / noise
    residuals = [each * factor for each in solution.residuals]
    slopes = [(a * factor[:, None], b * factor[:, None]) for a, b in solution.sensitivities]
    variances = [each * factor**2 for each in solution.variances]
    return replace(solution, residuals=residuals, sensitivities=slopes, noise=noise, variances=variances)
