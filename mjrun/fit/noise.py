"""How noisy measurements are, before anything is fitted to them."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from mjrun.errors import BadValueError, UnknownNameError, clean, option
from mjrun.fit.measurements import Segment
from mjrun.fit.rotations import shared

LEAST_NOISE = 1e-7  # of the standard deviation of a signal: what simulated data are taken for
NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of absolute values

OUTLYING = 2.5  # standard deviations at which differences are clipped, as contacts and outliers make some large
CLIPPED = 0.97756  # variance of a normal distribution that is clipped there

Floats = NDArray[np.float64]


def spread_of(values: Floats, loss: str = "linear") -> Floats:
    """The standard deviation of each signal, `(signals,)`; under a robust loss that of its middle half."""
    if loss == "linear":
        return np.nanstd(values, axis=0)
    return np.nanmedian(np.abs(values - np.nanmedian(values, axis=0)), axis=0) * NORMAL_MEDIAN


def set_noise(texts: Sequence[tuple[str, str]], signals: Sequence[str]) -> dict[int, float]:
    """The standard deviations that the user knows, by the places of signals.

    Raises:
      UsageError: a name of no signal, or no number above 0.
    """
    known: dict[int, float] = {}
    for pattern, text in texts:
        matches = [i for i, name in enumerate(signals) if name == pattern or fnmatchcase(name, pattern)]
        if not matches:
            raise UnknownNameError("signal", pattern, signals, where=option("noise"))
        try:
            deviation = float(text)
        except ValueError:
            deviation = 0.0
        if not 0 < deviation < np.inf:
            raise BadValueError(f"{option('noise')} {clean(pattern)}", text, "a standard deviation above 0")
        known |= dict.fromkeys(matches, deviation)
    return known


def first_noise(segments: Sequence[Segment], rotations: Sequence[Sequence[int]] = ()) -> Floats:
    """The noise of each signal from third differences, in which smooth motion hardly shows: `(signals,)`.

    White noise of standard deviation s has third differences of √20·s.
    """
    differences = np.concatenate([np.diff(segment.values, 3, axis=0) for segment in segments])
    spread = np.nanmedian(np.abs(differences), axis=0) * NORMAL_MEDIAN
    limit = OUTLYING * np.where(spread > 0, spread, np.inf)
    spread = np.sqrt(np.nanmean(np.clip(differences, -limit, limit) ** 2, axis=0) / CLIPPED / 20) * (spread > 0)
    values = np.concatenate([segment.values for segment in segments])
    return np.maximum(shared(spread, rotations), LEAST_NOISE * shared(np.nanstd(values, axis=0), rotations))
