"""Which parameters move a metric: rank correlations."""

import importlib.util
from collections.abc import Sequence

import numpy as np

from mjrun.errors import MissingExtraError


def rank_correlations(parameters: Sequence[np.ndarray], metric: np.ndarray) -> np.ndarray:
    """Spearman's rank correlation of each parameter `(n,)` with `metric` `(n,)`: from -1 to 1, `(parameters,)`.

    Points at which either is not finite are left out. What does not vary, or has fewer than three points, has none:
    NaN.

    Raises:
      MissingExtraError: scipy is not installed.
    """
    if importlib.util.find_spec("scipy") is None:
        raise MissingExtraError("rank correlations", "scipy", "sweep")
    from scipy.stats import spearmanr

    found = np.full(len(parameters), np.nan)
    for index, values in enumerate(parameters):
        usable = np.isfinite(values) & np.isfinite(metric)
        a, b = values[usable], metric[usable]
        if len(a) >= 3 and np.ptp(a) > 0 and np.ptp(b) > 0:
            found[index], _ = spearmanr(a, b)
    return found
