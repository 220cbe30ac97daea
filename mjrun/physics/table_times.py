"""The times of a table's rows."""

import numpy as np

from mjrun.errors import UsageError, clean

SLACK = 1e-3  # of a timestep: a table's times may be sums of floats


def require_times(time: np.ndarray, source: str) -> None:
    """Raises UsageError unless `time` `(n,)` [s] has rows, and they ascend; `source` is what has them."""
    if not len(time):
        raise UsageError(f"{clean(source)} has no rows")
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise UsageError(f"{clean(source)}, row {bad[0]}: time is {time[bad[0]]}, and must be finite")
    bad = np.flatnonzero(np.diff(time) <= 0)
    if len(bad):
        before, after = time[bad[0]], time[bad[0] + 1]
        raise UsageError(f"{clean(source)}, row {bad[0] + 1}: time {after:.9g} follows {before:.9g}, and must grow")
