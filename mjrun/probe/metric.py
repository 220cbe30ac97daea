"""Metrics: one number of a simulation, such as `max(abs(energy/drift))` or `first(time, contact(ball, floor))`.

The language is that of assertions (`mjrun.probe.assertion`), with the same values to the last bit; every column of a
model may be used, as in a condition (`mjrun.probe.row_expression`).
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from mjrun.probe.aggregate import AggregateEvaluator, ChunkBuffer, RowChunk
from mjrun.probe.expression import (
    OF_CONDITIONS,
    AggregateCall,
    KnownValues,
    ParsedExpression,
    evaluate,
    evaluate_truth,
    walk,
)
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import Vocabulary

EXTREMES = {"min": math.inf, "max": -math.inf}  # and the values that do not change them
JOINT = (*EXTREMES, "first", "last", *OF_CONDITIONS)


class Metric(ParsedExpression):
    """One number of a table."""


class MetricEvaluator:
    """An evaluator of metrics in one pass over a table, block by block.

    Args:
      table: names of the columns of the table.
    """

    def __init__(self, metrics: Sequence[Metric], table: Sequence[str]) -> None:
        self._metrics = metrics
        self._rows = ChunkBuffer(table, {name for metric in metrics for name in metric.columns})
        self._aggregates = [AggregateEvaluator(metric.aggregates) for metric in metrics]

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


class BatchMetricEvaluator:
    """An evaluator of metrics in one pass over n tables, row by row; every value is that of its table alone.

    Args:
      table: names of the columns of each table.
      count: number of tables.
    """

    def __init__(self, metrics: Sequence[Metric], table: Sequence[str], count: int) -> None:
        self._table, self._count = table, count
        self._metrics = [(metric, _is_joint(metric)) for metric in metrics]
        joint = [metric for metric, is_joint in self._metrics if is_joint]
        self._joint = {call: _JointAggregate(call, count) for metric in joint for call in metric.aggregates}
        others = [metric for metric, is_joint in self._metrics if not is_joint]
        self._alone = [MetricEvaluator(others, table) for _ in range(count)] if others else []

    def feed(self, tables: np.ndarray, counts: np.ndarray) -> None:
        """Adds the next rows `(n, rows, columns)`.

        Args:
          counts: number of valid rows of each table, `(n,)`.
        """
        for evaluation, table, count in zip(self._alone, tables, counts, strict=False):
            evaluation.feed(table[:count])
        shape = tables.shape[:2]
        is_valid = np.arange(shape[1]) < counts[:, None]
        columns = dict(zip(self._table, np.ascontiguousarray(tables.reshape(-1, tables.shape[2]).T), strict=True))
        with np.errstate(all="ignore"):
            for call, aggregate in self._joint.items():
                values = np.broadcast_to(evaluate(call.operand, columns, {}), math.prod(shape)).reshape(shape)
                holds = np.True_ if call.condition is None else evaluate_truth(call.condition, columns, {})
                aggregate.add(values, np.broadcast_to(holds, math.prod(shape)).reshape(shape) & is_valid, counts)

    def values(self) -> list[tuple[float, ...]]:
        """Returns the metrics of each table, after the last rows."""
        with np.errstate(all="ignore"):
            return [self._values(index) for index in range(self._count)]

    def _values(self, index: int) -> tuple[float, ...]:
        known: KnownValues = {call: aggregate.value(index) for call, aggregate in self._joint.items()}
        alone = iter(self._alone[index].values() if self._alone else ())
        return tuple(
            float(evaluate(metric.root, {}, known)) if is_joint else next(alone) for metric, is_joint in self._metrics
        )


class _JointAggregate:
    """An aggregate of n tables that selects or counts rows."""

    def __init__(self, call: AggregateCall, count: int) -> None:
        self._name, self._rows = call.name, np.zeros(count, int)
        self._holds = np.zeros(count, int)  # rows on which the condition holds
        self._values = np.empty(count)

    def add(self, values: np.ndarray, holds: np.ndarray, counts: np.ndarray) -> None:
        """Adds the operand's values on the next rows `(n, rows)`, and whether the condition holds there.

        Args:
          counts: number of valid rows of each table, `(n,)`.
        """
        is_first, new_holds = self._holds == 0, np.count_nonzero(holds, axis=1)
        self._rows += counts
        self._holds += new_holds
        if self._name in OF_CONDITIONS:
            return
        if self._name in EXTREMES:
            values = np.where(holds, values, EXTREMES[self._name])
        new, old = values[np.arange(len(values)), self._rows_of(values, holds)], self._values
        match self._name:
            case "min":
                is_new = (old == old) & ~(new >= old)  # the first NaN wins for good
            case "max":
                is_new = (old == old) & ~(new <= old)
            case name:
                is_new = np.bool_(name == "last")
        self._values = np.where((new_holds > 0) & (is_first | is_new), new, old)

    def value(self, index: int) -> float:
        """Returns the value of the table `index`."""
        holds = int(self._holds[index])
        if self._name in OF_CONDITIONS:
            return holds / int(self._rows[index]) if self._name == "share" else float(holds)
        return float(self._values[index]) if holds else math.nan

    def _rows_of(self, values: np.ndarray, holds: np.ndarray) -> np.ndarray:
        """Returns the selected row of each table `(n,)`."""
        match self._name:
            case "min":
                return values.argmin(axis=1)
            case "max":
                return values.argmax(axis=1)
            case "first":
                return holds.argmax(axis=1)
        return holds.shape[1] - 1 - holds[:, ::-1].argmax(axis=1)


def _is_joint(metric: Metric) -> bool:
    """Returns whether a metric is computed over all tables together: its aggregates select or count rows."""
    return all(
        call.name in JOINT and not any(isinstance(node, AggregateCall) for node in walk(call) if node is not call)
        for call in metric.aggregates
    )


def parse_metric(text: str, columns: Sequence[str] | Vocabulary, label: str) -> Metric:
    """Parses a metric over a table of `columns`, or of those that a vocabulary names.

    Args:
      label: name of the text in messages: `option("metric")`.

    Raises:
      UnknownNameError: a column or function is unknown; the message lists near and valid ones.
      UsageError: the text is invalid; the message states where, what was found and what is valid.
    """
    return Metric(text, Parser(text, label, columns).table_value())
