"""Which parameters move a metric: rank correlations."""

from collections.abc import Sequence

import numpy as np

from mjrun.packages import require


def rank_correlations(parameters: Sequence[np.ndarray], metric: np.ndarray) -> np.ndarray:
    """Spearman's rank correlation of each parameter `(n,)` with `metric` `(n,)`: from -1 to 1, `(parameters,)`.

    Points at which either is not finite are left out. What does not vary, or has fewer than three points, has none:
    NaN.

    Raises:
      MissingExtraError: scipy is not installed.
    """
    require("rank correlations", "sweep", "scipy")
    from scipy.stats import spearmanr

    found = np.full(len(parameters), np.nan)
    for index, values in enumerate(parameters):
        usable = np.isfinite(values) & np.isfinite(metric)
        a, b = values[usable], metric[usable]
        if len(a) >= 3 and np.ptp(a) > 0 and np.ptp(b) > 0:
            found[index], _ = spearmanr(a, b)
    return found
