"""Metrics: one number of a simulation, such as `max(abs(energy/drift))` or `first(time, contact(ball, floor))`.

The language is that of assertions (`mjrun.probe.assertion`), with the same values to the last bit; every column of a
model may be used, as in a condition (`mjrun.probe.row_expression`). Aggregates of streamed rows are single values and
exact sums, independent of how the rows are split.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.probe.expression import (
    OF_CONDITIONS,
    START,
    AggregateCall,
    KnownValues,
    NumericExpression,
    ParsedExpression,
    evaluate,
    evaluate_truth,
    walk,
)
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import Vocabulary

EXTREMES = {"min": math.inf, "max": -math.inf}  # and the values that do not change them
JOINT = (*EXTREMES, "first", "last", *OF_CONDITIONS)
CHUNK = 512  # rows evaluated at once: the sum of 512 products of two 27-bit numbers fits 63 bits


@dataclass(frozen=True)
class RowChunk:
    """A chunk of consecutive rows.

    Attributes:
      columns: columns by name, `(count,)` each.
      rows: numbers of the rows, `(count,)`.
    """

    columns: dict[str, np.ndarray]
    rows: np.ndarray

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self.rows)

    def place(self, index: int) -> str:
        """Returns the place of the row at `index`, for the end of a message."""
        return _place_text(*self.row(index))

    def row(self, index: int) -> tuple[int, float | None]:
        """Returns the number of the row at `index`, and its time, if the table has one."""
        times = self.columns.get("time")
        return int(self.rows[index]), None if times is None else float(times[index])

    def only(self, chosen: np.ndarray) -> "RowChunk":
        """Returns the rows that `chosen`, `(count,)` booleans, selects."""
        return RowChunk({name: values[chosen] for name, values in self.columns.items()}, self.rows[chosen])


def _place_text(row: int, time: float | None) -> str:
    return f", at row {row}" + ("" if time is None else f", time {shown(time)} s")


def shown(value: float) -> str:
    """Returns `value` as the shortest text that reads back as the same float."""
    return repr(float(value)).removesuffix(".0")


_UNIT = 1126  # every float is a multiple of 2⁻¹¹²⁶, as the highest of its 53 bits is 2⁻¹⁰⁷³ or more
_LOW = 27
_POWERS = {"count": (), "sum": (1,), "mean": (1,), "rms": (2,), "std": (1, 2)}  # powers whose sums are needed


def _exact(values: np.ndarray, power: int) -> int:
    """Returns the exact sum of at most `CHUNK` finite values, or of their squares, in units of 2⁻¹¹²⁶ or its square."""
    fractions, exponents = np.frexp(values)
    mantissas = np.ldexp(fractions, 53).astype(np.int64)
    units, groups = np.unique(exponents, return_inverse=True)
    high, low = np.abs(mantissas) >> _LOW, np.abs(mantissas) & ((1 << _LOW) - 1)
    terms = {0: mantissas} if power == 1 else {0: low * low, _LOW + 1: high * low, 2 * _LOW: high * high}
    total = 0
    for shift, term in terms.items():
        sums = np.zeros(len(units), np.int64)
        np.add.at(sums, groups, term)
        total += sum(s << shift + power * (e - 53 + _UNIT) for s, e in zip(sums.tolist(), units.tolist(), strict=True))
    return total


def _ratio(numerator: int, denominator: int) -> float:
    """Returns the float nearest to a quotient; infinity beyond the range of floats."""
    try:
        return numerator / denominator
    except OverflowError:
        return math.inf if numerator > 0 else -math.inf


def _root(numerator: int, denominator: int) -> float:
    """Returns the float nearest to the square root of a quotient: a root with spare bits, the last of them sticky."""
    shift = (numerator.bit_length() - denominator.bit_length() - 109) // 2
    if shift < 0:
        numerator <<= -2 * shift
    else:
        denominator <<= 2 * shift
    root = math.isqrt(numerator // denominator)
    root |= root * root * denominator != numerator
    return _ratio(root << max(shift, 0), 1 << max(-shift, 0))


class SelectedRowAccumulator:
    """An accumulator of the value of one row, such as the largest.

    Args:
      find: returns the index of that row in a chunk.
      replaces: returns whether a chunk's value, its first argument, replaces the value of earlier chunks.
    """

    def __init__(self, find: Callable[[np.ndarray], Any], replaces: Callable[[float, float], bool]) -> None:
        self._find, self._replaces = find, replaces
        self._value: float | None = None
        self._row: tuple[int, float | None] = (0, None)

    def add(self, values: np.ndarray, chunk: RowChunk) -> None:
        """Adds the operand's values on the rows of the next chunk."""
        index = int(self._find(values))
        value = float(values[index])
        if self._value is None or self._replaces(value, self._value):
            self._value, self._row = value, chunk.row(index)

    @property
    def value(self) -> float:
        """The value; NaN before the first row."""
        return math.nan if self._value is None else self._value

    @property
    def place(self) -> str:
        """The place of the row."""
        return "" if self._value is None else _place_text(*self._row)


