"""What a table holds, and what assertions say of it, while its rows stream by."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import concerning
from mjrun.probe.assertion import Assertion, parse
from mjrun.probe.verdict import Verdict


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


class TableSummary:
    """A table, of which it takes all rows once.

    Args:
      path: what it is called.
      units: of all its columns, by name.
      columns: those to summarize; None for all.
      assertions: what must hold; they may read any column.

    Attributes:
      names: of the columns that it takes.

    Raises:
      UsageError: an assertion is not well formed, or names no column.
    """

    def __init__(
        self, path: str, units: Mapping[str, str], columns: Collection[str] | None, assertions: Sequence[str]
    ) -> None:
        read = {name for assertion in _parsed(assertions, list(units)) for name in assertion.columns}
        self.path = path
        self.names = [name for name in units if columns is None or name in columns or name in read]
        self._units = [units[name] for name in self.names]
        self._counter = ColumnCounter(self.names)
        self._checkers = [assertion.checker() for assertion in _parsed(assertions, self.names)]

    def feed(self, columns: Mapping[str, np.ndarray]) -> None:
        """Takes the next rows: `(n,)` of each column by name, of which there may be more."""
        block = np.column_stack([columns[name] for name in self.names])
        for checker in self._checkers:
            checker.feed(block, self._counter.rows)
        self._counter.feed(block)

    @property
    def rows(self) -> int:
        """Rows so far."""
        return self._counter.rows

    def statistics(self) -> list[ColumnStatistics]:
        """What every column holds, after the last row."""
        return self._counter.statistics(self._units)

    def verdicts(self) -> list[Verdict]:
        """The outcome of every assertion; to be asked for once, after the last row."""
        return [checker.verdict() for checker in self._checkers]


def _parsed(texts: Sequence[str], names: Sequence[str]) -> list[Assertion]:
    assertions: list[Assertion] = []
    for index, text in enumerate(texts):
        with concerning("assert", index):
            assertions.append(parse(text, names))
    return assertions
