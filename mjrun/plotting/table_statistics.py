"""Statistics and assertions of a table, evaluated while its rows stream by."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.probe.assertion import parse_all
from mjrun.probe.verdict import Verdict


@dataclass(frozen=True)
class ColumnStatistics:
    """Statistics of a column: minimum, maximum and mean without NaN; NaN if there are no other values.

    Attributes:
      last: value in the last row, possibly NaN.
      missing: number of rows with NaN.
    """

    name: str
    unit: str
    least: float
    largest: float
    mean: float
    last: float
    missing: int


class TableStatisticsAccumulator:
    """An accumulator of a table's statistics, block by block, whose memory does not grow with the rows."""

    def __init__(self, names: Sequence[str]) -> None:
        count = len(names)
        self.rows = 0
        self._names = tuple(names)
        self._present = np.zeros(count, int)
        self._least, self._largest = np.full(count, np.inf), np.full(count, -np.inf)
        self._mean, self._last = np.zeros(count), np.full(count, np.nan)

    def feed(self, block: np.ndarray) -> None:
        """Adds rows `(n, columns)`."""
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
        """Returns the statistics of every column, in table order."""
        none, missing = self._present == 0, self.rows - self._present
        least, largest, mean = (np.where(none, np.nan, v) for v in (self._least, self._largest, self._mean))
        numbers = np.column_stack([least, largest, mean, self._last]).tolist()
        columns = zip(self._names, units, numbers, missing.tolist(), strict=True)
        return [
            ColumnStatistics(name, unit, least, largest, mean, last, nan)
            for name, unit, (least, largest, mean, last), nan in columns
        ]


class TableSummarizer:
    """A summarizer of a table, which reads every row once.

    Args:
      path: path of the table.
      units: units of all columns, by name.
      columns: those to summarize; None for all.
      assertions: assertions, which may read any column.

    Attributes:
      names: names of the columns to read.

    Raises:
      UsageError: an assertion is malformed, or names no column.
    """

    def __init__(
        self, path: str, units: Mapping[str, str], columns: Collection[str] | None, assertions: Sequence[str]
    ) -> None:
        read = {name for assertion in parse_all(assertions, list(units)) for name in assertion.columns}
        self.path = path
        self.names = [name for name in units if columns is None or name in columns or name in read]
        self._units = [units[name] for name in self.names]
        self._counter = TableStatisticsAccumulator(self.names)
        self._checkers = [assertion.checker() for assertion in parse_all(assertions, self.names)]

    def feed(self, columns: Mapping[str, np.ndarray]) -> None:
        """Adds rows: `(n,)` of each column by name; extra columns are ignored."""
        block = np.column_stack([columns[name] for name in self.names])
        for checker in self._checkers:
            checker.feed(block, self._counter.rows)
        self._counter.feed(block)

    @property
    def rows(self) -> int:
        """The number of rows so far."""
        return self._counter.rows

    def statistics(self) -> list[ColumnStatistics]:
        """Returns the statistics of every column, after the last row."""
        return self._counter.statistics(self._units)

    def verdicts(self) -> list[Verdict]:
        """Returns the outcome of every assertion; to be called once, after the last row."""
        return [checker.verdict() for checker in self._checkers]
