"""Rows that stream by, in chunks that do not depend on how they are split into blocks, and aggregates over them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from mjrun.probe.aggregate import CHUNK, RowChunk, ShareAccumulator, accumulator
from mjrun.probe.evaluation import KnownValues, evaluate, evaluate_truth
from mjrun.probe.expression import START, AggregateCall, Node, NumericExpression


def evaluate_rows(value: NumericExpression, chunk: RowChunk, known: KnownValues) -> np.ndarray:
    """The value on each row of `chunk`: `(n,)`."""
    return _on_each_row(evaluate(value, chunk.columns, known), chunk.count)


def _on_each_row(values: Any, count: int) -> np.ndarray:
    has_rows = isinstance(values, np.ndarray) and values.shape == (count,)
    return values if has_rows else np.broadcast_to(values, count)  # which takes its time


class ChunkBuffer:
    """Some columns of blocks of rows, in chunks of `CHUNK` rows.

    Args:
      table: the names of all columns of a block.
      wanted: those that are needed; `time` is kept besides, where there is one.
    """

    def __init__(self, table: Sequence[str], wanted: Iterable[str]) -> None:
        self._width = len(table)
        self._names = [name for name in dict.fromkeys(table) if name in {*wanted, "time"}]
        self._indices = [table.index(name) for name in self._names]
        self._buffer = np.empty((len(self._names), CHUNK))
        self._first = self._count = self._waiting = 0  # rows handed on and rows that wait, from the first on

    @property
    def seen(self) -> int:
        """How many rows there were."""
        return self._count + self._waiting

    def feed(self, block: np.ndarray, first_row: int) -> Iterator[RowChunk]:
        """Takes the rows from `first_row` on, and yields the chunks that are complete. The block may be used again.

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
        """The rows that wait, if there are any."""
        if not self._waiting:
            return
        columns = {name: row[: self._waiting] for name, row in zip(self._names, self._buffer, strict=True)}
        first = self._first + self._count
        self._count, self._waiting = self._count + self._waiting, 0
        yield RowChunk(columns, np.arange(first, self._first + self._count))


class Aggregates:
    """The values of aggregates, from chunks of rows in their order.

    Args:
      nodes: of an expression, what is needed before what needs it; those that are aggregates count.

    Attributes:
      known: those that are known from the first row on; NaN for the others.
      rows: for each that has a condition, on how many rows that holds.
    """

    def __init__(self, nodes: Iterable[Node]) -> None:
        calls = [node for node in nodes if isinstance(node, AggregateCall)]
        self._accumulators = {call: accumulator(call.name, call.fraction) for call in calls}
        self.known: KnownValues = {}
        self.rows = {call: 0 for call in calls if call.condition is not None}

    def add(self, chunk: RowChunk) -> None:
        """Takes the next rows."""
        for call, accumulated in self._accumulators.items():
            rows = chunk
            if call.condition is not None:
                holds = _on_each_row(evaluate_truth(call.condition, chunk.columns, self.known), chunk.count)
                rows = chunk.only(holds)
                self.rows[call] += rows.count
            if isinstance(accumulated, ShareAccumulator):
                accumulated.rows += chunk.count
            if rows.count:
                accumulated.add(evaluate_rows(call.operand, rows, self.known), rows)
            self.known[call] = accumulated.value if call.kind == START else math.nan

    def values(self) -> KnownValues:
        """The values over all rows."""
        return {call: accumulated.value for call, accumulated in self._accumulators.items()}

    def place(self, call: AggregateCall) -> str:
        """The row that decides the value of `call`, for the end of a message; empty if there is no single one."""
        return self._accumulators[call].place
