"""Verdicts on a fit: its residuals compared with the noise, and its predictions compared with the original model."""

from collections.abc import Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean, listing, option
from mjrun.fitting.information import bound_reached
from mjrun.fitting.rotations_and_noise import shared, spread_of
from mjrun.fitting.solution import LOSSES, Floats, Solution
from mjrun.model.table_column import Column

MISFIT = 2.0  # reduced χ² above which the user is warned
HOPELESS, HOPELESS_SHARE = 10.0, 0.1  # residual over noise, and over the spread of a signal, above which a fit fails
LEAST = 1e-5  # least noise of a signal that counts, as a share of its standard deviation
BLOCKS = 20  # blocks of held-out data whose errors are assumed to be independent
CERTAIN = 2.0  # standard deviations that a gain must exceed


@dataclass(frozen=True, eq=False)
class NoiseRatios:
    """Residuals of a fit compared with the noise of the log.

    Attributes:
      ratios: residual over noise of each signal, `(signals,)`.
      shares: residual over spread of each signal, `(signals,)`.
      reduced: reduced χ², about 1 if the model explains all but noise.
      is_rough: whether contacts make the motion rough.
    """

    ratios: Floats
    shares: Floats
    reduced: float
    is_rough: bool

    def warning(self) -> str | None:
        """Returns a sentence on a misfit, or None."""
        if self.reduced < MISFIT:
            return None
        beyond = f"the fit leaves residuals beyond the noise of the log (reduced χ² {self.reduced:.3g}): "
        if self.is_rough:
            return (
                f"{beyond}contacts make the motion rough, and even the nearest simulations rattle differently, or the "
                "model lacks something, so the intervals may exclude the true values"
            )
        return (
            f"{beyond}the model lacks something, so the intervals, which cover only scatter, may exclude the true "
            f"values\nif the noise is larger than the high frequencies of the log suggest, set {option('noise')}"
        )

    def refusal(self, columns: Sequence[Column], noise: Floats) -> str | None:
        """Returns the reason why nothing is written; None if the residuals are acceptable."""
        bad = np.flatnonzero((self.ratios > HOPELESS) & (self.shares > HOPELESS_SHARE)).tolist()
        if not bad:
            return None
        worst = [
            f"{clean(columns[i].name)} by {self.ratios[i] * noise[i]:.3g} {columns[i].unit}".rstrip()
            + f", {self.ratios[i]:.0f} times its noise"
            for i in bad
        ]
        return (
            f"the best fit misses {listing(worst)}\nthe model lacks something, or the log has other units, signs or "
            f"clocks than the model ({option('map')}; {option('free')} delay:ctrl/* finds a delay)"
        )


def misfit(solution: Solution, noise: Floats, rotations: Sequence[Sequence[int]]) -> NoiseRatios:
    """Compares the residuals of a solution with the noise of the log."""
    values = np.concatenate([part.values for part in solution.chunks])
    spread = shared(spread_of(values, solution.loss), rotations)
    left = shared(solution.noise_scale, rotations)
    ratios = left / np.maximum(noise, LEAST * spread)
    numbers = sum(int(np.isfinite(each).sum()) for each in solution.residuals)
    reduced = float((ratios**2).mean()) * numbers / max(numbers - solution.unknowns, 1)
    return NoiseRatios(ratios, left / np.where(spread > 0, spread, np.nan), reduced, bool(solution.variances))


def all_at_bounds(paths: Sequence[str], coordinates: Floats) -> str | None:
    """Returns a sentence if all parameters have ended at a bound; None otherwise."""
    bounds = [bound_reached(each) for each in coordinates]
    if not all(bounds):
        return None
    places = listing([f"{clean(path)} at its {bound} bound" for path, bound in zip(paths, bounds, strict=True)])
    return (
        f"no values within the bounds of {option('free')} explain the measurements: {places}\nsigns, units or bounds "
        f"may be wrong; set a known value with {option('set')} instead"
    )


@dataclass(frozen=True)
class Improvement:
    """Improvement of the predictions by a fitted model over the original one.

    Attributes:
      before, after: errors in standard deviations of the noise.
      gain: decrease of the sum of squared errors under the loss.
      uncertainty: gain that chance alone may cause.
      difference: root mean square difference of the predictions, in the unit of the errors.
    """

    before: float
    after: float
    gain: float
    uncertainty: float
    difference: float

    @property
    def is_silent(self) -> bool:
        """True if both models predict the same within the noise, so the measurements cannot distinguish them."""
        return abs(self.gain) <= self.uncertainty and self.difference < self.after

    @property
    def is_certain(self) -> bool:
        """True if the gain exceeds its uncertainty."""
        return self.gain > self.uncertainty


def improvement(before: Solution, after: Solution) -> Improvement:
    """Compares two models by the same measurements.

    If the second is right, its residuals r are noise, and those of the first are r + δ: the gain is Σ δ² + 2 Σ δ·r,
    whose second part is chance. Its standard deviation is the larger of two estimates: from sums over blocks of time,
    within which r may be correlated, and from white noise.
    """
    loss = LOSSES[after.loss]
    scale = max(after.cost, 1e-12)
    gain, squares, numbers, sums = 0.0, 0.0, 0, list[float]()
    for r, other, weights in zip(after.residuals, before.residuals, after.weights, strict=True):
        gain += float(np.nansum(loss(other**2) - loss(r**2)))
        numbers += int(np.isfinite(r).sum())
        change = np.nan_to_num((other - r) * np.sqrt(weights))
        squares += float(np.nansum(change**2))
        products = np.nansum(change * np.nan_to_num(r) * np.sqrt(np.nan_to_num(weights)), axis=1)
        blocks = max(BLOCKS // len(after.residuals), 1)
        sums += [float(block.sum()) for block in np.array_split(products, min(blocks, len(products)))]
    deviation = 2 * max(float(np.sqrt(np.sum(np.square(sums)))), scale * float(np.sqrt(squares)))
    difference = float(np.sqrt(squares / max(numbers, 1)))
    return Improvement(before.cost, after.cost, gain, CERTAIN * deviation, difference)
