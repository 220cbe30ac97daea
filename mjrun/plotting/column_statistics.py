"""What a column holds, in a few numbers, while its table streams by."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ColumnStatistics:
    """A column in numbers: of those that are not NaN, the least, the largest and the mean; NaN if there are none.

    Attributes:
      last: of the last row, NaN or not.
      missing: rows on which it is NaN.
    """

    name: str
    unit: str
    least: float
    largest: float
    mean: float
    last: float
    missing: int


class ColumnCounter:
    """Counts the columns of a table, block by block; what it keeps does not grow with the rows."""

    def __init__(self, names: Sequence[str]) -> None:
        count = len(names)
        self.rows = 0
        self._names = tuple(names)
        self._present = np.zeros(count, int)
        self._least, self._largest = np.full(count, np.inf), np.full(count, -np.inf)
        self._mean, self._last = np.zeros(count), np.full(count, np.nan)

    def feed(self, block: np.ndarray) -> None:
        """Takes the next rows `(n, columns)`."""
        if not len(block):
            return
        here = ~np.isnan(block)
        present = here.sum(axis=0)
        self._least = np.minimum(self._least, np.where(here, block, np.inf).min(axis=0))
        self._largest = np.maximum(self._largest, np.where(here, block, -np.inf).max(axis=0))
        with np.errstate(all="ignore"):  # means of infinite values are infinite or NaN
            mean = np.where(here, block, 0.0).sum(axis=0) / np.maximum(present, 1)
            share = present / np.maximum(self._present + present, 1)
            self._mean = (1 - share) * self._mean + share * mean
        self._present += present
        self._last, self.rows = block[-1].copy(), self.rows + len(block)

    def statistics(self, units: Sequence[str]) -> list[ColumnStatistics]:
        """Every column, in the order of the table."""
        none, missing = self._present == 0, self.rows - self._present
        least, largest, mean = (np.where(none, np.nan, v) for v in (self._least, self._largest, self._mean))
        numbers = np.column_stack([least, largest, mean, self._last]).tolist()
        columns = zip(self._names, units, numbers, missing.tolist(), strict=True)
        return [
            ColumnStatistics(name, unit, least, largest, mean, last, nan)
            for name, unit, (least, largest, mean, last), nan in columns
        ]
