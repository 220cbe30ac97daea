"""Expressions with one value per row of a table, or per instant of a simulation: conditions, and numbers.

The language is that of `mjrun.probe.assertion`, without comparisons in numbers, and without aggregates in conditions;
the only aggregate in numbers is `first(x)`, since it is known from the first row on. In addition:

    speed(box)                  the column `speed/box`
    xpos(top).z                 the column `xpos/top/z`
    contact(ball, floor)        the column `contact/ball/floor`, the number of contacts between the two

An object is written like a column, in quotes if necessary: `speed('left (upper)')`. A vocabulary names the columns:
those of a table, or all probes of a model, by each of their names. A number of contacts may replace a comparison, and
holds above zero: `not contact(ball, floor)`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjrun.probe import expression as tree
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import QUOTES, Vocabulary

NO_MATCHES: Mapping[tree.TextMatch, np.ndarray] = {}


class Condition(tree.ParsedExpression):
    """A condition on each row."""

    def holds(
        self, columns: Mapping[str, Any], matches: Mapping[tree.TextMatch, np.ndarray] = NO_MATCHES
    ) -> np.ndarray:
        """Returns where it holds, `(n,)` bool. No comparison with NaN holds.

        Args:
          columns: the columns `(n,)`, by name.
          matches: the values `(n,)` of its comparisons with texts.
        """
        with np.errstate(all="ignore"):
            return tree.evaluate_truth(self.root, columns, {**matches})


class RowExpression(tree.ParsedExpression):
    """A number per row."""

    @property
    def is_column(self) -> bool:
        """True if its value is a column, unchanged."""
        return isinstance(self.root, tree.ColumnReference)

    def evaluator(self) -> "RowEvaluator":
        """Returns a new evaluation, to which no rows were added yet."""
        return RowEvaluator(self.root)

    def values(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Returns the values `(n,)` float64 on all rows of a table in memory."""
        return self.evaluator().feed(columns)


class RowEvaluator:
    """An evaluator of an expression in one pass over a table, block by block."""

    def __init__(self, value: tree.NumericExpression) -> None:
        self._value = value
        self._first: tree.KnownValues | None = None

    def feed(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Returns the values `(n,)` float64 on the next rows; `columns` are `(n,)` each, by name."""
        block = dict(columns)
        count = len(next(iter(block.values())))
        if not count:
            return np.empty(0)
        with np.errstate(all="ignore"):  # 1/0 is inf, as in assertions
            if self._first is None:
                self._first = self._first_values({name: values[:1] for name, values in block.items()})
            value = tree.evaluate(self._value, block, self._first)
        return np.array(np.broadcast_to(value, count), np.float64)

    def _first_values(self, row: dict[str, np.ndarray]) -> tree.KnownValues:
        known: tree.KnownValues = {}
        for node in tree.walk(self._value):
            if isinstance(node, tree.AggregateCall) and node.kind == tree.START:
                known[node] = float(np.ravel(tree.evaluate(node.operand, row, known))[0])
        return known


class RisingEdgeDetector:
    """A detector of the rows on which a condition begins to hold, in a table that arrives in blocks."""

    def __init__(self) -> None:
        self.indices: list[int] = []  # counted from the first row
        self._count = 0
        self._held = False

    def feed(self, holds: np.ndarray) -> None:
        """Adds the next rows: `(n,)` bool, whether it holds on each."""
        before = np.concatenate([[self._held], holds])
        begins = holds & ~before[:-1]
        self.indices += (self._count + np.flatnonzero(begins)).tolist()
        self._count += len(holds)
        self._held = bool(before[-1])


def parse_condition(text: str, vocabulary: Vocabulary, label: str) -> Condition:
    """Parses a condition over the columns that a vocabulary names.

    Args:
      label: name of the text in messages: `when`, `option("mark_event")`.

    Raises:
      UnknownNameError: a column, object or function is unknown; the message lists near and valid ones.
      UsageError: the text is invalid; the message states where, what was found and what is valid.
    """
    return Condition(text, Parser(text, label, vocabulary).condition())


def named_condition(text: str) -> tuple[str, str]:
    """Splits `landed=contact/ncon > 0` into label and condition; by default the condition is its own label."""
    label, equals, condition = text.partition("=")
    name = label.strip()
    if equals and condition[:1] != "=" and name and name[-1] not in "<>!" and not set(name) & {"(", ")", *QUOTES}:
        return name, condition.strip()
    return text.strip(), text.strip()


def parse_row_expression(text: str, columns: Sequence[str] | Vocabulary, label: str) -> RowExpression:
    """Parses a number per row of a table of `columns`, or of those that a vocabulary names.

    Args:
      label: name of the text in messages: `option("y")`.

    Raises:
      UnknownNameError: a column or function is unknown; the message lists near and valid ones.
      UsageError: the text is invalid; the message states where, what was found and what is valid.
    """
    return RowExpression(text, Parser(text, label, columns).row_value())
