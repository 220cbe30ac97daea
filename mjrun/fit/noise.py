"""How noisy measurements are, before anything is fitted to them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjrun.fit.measurements import Segment
from mjrun.fit.rotations import shared

LEAST_NOISE = 1e-7  # of the standard deviation of a signal: what simulated data are taken for
NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of absolute values

Floats = NDArray[np.float64]


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
