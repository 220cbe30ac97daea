"""Metrics: one number of a simulation, such as `max(abs(energy/drift))` or `first(time, contact(ball, floor))`.

The language is that of assertions (`mjrun.probe.assertion`), with the same values to the last bit; every column of a
model may be used, as in a condition (`mjrun.probe.row_expression`).
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from mjrun.probe.aggregate import Aggregates, ChunkBuffer, RowChunk
from mjrun.probe.evaluation import evaluate
from mjrun.probe.expression import Expression
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import Vocabulary


class Metric(Expression):
    """One number of a table."""


class MetricEvaluation:
    """One pass of metrics over a table, block by block.

    Args:
      table: names of the columns of the table.
    """

    def __init__(self, metrics: Sequence[Metric], table: Sequence[str]) -> None:
        self._metrics = metrics
        self._rows = ChunkBuffer(table, {name for metric in metrics for name in metric.columns})
        self._aggregates = [Aggregates(metric.aggregates) for metric in metrics]

    def feed(self, block: np.ndarray) -> None:
        """Adds the next rows `(n, columns)`, one column for each of the table's."""
        self._take(self._rows.feed(block, self._rows.seen))

    def values(self) -> tuple[float, ...]:
        """Returns the metrics, after the last block; NaN without rows."""
        self._take(self._rows.rest())
        if not self._rows.seen:
            return (math.nan,) * len(self._metrics)
        with np.errstate(all="ignore"):
            pairs = zip(self._metrics, self._aggregates, strict=True)
            return tuple(float(evaluate(metric.root, {}, aggregates.values())) for metric, aggregates in pairs)

    def _take(self, chunks: Iterable[RowChunk]) -> None:
        with np.errstate(all="ignore"):
            for chunk in chunks:
                for aggregates in self._aggregates:
                    aggregates.add(chunk)


def parse_metric(text: str, columns: Sequence[str] | Vocabulary, label: str) -> Metric:
    """Parses a metric over a table of `columns`, or of those that a vocabulary names.

    Args:
      label: name of the text in messages: `option("metric")`.

    Raises:
      UnknownNameError: a column or function is unknown; the message lists near and valid ones.
      UsageError: the text is invalid; the message states where, what was found and what is valid.
    """
    return Metric(text, Parser(text, label, columns).table_value())
