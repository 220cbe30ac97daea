"""Builds the nodes of an expression from their parts, and checks which parts are valid where."""

import math
from collections.abc import Sequence

import numpy as np

from mjrun.errors import counted
from mjrun.probe import expression as tree
from mjrun.probe.scanner import SourceText, Token, Vocabulary


class NodeBuilder:
    """A builder of nodes, which refuses invalid combinations.

    Args:
      source: text whose places messages show.

    Attributes:
      aggregates: whether aggregates are valid; without them all values are per row.
    """

    def __init__(self, source: SourceText, vocabulary: Vocabulary) -> None:
        self.source, self.vocabulary = source, vocabulary
        self.aggregates = vocabulary.control_dt is None

    def call(self, name: Token, arguments: list[tree.Node], end: int) -> tree.Node:
        """Builds a call that ends at character `end`."""
        conditional = any(isinstance(argument, tree.BooleanExpression) for argument in arguments)
        wide = any(isinstance(argument, tree.NumericExpression) and argument.width for argument in arguments)
        several = name.text in tree.FOLDED and not conditional and (wide or len(arguments) > 1)
        if name.text in tree.AGGREGATES and not several:
            return self._aggregate(name, arguments, end)
        if name.text == "where":
            return self._choice(name, arguments, end)

        values = [self.value(argument) for argument in arguments]
        if name.text == "norm" or (several and wide):
            return tree.Reduction(name.start, end, self._kind(values), name.text, tuple(values))
        if several:
            return self.elementwise(name.start, end, [tree.FOLDED[name.text]] * (len(values) - 1), values)
        if name.text == "clip":
            self._expect(name, values, 3, "clip(x, low, high)")
            return self.elementwise(name.start, end, [np.maximum, np.minimum], values)

        self._expect(name, values, 1, f"{name.text} of one")
        if name.text == "isfinite":
            return self._finiteness(name, values[0], end)
        if name.text in tree.SUCCESSIVE:
            return self._successive(name, values[0], end)
        return self.elementwise(name.start, end, [tree.ELEMENTWISE[name.text]], values)

    def elementwise(
        self, start: int, end: int, functions: Sequence[tree.Function], values: Sequence[tree.NumericExpression]
    ) -> tree.FunctionCall:
        """Builds functions of `values`, number by number."""
        call = tree.FunctionCall(start, end, self._kind(values), tuple(functions), tuple(values))
        self._check_widths(values)
        return call

    def compared(
        self, start: int, end: int, operators: Sequence[Token], values: Sequence[tree.NumericExpression]
    ) -> tree.BooleanExpression:
        """Builds the condition that all operators hold between their neighbours."""
        pairs = []
        for token, left, right in zip(operators, values, values[1:], strict=False):
            if isinstance(right, tree.TextLiteral):
                if not isinstance(left, tree.ColumnReference):
                    raise self.source.fault(left.start, "what has no texts", "a column compared with a text")
                match = tree.TextMatch(left.start, right.end, tree.ROW, left.name, right.text)
                one = tree.NumberLiteral(right.start, right.end, tree.FIXED, 1.0)
                pairs.append(tree.Comparison(left.start, right.end, token.text, (match, one)))
                continue
            if self._kind([left, right]) == tree.FIXED:
                raise self.source.fault(left.start, "a comparison of numbers only", "a column on one side")
            pairs.append(tree.Comparison(left.start, right.end, token.text, (left, right)))
        return pairs[0] if len(pairs) == 1 else tree.BooleanOperation(start, end, True, tuple(pairs))

    def value(self, node: tree.Node) -> tree.NumericExpression:
        """Returns `node` as a number or a vector."""
        if isinstance(node, tree.NumericExpression):
            return node
        raise self.source.fault(node.start, "a comparison", "a number")

    def scalar(self, node: tree.Node) -> tree.NumericExpression:
        """Returns `node` as a single number."""
        value = self.value(node)
        if value.width:
            shown = f"a vector of {counted(value.width, 'number')}"
            raise self.source.fault(value.start, shown, "one number: norm(…), sum(…), min(…) or max(…) of it")
        return value

    def truth(self, node: tree.Node) -> tree.BooleanExpression:
        """Returns `node` as a condition."""
        if isinstance(node, tree.BooleanExpression):
            return node
        if isinstance(node, tree.ColumnReference) and self.vocabulary.is_count(node.name):
            none = tree.NumberLiteral(node.end, node.end, tree.FIXED, 0.0)
            return tree.Comparison(node.start, node.end, ">", (node, none))
        raise self.source.fault(node.start, "a number", "a comparison (< <= > >= == !=)")

    def _choice(self, name: Token, arguments: list[tree.Node], end: int) -> tree.NumericExpression:
        """Builds `where(condition, x, y)`."""
        self._expect(name, arguments, 3, "where(condition, x, y)")
        condition, first, second = self.truth(arguments[0]), self.value(arguments[1]), self.value(arguments[2])
        self._check_widths((first, second))
        kind = self._kind([*tree.sides(condition), first, second])
        return tree.ConditionalValue(name.start, end, kind, condition, (first, second))

    def _finiteness(self, name: Token, value: tree.NumericExpression, end: int) -> tree.BooleanExpression:
        """Builds `isfinite(x)`; a vector is finite if all its numbers are."""
        if value.kind == tree.FIXED:
            raise self.source.fault(value.start, "a number only", "a column in it")
        if value.width:
            magnitude = tree.FunctionCall(value.start, value.end, value.kind, (abs,), (value,))
            value = tree.Reduction(value.start, value.end, value.kind, "max", (magnitude,))
        infinity = tree.NumberLiteral(end, end, tree.FIXED, math.inf)
        return tree.Comparison(name.start, end, tree.FINITE, (value, infinity))

    def _successive(self, name: Token, value: tree.NumericExpression, end: int) -> tree.NumericExpression:
        """Builds `previous(x)` or `rate(x)`."""
        if self.vocabulary.control_dt is None:
            raise self.source.fault(name.start, f"{name.text}, which only tasks have", "values of one instant")
        if value.kind != tree.ROW:
            raise self.source.fault(value.start, f"{name.text} of what never changes", "a column in it")
        previous = tree.PreviousValue(name.start, end, tree.ROW, value)
        if name.text == "previous":
            return previous
        step = tree.NumberLiteral(end, end, tree.FIXED, self.vocabulary.control_dt)
        change_per_time = tree.ARITHMETIC["-"], tree.ARITHMETIC["/"]
        return tree.FunctionCall(name.start, end, tree.ROW, change_per_time, (value, previous, step))

    def _aggregate(self, name: Token, arguments: list[tree.Node], end: int) -> tree.NumericExpression:
        """Builds `mean(x)`, `mean(x, when)`, `quantile(x, 0.9)`, `quantile(x, 0.9, when)`, `share(when)`."""
        if not self.aggregates:
            meant = f"{name.text} of several, or of a vector" if name.text in tree.FOLDED else "values of one instant"
            raise self.source.fault(name.start, f"{name.text} over all instants", meant)
        first, *others = arguments
        if name.text == "share":
            first = self.truth(first)
        if isinstance(first, tree.BooleanExpression) and name.text in tree.OF_CONDITIONS:
            first, others = tree.NumberLiteral(first.start, first.start, tree.ROW, 1.0), [first, *others]
        value = self.scalar(first)
        fraction = self._fraction(name, others) if name.text == "quantile" else 0.5

        condition = self._row_condition(name, others.pop(0)) if others else None
        if others:
            raise self.source.fault(others[0].start, "one value more", f"the end of {name.text}(…)")
        if value.kind == tree.FIXED:
            raise self.source.fault(value.start, f"{name.text} of what is the same on all rows", "a column in it")
        if value.kind != tree.ROW:
            raise self.source.fault(value.start, f"an aggregate within {name.text}", "values per row in it")

        kind = tree.START if name.text == "first" and condition is None else tree.TABLE
        return tree.AggregateCall(name.start, end, kind, name.text, value, condition, fraction)

    def _fraction(self, name: Token, arguments: list[tree.Node]) -> float:
        """Removes the second argument of `quantile`, and returns its value."""
        if not arguments:
            raise self.source.fault(name.start, "quantile of one value", "quantile(x, 0.9)")
        node = arguments.pop(0)
        if not isinstance(node, tree.NumberLiteral) or not 0 <= node.value <= 1:
            raise self.source.fault(node.start, "no fraction of the values", "a number from 0 to 1")
        return node.value

    def _row_condition(self, name: Token, node: tree.Node) -> tree.BooleanExpression:
        """Returns `node` as a condition on rows."""
        condition = self.truth(node)
        if not tree.is_row(condition) or tree.is_mixed(condition):
            raise self.source.fault(node.start, f"an aggregate as the condition of {name.text}", "values per row")
        return condition

    def _expect(self, name: Token, arguments: Sequence[tree.Node], count: int, meant: str) -> None:
        if len(arguments) != count:
            written = "one value" if len(arguments) == 1 else f"{len(arguments)} values"
            raise self.source.fault(name.start, f"{name.text} of {written}", meant)

    def _check_widths(self, values: Sequence[tree.NumericExpression]) -> None:
        """Checks that combined vectors have the same width."""
        vectors = [value for value in values if value.width]
        for other in vectors[1:]:
            if other.width != vectors[0].width:
                shown = f"a vector of {counted(other.width, 'number')} next to one of {vectors[0].width}"
                raise self.source.fault(other.start, shown, "vectors of the same length")

    def _kind(self, values: Sequence[tree.NumericExpression]) -> str:
        """Returns the time at which a combination of `values` is known."""
        kinds = {value.kind for value in values}
        if kinds >= {tree.ROW, tree.TABLE}:
            late = next(value for value in values if value.kind == tree.TABLE)
            raise self.source.fault(
                late.start,
                "an aggregate next to values per row, and it is known after the last row only",
                "aggregates only, values per row only, or first(…) among them",
            )
        return next(kind for kind in (tree.TABLE, tree.ROW, tree.START, tree.FIXED) if kind in kinds)
