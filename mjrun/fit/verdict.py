"""Whether a fit may be believed: how far its residuals are beyond the noise, and whether it predicts better."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import clean, listing, option
from mjrun.fit.intervals import bound_reached
from mjrun.fit.noise import spread_of
from mjrun.fit.rotations import shared
from mjrun.fit.solution import LOSSES, Floats, Solution
from mjrun.model.column import Column

MISFIT = 2.0  # reduced χ² from which on the user is warned
HOPELESS, HOPELESS_SHARE = 10.0, 0.1  # residual over noise, and over the spread of a signal: beyond, nothing is written
LEAST = 1e-5  # noise of a signal, in its standard deviation: less is not distinguished from none
BLOCKS = 20  # of what is held out, in which errors are taken to be independent
CERTAIN = 2.0  # standard deviations


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals of a fit beside the noise of the log.

    Attributes:
      ratios: of each signal, residual over noise, `(signals,)`.
      shares: of each signal, residual over its spread, `(signals,)`.
      reduced: reduced χ², about 1 where the model explains all but noise.
      is_rough: whether contacts make the motion rough.
    """

    ratios: Floats
    shares: Floats
    reduced: float
    is_rough: bool

    def warning(self) -> str | None:
        """A sentence on a misfit; None without one."""
        if self.reduced < MISFIT:
            return None
        beyond = f"the fit leaves residuals beyond the noise of the log (reduced χ² {self.reduced:.3g}): "
        if self.is_rough:
            return (
                f"{beyond}contacts make the motion rough, and simulations that are as near as this still rattle in "
                "another way, or the model lacks something, so that true values may be outside of the intervals"
            )
        return (
            f"{beyond}the model lacks something, so that true values may be outside of the intervals, which only count "
            f"scatter\nif the noise is larger than the log's high frequencies show, {option('noise')} sets it"
        )

    def refusal(self, columns: Sequence[Column], noise: Floats) -> str | None:
        """Why nothing is written; None if the residuals may do."""
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


def misfit(solution: Solution, noise: Floats, rotations: Sequence[Sequence[int]]) -> Misfit:
    """How far the residuals of a solution are beyond the noise of the log."""
    values = np.concatenate([part.values for part in solution.chunks])
    spread = shared(spread_of(values, solution.loss), rotations)
    left = shared(solution.noise_scale, rotations)
    ratios = left / np.maximum(noise, LEAST * spread)
    numbers = sum(int(np.isfinite(each).sum()) for each in solution.residuals)
    reduced = float((ratios**2).mean()) * numbers / max(numbers - solution.unknowns, 1)
    return Misfit(ratios, left / np.where(spread > 0, spread, np.nan), reduced, bool(solution.variances))


def all_at_bounds(paths: Sequence[str], coordinates: Floats) -> str | None:
    """A sentence if all parameters have ended at a bound; None otherwise."""
    bounds = [bound_reached(each) for each in coordinates]
    if not all(bounds):
        return None
    places = listing([f"{clean(path)} at its {bound} bound" for path, bound in zip(paths, bounds, strict=True)])
    return (
        f"nothing within the bounds of {option('free')} explains the measurements: {places}\nsigns, units or bounds "
        f"may be wrong; a value that is known is {option('set')} instead"
    )


@dataclass(frozen=True)
class Improvement:
    """By how much a fitted model predicts better than the model as it was.

    Attributes:
      before, after: errors, in standard deviations of the noise.
      gain: decrease of the sum of squared errors, as the loss counts them.
      uncertainty: what chance alone may make of it.
      difference: root mean square of how far the predictions are from each other, in the same unit as the errors.
    """

    before: float
    after: float
    gain: float
    uncertainty: float
    difference: float

    @property
    def is_silent(self) -> bool:
        """Whether the measurements do not distinguish the models: both predict the same but for noise."""
        return abs(self.gain) <= self.uncertainty and self.difference < self.after

    @property
    def is_certain(self) -> bool:
        """Whether the gain exceeds its uncertainty."""
        return self.gain > self.uncertainty


def improvement(before: Solution, after: Solution) -> Improvement:
    """Compares two models by the same measurements.

    If the second is right, its residuals r are noise, and those of the first are r + δ: the gain is Σ δ² + 2 Σ δ·r,
    whose second part is chance. Its standard deviation is taken from sums over blocks of time, in which r may be
    correlated, and from white noise, whichever is more.
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
