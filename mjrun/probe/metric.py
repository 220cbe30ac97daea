"""Metrics: one number of a simulation, such as `max(abs(energy/drift))` or `first(time, contact(ball, floor))`.

The language is that of assertions (`mjrun.probe.assertion`), and so are the values, to the last bit; every column that
a model offers may be used, as in an event (`mjrun.probe.event`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.probe.expression import NumericExpression, columns_read, evaluate, walk
from mjrun.probe.parser import Parser
from mjrun.probe.row_chunks import Aggregates, ChunkBuffer
from mjrun.probe.scanner import SourceText, Vocabulary


@dataclass(frozen=True, eq=False)
class Metric:
    """A metric that is well formed.

    Attributes:
      text: as it was written.
      columns: the names of the columns that it reads, in the order in which it first mentions them.
    """

    text: str
    columns: tuple[str, ...]
    _value: NumericExpression = field(repr=False)

    def evaluator(self, table: Sequence[str]) -> "MetricEvaluator":
        """A new evaluation over a table with these columns, which has seen no row."""
        return MetricEvaluator(self, table)


class MetricEvaluator:
    """One pass of a metric over a table, block by block."""

    def __init__(self, metric: Metric, table: Sequence[str]) -> None:
        self._expression = metric._value
        self._rows = ChunkBuffer(table, metric.columns)
        self._aggregates = Aggregates(walk(self._expression))

    def feed(self, block: np.ndarray) -> None:
        """Takes the next rows `(n, columns)`, one column for each of the table's."""
        with np.errstate(all="ignore"):
            for chunk in self._rows.feed(block, self._rows.seen):
                self._aggregates.add(chunk)

    def value(self) -> float:
        """The metric, after the last block; NaN without rows."""
        with np.errstate(all="ignore"):
            for chunk in self._rows.rest():
                self._aggregates.add(chunk)
            return float(evaluate(self._expression, {}, self._aggregates.values())) if self._rows.seen else math.nan


def parse_metric(text: str, columns: Sequence[str] | Vocabulary, label: str) -> Metric:
    """The metric that `text` is over a table of `columns`, or of those that a vocabulary names.

    Args:
      label: what messages call the text: `option("metric")`.

    Raises:
      UnknownNameError: a name is that of no column or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    vocabulary = columns if isinstance(columns, Vocabulary) else Vocabulary(columns)
    value = Parser(SourceText(text, label), vocabulary).table_value()
    read = columns_read(value)
    return Metric(text, read, value)
