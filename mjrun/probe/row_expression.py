"""Expressions with one value per row of a table, or per instant of a simulation: conditions, and numbers.

The language is that of `mjrun.probe.assertion`, without comparisons in numbers, and without aggregates in conditions;
of aggregates, numbers can use `first(x)` alone, since it is known from the first row on. What is more:

    speed(box)                  the column `speed/box`
    xpos(top).z                 the column `xpos/top/z`
    contact(ball, floor)        the column `contact/ball/floor`, the number of contacts between the two

An object is written as a column is, quoted where it needs quotes: `speed('left (upper)')`. Which columns there are, a
vocabulary tells: those of a table, or all that can be asked for as probes, by each of their names. A number of contacts
may stand where a comparison may, and holds above zero: `not contact(ball, floor)`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjrun.probe.evaluation import KnownValues, evaluate, evaluate_truth
from mjrun.probe.expression import START, AggregateCall, Expression, NumericExpression, walk
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import Vocabulary


class Condition(Expression):
    """A condition on each row."""

    def holds(self, columns: Mapping[str, Any]) -> np.ndarray:
        """At which of n rows it holds: `(n,)` bool; `columns` are `(n,)` each, by name. No comparison with NaN does."""
        with np.errstate(all="ignore"):
            return evaluate_truth(self.root, columns, {})


class RowExpression(Expression):
    """A number per row."""

    def evaluator(self) -> "RowEvaluator":
        """A new evaluation, which has seen no row."""
        return RowEvaluator(self.root)

    def values(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """The values `(n,)` float64 on all rows of a table in memory."""
        return self.evaluator().feed(columns)


class RowEvaluator:
    """One pass of an expression over a table, block by block."""

    def __init__(self, value: NumericExpression) -> None:
        self._value = value
        self._first: KnownValues | None = None

    def feed(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """The values `(n,)` float64 on the next rows; `columns` are `(n,)` each, by name."""
        block = dict(columns)
        count = len(next(iter(block.values())))
        if not count:
            return np.empty(0)
        with np.errstate(all="ignore"):  # 1/0 is inf, as in assertions
            if self._first is None:
                self._first = self._first_values({name: values[:1] for name, values in block.items()})
            value = evaluate(self._value, block, self._first)
        return np.array(np.broadcast_to(value, count), np.float64)

    def _first_values(self, row: dict[str, np.ndarray]) -> KnownValues:
        known: KnownValues = {}
        for node in walk(self._value):
            if isinstance(node, AggregateCall) and node.kind == START:
                known[node] = float(np.ravel(evaluate(node.operand, row, known))[0])
        return known


class RisingEdgeDetector:
    """Where a condition begins to hold, while rows come by in blocks."""

    def __init__(self) -> None:
        self.indices: list[int] = []  # of rows, counted from the first
        self._count, self._held = 0, False

    def feed(self, holds: np.ndarray) -> None:
        """Takes the next rows: `(n,)` bool, whether it holds at each."""
        before = np.concatenate([[self._held], holds])
        begins = holds & ~before[:-1]
        self.indices += (self._count + np.flatnonzero(begins)).tolist()
        self._count, self._held = self._count + len(holds), bool(before[-1])


def parse_condition(text: str, vocabulary: Vocabulary, label: str) -> Condition:
    """The condition that `text` is over the columns that a vocabulary names.

    Args:
      label: what messages call the text: `when`, `option("mark_event")`.

    Raises:
      UnknownNameError: a name is that of no column, object or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    return Condition(text, Parser(text, label, vocabulary).condition())


def parse_row_expression(text: str, columns: Sequence[str] | Vocabulary, label: str) -> RowExpression:
    """The number per row that `text` is over a table of `columns`, or of those that a vocabulary names.

    Args:
      label: what messages call the text: `option("y")`.

    Raises:
      UnknownNameError: a name is that of no column or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    return RowExpression(text, Parser(text, label, columns).row_value())
