"""Expressions with one value per row of a table, such as `knee_deg * pi/180`: the arithmetic of assertions.

The language is that of `mjrun.probe.assertion`, without comparisons; of aggregates, `first(x)` alone can be used, since
it is known from the first row on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.probe.evaluation import KnownValues, evaluate
from mjrun.probe.expression import START, AggregateCall, NumericExpression, columns_read, walk
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import SourceText, Vocabulary


@dataclass(frozen=True, eq=False)
class RowExpression:
    """An expression that is well formed.

    Attributes:
      text: as it was written.
      columns: the names of the columns that it reads, in the order in which it first mentions them.
    """

    text: str
    columns: tuple[str, ...]
    _value: NumericExpression = field(repr=False)

    def evaluator(self) -> "RowEvaluator":
        """A new evaluation, which has seen no row."""
        return RowEvaluator(self._value)

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
        if self._first is None:
            self._first = self._first_values({name: values[:1] for name, values in block.items()})

        with np.errstate(all="ignore"):  # 1/0 is inf, as in assertions
            value = evaluate(self._value, block, self._first)
        return np.array(np.broadcast_to(value, count), np.float64)

    def _first_values(self, row: dict[str, np.ndarray]) -> KnownValues:
        known: KnownValues = {}
        for node in walk(self._value):
            if isinstance(node, AggregateCall) and node.kind == START:
                with np.errstate(all="ignore"):
                    known[node] = float(np.ravel(evaluate(node.operand, row, known))[0])
        return known


def parse_row_expression(text: str, columns: Sequence[str] | Vocabulary, label: str) -> RowExpression:
    """The expression that `text` is over a table of `columns`, or of those that a vocabulary names.

    Args:
      label: what messages call the text: `option("y")`.

    Raises:
      UnknownNameError: a name is that of no column or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    vocabulary = columns if isinstance(columns, Vocabulary) else Vocabulary(columns)
    value = Parser(SourceText(text, label), vocabulary).row_value()
    read = columns_read(value)
    return RowExpression(text, read, value)
