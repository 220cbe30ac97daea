"""The nodes of an expression from their parts: what may stand where, and errors that say so."""

import math
from collections.abc import Sequence

import numpy as np

from mjrun.errors import counted
from mjrun.probe.expression import (
    AGGREGATES,
    ARITHMETIC,
    ELEMENTWISE,
    FINITE,
    FIXED,
    FOLDED,
    OF_CONDITIONS,
    ROW,
    START,
    SUCCESSIVE,
    TABLE,
    AggregateCall,
    BooleanExpression,
    BooleanOperation,
    Choice,
    ColumnReference,
    Comparison,
    Function,
    FunctionCall,
    Node,
    NumberLiteral,
    NumericExpression,
    PreviousValue,
    Reduction,
    is_mixed,
    is_row,
    sides,
)
from mjrun.probe.scanner import SourceText, Token, Vocabulary


class NodeBuilder:
    """Makes nodes, and refuses what does not go together.

    Args:
      source: of which messages show the place.

    Attributes:
      aggregates: whether there are any; without them all values are per row.
    """

    def __init__(self, source: SourceText, vocabulary: Vocabulary) -> None:
        self.source, self.vocabulary = source, vocabulary
        self.aggregates = vocabulary.control_dt is None

    def call(self, name: Token, arguments: list[Node], end: int) -> Node:
        """A call that is written up to character `end`."""
        conditional = any(isinstance(argument, BooleanExpression) for argument in arguments)
        wide = any(isinstance(argument, NumericExpression) and argument.width for argument in arguments)
        several = name.text in FOLDED and not conditional and (wide or len(arguments) > 1)
        if name.text in AGGREGATES and not several:
            return self._aggregate(name, arguments, end)
        if name.text == "where":
            return self._choice(name, arguments, end)

        values = [self.value(argument) for argument in arguments]
        if name.text == "norm" or (several and wide):
            return Reduction(name.start, end, self._kind(values), name.text, tuple(values))
        if several:
            return self.elementwise(name.start, end, [FOLDED[name.text]] * (len(values) - 1), values)
        if name.text == "clip":
            self._expect(name, values, 3, "clip(x, low, high)")
            return self.elementwise(name.start, end, [np.maximum, np.minimum], values)

        self._expect(name, values, 1, f"{name.text} of one")
        if name.text == "isfinite":
            return self._finiteness(name, values[0], end)
        if name.text in SUCCESSIVE:
            return self._successive(name, values[0], end)
        return self.elementwise(name.start, end, [ELEMENTWISE[name.text]], values)

    def elementwise(
        self, start: int, end: int, functions: Sequence[Function], values: Sequence[NumericExpression]
    ) -> FunctionCall:
        """Functions of `values`, number by number."""
        call = FunctionCall(start, end, self._kind(values), tuple(functions), tuple(values))
        self._check_widths(values)
        return call

    def compared(
        self, start: int, end: int, operators: Sequence[Token], values: Sequence[NumericExpression]
    ) -> BooleanExpression:
        """What holds if all neighbours compare as the operators between them say."""
        pairs = []
        for token, left, right in zip(operators, values, values[1:], strict=False):
            if self._kind([left, right]) == FIXED:
                raise self.source.fault(left.start, "a comparison of numbers only", "a column on one side")
            pairs.append(Comparison(left.start, right.end, token.text, (left, right)))
        return pairs[0] if len(pairs) == 1 else BooleanOperation(start, end, True, tuple(pairs))

    def value(self, node: Node) -> NumericExpression:
        """`node` as a number or a vector."""
        if isinstance(node, NumericExpression):
            return node
        raise self.source.fault(node.start, "a comparison", "a number")

    def scalar(self, node: Node) -> NumericExpression:
        """`node` as a single number."""
        value = self.value(node)
        if value.width:
            shown = f"a vector of {counted(value.width, 'number')}"
            raise self.source.fault(value.start, shown, "one number: norm(…), sum(…), min(…) or max(…) of it")
        return value

    def truth(self, node: Node) -> BooleanExpression:
        """`node` as something that holds or not."""
        if isinstance(node, BooleanExpression):
            return node
        if isinstance(node, ColumnReference) and self.vocabulary.is_count(node.name):
            return Comparison(node.start, node.end, ">", (node, NumberLiteral(node.end, node.end, FIXED, 0.0)))
        raise self.source.fault(node.start, "a number", "a comparison (< <= > >= == !=)")

    def _choice(self, name: Token, arguments: list[Node], end: int) -> NumericExpression:
        """`where(condition, x, y)`."""
        self._expect(name, arguments, 3, "where(condition, x, y)")
        condition, first, second = self.truth(arguments[0]), self.value(arguments[1]), self.value(arguments[2])
        self._check_widths((first, second))
        kind = self._kind([*sides(condition), first, second])
        return Choice(name.start, end, kind, condition, (first, second))

    def _finiteness(self, name: Token, value: NumericExpression, end: int) -> BooleanExpression:
        """`isfinite(x)`; a vector is finite if all its numbers are."""
        if value.kind == FIXED:
            raise self.source.fault(value.start, "a number only", "a column in it")
        if value.width:
            magnitude = FunctionCall(value.start, value.end, value.kind, (abs,), (value,))
            value = Reduction(value.start, value.end, value.kind, "max", (magnitude,))
        return Comparison(name.start, end, FINITE, (value, NumberLiteral(end, end, FIXED, math.inf)))

    def _successive(self, name: Token, value: NumericExpression, end: int) -> NumericExpression:
        """`previous(x)` or `rate(x)`."""
        if self.vocabulary.control_dt is None:
            raise self.source.fault(name.start, f"{name.text}, which only tasks have", "values of one instant")
        if value.kind != ROW:
            raise self.source.fault(value.start, f"{name.text} of what never changes", "a column in it")
        previous = PreviousValue(name.start, end, ROW, value)
        if name.text == "previous":
            return previous
        step = NumberLiteral(end, end, FIXED, self.vocabulary.control_dt)
        return FunctionCall(name.start, end, ROW, (ARITHMETIC["-"], ARITHMETIC["/"]), (value, previous, step))

    def _aggregate(self, name: Token, arguments: list[Node], end: int) -> NumericExpression:
        """`mean(x)`, `mean(x, when)`, `quantile(x, 0.9)`, `quantile(x, 0.9, when)`, `share(when)`."""
        if not self.aggregates:
            meant = f"{name.text} of several, or of a vector" if name.text in FOLDED else "values of one instant"
            raise self.source.fault(name.start, f"{name.text} over all instants", meant)
        first, *others = arguments
        if name.text == "share":
            first = self.truth(first)
        if isinstance(first, BooleanExpression) and name.text in OF_CONDITIONS:
            first, others = NumberLiteral(first.start, first.start, ROW, 1.0), [first, *others]
        value = self.scalar(first)
        fraction = self._fraction(name, others) if name.text == "quantile" else 0.5

        condition = self._row_condition(name, others.pop(0)) if others else None
        if others:
            raise self.source.fault(others[0].start, "one value more", f"the end of {name.text}(…)")
        if value.kind == FIXED:
            raise self.source.fault(value.start, f"{name.text} of what is the same on all rows", "a column in it")
        if value.kind != ROW:
            raise self.source.fault(value.start, f"an aggregate within {name.text}", "values per row in it")

        kind = START if name.text == "first" and condition is None else TABLE
        return AggregateCall(name.start, end, kind, name.text, value, condition, fraction)

    def _fraction(self, name: Token, arguments: list[Node]) -> float:
        """Takes the second argument of `quantile`."""
        if not arguments:
            raise self.source.fault(name.start, "quantile of one value", "quantile(x, 0.9)")
        node = arguments.pop(0)
        if not isinstance(node, NumberLiteral) or not 0 <= node.value <= 1:
            raise self.source.fault(node.start, "no fraction of the values", "a number from 0 to 1")
        return node.value

    def _row_condition(self, name: Token, node: Node) -> BooleanExpression:
        """`node` as what chooses among the rows."""
        condition = self.truth(node)
        if not is_row(condition) or is_mixed(condition):
            raise self.source.fault(node.start, f"an aggregate as the condition of {name.text}", "values per row")
        return condition

    def _expect(self, name: Token, arguments: Sequence[Node], count: int, meant: str) -> None:
        if len(arguments) != count:
            written = "one value" if len(arguments) == 1 else f"{len(arguments)} values"
            raise self.source.fault(name.start, f"{name.text} of {written}", meant)

    def _check_widths(self, values: Sequence[NumericExpression]) -> None:
        """Vectors that are combined have one width."""
        vectors = [value for value in values if value.width]
        for other in vectors[1:]:
            if other.width != vectors[0].width:
                shown = f"a vector of {counted(other.width, 'number')} next to one of {vectors[0].width}"
                raise self.source.fault(other.start, shown, "vectors of the same length")

    def _kind(self, values: Sequence[NumericExpression]) -> str:
        """By what a combination of `values` is known."""
        kinds = {value.kind for value in values}
        if kinds >= {ROW, TABLE}:
            late = next(value for value in values if value.kind == TABLE)
            raise self.source.fault(
                late.start,
                "an aggregate next to values per row, and it is known after the last row only",
                "aggregates only, values per row only, or first(…) among them",
            )
        return next(kind for kind in (TABLE, ROW, START, FIXED) if kind in kinds)