class MomentAccumulator:
    """An accumulator of exact sums of values and of squares, from which an aggregate follows.

    Attributes:
      place: place of the first value that is not finite, if any.
    """

    def __init__(self, name: str) -> None:
        self.place = ""
        self._name = name
        self._powers = _POWERS[name]
        self._count = 0
        self._totals = {1: 0, 2: 0}
        self._infinite = {1: 0.0, 2: 0.0}

    def add(self, values: np.ndarray, chunk: RowChunk) -> None:
        """Adds the operand's values on the rows of the next chunk."""
        self._count += len(values)
        if not self._powers:
            return
        finite = np.isfinite(values)
        if not finite.all():
            self.place = self.place or chunk.place(int(np.argmin(finite)))
            for power in (1, 2):
                self._infinite[power] += float(np.sum(values[~finite] ** power))
            values = values[finite]
        for power in self._powers:
            self._totals[power] += _exact(values, power)

    @property
    def value(self) -> float:
        """The aggregate of all rows so far."""
        n, total, squares = self._count, self._totals[1], self._totals[2]
        if self.place:
            return {"rms": self._infinite[2], "std": math.nan}.get(self._name, self._infinite[1])
        match self._name:
            case "count":
                return float(n)
            case "sum":
                return _ratio(total, 1 << _UNIT)
            case _ if not n:
                return math.nan
            case "mean":
                return _ratio(total, n << _UNIT)
            case "rms":
                return _root(squares, n << 2 * _UNIT)
        return _root(n * squares - total * total, n * n << 2 * _UNIT)


class QuantileAccumulator:
    """An accumulator of all values, for a quantile, which is interpolated linearly like numpy's."""

    def __init__(self, fraction: float) -> None:
        self._fraction = fraction
        self.place = ""
        self._values: list[np.ndarray] = []

    def add(self, values: np.ndarray, chunk: RowChunk) -> None:
        """Adds the operand's values on the rows of the next chunk."""
        self._values.append(np.array(values))

    @property
    def value(self) -> float:
        """The quantile of all rows so far; NaN before the first row."""
        values = np.sort(np.concatenate([np.empty(0), *self._values]))
        if not len(values) or math.isnan(values[-1]):
            return math.nan
        place = Fraction(self._fraction) * (len(values) - 1)
        low, high = values[math.floor(place)], values[math.ceil(place)]
        if low == high or not (math.isfinite(low) and math.isfinite(high)):
            return float(low if low == high else low + high)
        return float(Fraction(low) + (Fraction(high) - Fraction(low)) * (place % 1))  # rounded once


class ShareAccumulator:
    """An accumulator of the share of rows on which a condition holds."""

    place = ""

    def __init__(self) -> None:
        self._holds = self._rows = 0

    def add(self, holds: int, rows: int) -> None:
        """Adds the next rows, and the number of those on which it holds."""
        self._holds += holds
        self._rows += rows

    @property
    def value(self) -> float:
        """The share of all rows so far; NaN before the first."""
        return self._holds / self._rows if self._rows else math.nan


Accumulator = SelectedRowAccumulator | MomentAccumulator | QuantileAccumulator | ShareAccumulator


def accumulator(name: str, fraction: float = 0.5) -> Accumulator:
    """Returns a new accumulator of the aggregate `name`; `fraction` applies only to a quantile."""
    match name:
        case "median" | "quantile":
            return QuantileAccumulator(fraction)
        case "share":
            return ShareAccumulator()
        case "min":
            # The first NaN wins for good.
            return SelectedRowAccumulator(np.argmin, lambda new, old: old == old and not new >= old)
        case "max":
            return SelectedRowAccumulator(np.argmax, lambda new, old: old == old and not new <= old)
        case "first":
            return SelectedRowAccumulator(lambda values: 0, lambda new, old: False)
        case "last":
            return SelectedRowAccumulator(lambda values: len(values) - 1, lambda new, old: True)
    return MomentAccumulator(name)


