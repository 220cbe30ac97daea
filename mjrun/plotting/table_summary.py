"""What a table holds, and what assertions say of it, while its rows stream by."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from mjrun.errors import concerning
from mjrun.plotting.column_statistics import ColumnCounter, ColumnStatistics
from mjrun.probe.assertion import Assertion, parse
from mjrun.probe.verdict import Verdict


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
