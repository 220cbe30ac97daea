"""Rows of numbers by time: their times checked, their gaps filled, and their values at any time."""

from collections.abc import Mapping

import numpy as np

from mjrun.errors import FileError, UsageError, clean, counted

SLACK = 1e-3  # timesteps: the times of a table may be sums of floats


class TimedRows:
    """Numbers by time: each row holds until the next, or changes to it in a straight line. The last one holds to the
    end.

    Args:
      time: the time of each row [s], `(n,)`.
      columns: the numbers by name, `(n,)` each.
      source: the name of the table in messages.
      linear: interpolate; otherwise hold.

    Raises:
      FileError: there are no rows.
      UsageError: the times do not ascend or begin too late, or a number is not finite.
    """

    def __init__(self, time: np.ndarray, columns: Mapping[str, np.ndarray], source: str, linear: bool = False) -> None:
        require_times(time, source)
        if time[0] > 0:
            raise UsageError(f"{clean(source)} begins at {time[0]:.15g} s; add a row at time 0")
        self._time, self._linear = time, linear
        self._values = np.column_stack([*columns.values()])
        bad = np.argwhere(~np.isfinite(self._values))
        if len(bad):
            row, column = bad[0]
            text = f"{[*columns][column]} is {self._values[row, column]}"
            raise UsageError(f"{clean(source)}, row {row}: {clean(text)}; it must be finite")

    @property
    def end(self) -> float:
        """The time of the last row [s]."""
        return float(self._time[-1])

    def at(self, times: np.ndarray, timestep: float) -> np.ndarray:
        """Returns the values at `times` [s], `(m, columns)`; `timestep` [s] is the scale of their rounding errors."""
        if self._linear:
            columns: list[np.ndarray] = [np.interp(times, self._time, column) for column in self._values.T]
            return np.column_stack(columns)
        return self._values[np.searchsorted(self._time, times + SLACK * timestep, side="right") - 1]


def require_times(time: np.ndarray, source: str) -> None:
    """Checks that `time` `(n,)` [s] of `source` has rows in ascending order.

    Raises:
      FileError: `time` is empty.
      UsageError: its rows do not ascend.
    """
    if not len(time):
        raise FileError(source, "has no rows")
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise UsageError(f"{clean(source)}, row {bad[0]}: time is {time[bad[0]]}; it must be finite")
    bad = np.flatnonzero(np.diff(time) <= 0)
    if len(bad):
        before, after = time[bad[0]], time[bad[0] + 1]
        others = f" (also in {counted(len(bad) - 1, 'other row')})" if len(bad) > 1 else ""
        raise UsageError(
            f"{clean(source)}, row {bad[0] + 1}: time {after:.15g} follows {before:.15g}; times must ascend{others}\n"
            "remove rows until each has a later time than the one before; the first row is row 0"
        )


def without_gaps(time: np.ndarray, values: np.ndarray, rows: np.ndarray, linear: bool) -> np.ndarray:
    """Fills the gaps between the present `rows` of `values` `(n,)`: linearly, or with the value before the gap.

    Rows before the first present one get its value.
    """
    if len(rows) == len(values):
        return values
    if linear:
        return np.array(np.interp(time, time[rows], values[rows]))
    before = np.searchsorted(rows, np.arange(len(values)), side="right") - 1
    return values[rows[np.maximum(before, 0)]]