def evaluate_rows(value: NumericExpression, chunk: RowChunk, known: KnownValues) -> np.ndarray:
    """Returns the value on each row of `chunk`: `(n,)`."""
    return _on_each_row(evaluate(value, chunk.columns, known), chunk.count)


def _on_each_row(values: Any, count: int) -> np.ndarray:
    has_rows = isinstance(values, np.ndarray) and values.shape == (count,)
    return values if has_rows else np.broadcast_to(values, count)  # which is slow


class ChunkBuffer:
    """A buffer of selected columns of blocks of rows, which makes chunks of `CHUNK` rows.

    Args:
      table: names of all columns of a block.
      wanted: names of the selected columns; `time` is added, if the table has it.
    """

    def __init__(self, table: Sequence[str], wanted: Iterable[str]) -> None:
        self._width = len(table)
        self._names = [name for name in dict.fromkeys(table) if name in {*wanted, "time"}]
        self._indices = [table.index(name) for name in self._names]
        self._buffer = np.empty((len(self._names), CHUNK))
        self._first = self._count = self._waiting = 0  # number of the first row, yielded rows, waiting rows

    @property
    def seen(self) -> int:
        """The number of rows so far."""
        return self._count + self._waiting

    def feed(self, block: np.ndarray, first_row: int) -> Iterator[RowChunk]:
        """Adds the rows from `first_row` on, and yields the complete chunks. The block may be reused.

        Raises:
          ValueError: the block has other columns, or does not follow the one before.
        """
        if block.ndim != 2 or block.shape[1] != self._width:
            raise ValueError(f"a block of shape {block.shape} for {self._width} columns")
        self._first = self._first if self.seen else first_row
        if first_row != self._first + self.seen:
            raise ValueError(f"a block from row {first_row} after row {self._first + self.seen - 1}")

        start = 0
        while start < len(block):
            rows = block[start : start + CHUNK - self._waiting, self._indices]
            self._buffer[:, self._waiting : self._waiting + len(rows)] = rows.T
            self._waiting, start = self._waiting + len(rows), start + len(rows)
            if self._waiting == CHUNK:
                yield from self.rest()

    def rest(self) -> Iterator[RowChunk]:
        """Yields the waiting rows, if any."""
        if not self._waiting:
            return
        columns = {name: row[: self._waiting] for name, row in zip(self._names, self._buffer, strict=True)}
        first = self._first + self._count
        self._count, self._waiting = self._count + self._waiting, 0
        yield RowChunk(columns, np.arange(first, self._first + self._count))


class AggregateEvaluator:
    """An evaluator of aggregates, from chunks of rows in their order.

    Args:
      calls: aggregates of an expression, operands first.

    Attributes:
      known: values of those that are known from the first row on; NaN for the others.
      rows: the number of rows on which the condition holds, for each with a condition.
    """

    def __init__(self, calls: Sequence[AggregateCall]) -> None:
        self._accumulators = {call: accumulator(call.name, call.fraction) for call in calls}
        self.known: KnownValues = dict.fromkeys(calls, math.nan)
        self.rows = {call: 0 for call in calls if call.condition is not None}

    def add(self, chunk: RowChunk) -> None:
        """Adds the next rows."""
        for call, accumulated in self._accumulators.items():
            holds, count = None, chunk.count
            if call.condition is not None:
                holds = _on_each_row(evaluate_truth(call.condition, chunk.columns, self.known), chunk.count)
                count = int(np.count_nonzero(holds))
                self.rows[call] += count
            if isinstance(accumulated, ShareAccumulator):
                accumulated.add(count, chunk.count)
            elif count:
                rows = chunk if holds is None else chunk.only(holds)
                accumulated.add(evaluate_rows(call.operand, rows, self.known), rows)
            if call.kind == START:
                self.known[call] = accumulated.value

    def values(self) -> KnownValues:
        """Returns the values over all rows."""
        return {call: accumulated.value for call, accumulated in self._accumulators.items()}

    def place(self, call: AggregateCall) -> str:
        """Returns the place of the row that decides the value of `call`, for a message; empty if several do."""
        return self._accumulators[call].place


# --- metrics -----------------------------------------------------------------------------------------


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
        """Returns the value of the table `index`; NaN without rows."""
        holds = int(self._holds[index])
        if not self._rows[index]:
            return math.nan
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
