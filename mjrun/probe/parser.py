"""Parses the text of an expression into a tree, with errors that point at the place of a fault."""

import math
import re
from collections.abc import Iterator, Sequence
from operator import neg, pos

import numpy as np

from mjrun.errors import UsageError, clean, counted, quoted, shortened
from mjrun.probe import expression as tree
from mjrun.probe.scanner import (
    QUOTES,
    SHOWN,
    Scanner,
    SourceText,
    Token,
    Vocabulary,
    is_bare,
    is_name,
    is_word,
    spelled,
)

LONGEST = 10_000  # characters of an expression
DEEPEST = 100  # expressions within expressions
_PATTERN = re.compile(r"[^\s(),'`]+/[^\s(),'`]*[*?][^\s(),'`]*")  # wildcards without quotes


class Parser:
    """A parser by precedence climbing: an expression of a level is operands joined by operators above that level.

    Args:
      label: name of the text in messages.
      vocabulary: the columns, or a vocabulary that names them.
    """

    def __init__(self, text: str, label: str, vocabulary: Vocabulary | Sequence[str]) -> None:
        if len(text) > LONGEST:
            raise UsageError(f"{label}: {len(text)} characters, expected at most {LONGEST}")
        self.text = text
        self.source = SourceText(text, label)
        self.vocabulary = vocabulary if isinstance(vocabulary, Vocabulary) else Vocabulary(vocabulary)
        self.nodes = NodeBuilder(self.source, self.vocabulary)
        self.scanner = Scanner(self.source, self.vocabulary)
        self.depth = 0
        self.token = self.scanner.token(0)
        self.end = 0

    def assertion(self) -> tree.BooleanExpression:
        """Parses the whole text as one truth of a table, in which `HoldsOnEveryRow` marks the checks row by row."""
        return self._planned(self.nodes.truth(self._to_end()))

    def condition(self) -> tree.BooleanExpression:
        """Parses the whole text as one truth per row, without aggregates."""
        self.nodes.aggregates = False
        return self.nodes.truth(self._to_end())

    def row_value(self) -> tree.NumericExpression:
        """Parses the whole text as one number per row."""
        value = self.nodes.scalar(self._to_end())
        for node in tree.walk(value):
            if isinstance(node, tree.AggregateCall) and node.kind != tree.START:
                raise self.source.fault(node.start, f"{node.name} over all rows", "values per row, or first(…)")
        return value

    def table_value(self) -> tree.NumericExpression:
        """Parses the whole text as one number of the table."""
        value = self.nodes.scalar(self._to_end())
        if value.kind == tree.ROW:
            raise self.source.fault(value.start, "values per row", f"one number, such as max({self.text.strip()})")
        if value.kind == tree.FIXED:
            raise self.source.fault(value.start, "a constant", "a column in it")
        return value

    def _to_end(self) -> tree.Node:
        node = self._expression(0)
        if self.token.kind != "end":
            raise self._unexpected("an operator or the end")
        return node

    def _take(self) -> Token:
        token, self.end = self.token, self.token.end
        self.token = self.scanner.token(self.end)
        return token

    def _is(self, *operators: str) -> bool:
        return self.token.kind == "operator" and self.token.text in operators

    def _expression(self, floor: int) -> tree.Node:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self._unexpected(f"at most {DEEPEST} expressions within each other")
        start, left = self.token.start, self._operand(floor)
        while self.token.kind == "operator" and (level := tree.LEVELS.get(self.token.text, 0)) > floor:
            left = self._chain(start, left, level)
        self.depth -= 1
        return left

    def _chain(self, start: int, first: tree.Node, level: int) -> tree.Node:
        """Parses operands joined by operators of one level; `^` groups from the right."""
        operators: list[Token] = []
        operands = [first]
        while self.token.kind == "operator" and tree.LEVELS.get(self.token.text) == level:
            operators.append(self._take())
            text = self._text(operators[-1])
            operands.append(text or self._expression(min(level, tree.SIGN)))
        if level < tree.NOT:
            truths = tuple(self.nodes.truth(node) for node in operands)
            return tree.BooleanOperation(start, self.end, operators[0].text == "and", truths)
        if level == tree.COMPARISON:
            return self.nodes.compared(start, self.end, operators, tuple(self.nodes.scalar(node) for node in operands))
        values = [self.nodes.value(node) for node in operands]
        functions = [tree.ARITHMETIC[token.text] for token in operators]
        if level == tree.LEVELS["^"]:  # an exponent that varies is treated alike for every number, including 2
            kinds = [value.kind for value in values[1:]]
            functions = [np.power if kind == tree.ROW else each for each, kind in zip(functions, kinds, strict=True)]
        return self.nodes.elementwise(start, self.end, functions, values)

    def _text(self, operator: Token) -> tree.TextLiteral | None:
        """Parses the text that follows an operator; None if no text follows."""
        start = self.token.start
        if (
            not self.vocabulary.has_texts
            or operator.text not in ("==", "!=")
            or self.text[start : start + 1] not in QUOTES
        ):
            return None
        self._take()
        return tree.TextLiteral(start, self.end, tree.FIXED, self.scanner.quoted(start)[0])

    def _operand(self, floor: int) -> tree.Node:
        token = self.token
        match token.kind, token.text:
            case "number", _:
                return self._number(self._take())
            case "column", _:
                self._take()
                return tree.ColumnReference(token.start, token.end, tree.ROW, token.text)
            case "wildcard", _:
                self._take()
                return tree.ColumnVector(token.start, token.end, tree.ROW, self.vocabulary.matching(token.text))
            case "word", _:
                return self._named(self._take())
            case "operator", "(":
                return self._group()
            case "operator", ("-" | "+"):
                return self._signed(self._take())
            case "operator", "not" if floor <= tree.NOT:
                self._take()
                return tree.negated(self.nodes.truth(self._expression(tree.NOT)))
            case "text", name:
                raise self.vocabulary.missing(name, token.start, self.source)
            case "unknown", text if is_name(text):
                raise self._unknown(token)
        others = ", '(' or 'not'" if floor <= tree.NOT else " or '('"
        raise self._unexpected(f"a number, a column, a function{others}")

    def _number(self, token: Token) -> tree.NumericExpression:
        value = float(token.text)
        if math.isinf(value):
            raise self.source.fault(
                token.start, f"a number too large for floating point ({shortened(token.text, SHOWN)})", "less, or inf"
            )
        return tree.NumberLiteral(token.start, token.end, tree.FIXED, value)

    def _named(self, token: Token) -> tree.Node:
        if token.text in self.vocabulary.constants:
            return tree.NumberLiteral(token.start, token.end, tree.FIXED, self.vocabulary.constants[token.text])
        if not self._is("("):
            raise self._unexpected(f"'(' after {token.text}")
        arguments: list[tree.Node] = []
        while not arguments or self._is(","):
            self._take()
            arguments.append(self._expression(0 if token.text in (*tree.AGGREGATES, "where") else tree.COMPARISON))
        self._close("+ - * / ^, ',' or ')'")
        return self.nodes.call(token, arguments, self.end)

    def _group(self) -> tree.Node:
        self._take()
        node = self._expression(0)
        self._close("an operator or ')'")
        return node

    def _close(self, expected: str) -> None:
        if not self._is(")"):
            raise self._unexpected(expected)
        self._take()

    def _signed(self, sign: Token) -> tree.NumericExpression:
        value = self.nodes.value(self._expression(tree.SIGN))
        function = neg if sign.text == "-" else pos
        return self.nodes.elementwise(sign.start, self.end, [function], [value])

    def _planned(self, truth: tree.BooleanExpression) -> tree.BooleanExpression:
        """Returns `truth` with the checks row by row marked; all aggregates are outside of the marks."""
        if not isinstance(truth, tree.BooleanOperation):
            return tree.HoldsOnEveryRow(truth.start, truth.end, truth) if tree.is_row(truth) else truth
        if truth.every:
            return tree.BooleanOperation(truth.start, truth.end, True, tuple(map(self._planned, truth.parts)))
        parts = list(self._alternatives(truth))
        rows = [part for part in parts if tree.is_row(part) and not tree.is_mixed(part)]
        rest = [self._planned(part) for part in parts if part not in rows]
        if bool(rows) + sum(map(tree.is_mixed, rest)) > 1:
            raise self.source.fault(
                truth.start,
                "an 'or' whose sides hold values per row, and an 'and' with aggregates among them",
                "two assertions, or aggregates only",
            )
        if not rows:
            return tree.BooleanOperation(truth.start, truth.end, False, tuple(rest))
        either = tree.BooleanOperation(truth.start, truth.end, False, tuple(rows))
        row = tree.HoldsOnEveryRow(rows[0].start, rows[-1].end, either)
        return tree.BooleanOperation(truth.start, truth.end, False, (row, *rest)) if rest else row

    def _alternatives(self, truth: tree.BooleanExpression) -> Iterator[tree.BooleanExpression]:
        if isinstance(truth, tree.BooleanOperation) and not truth.every:
            for part in truth.parts:
                yield from self._alternatives(part)
        else:
            yield truth

    def _unknown(self, token: Token) -> UsageError:
        if self.text[token.end :].lstrip().startswith("(") and is_word(token.text):
            return self._unquoted() or self._no_function(token)
        pattern = _PATTERN.match(self.text, token.start)
        if pattern and self.vocabulary.matching(pattern[0]):
            return self.source.fault(token.start, "a wildcard without quotes", clean(spelled(pattern[0])))
        return self._unquoted() or self.vocabulary.missing(token.text, token.start, self.source)

    def _no_function(self, name: Token) -> UsageError:
        valid = [*tree.ELEMENTWISE, *tree.OTHERS, *(tree.AGGREGATES if self.nodes.aggregates else tree.FOLDED)]
        valid += tree.SUCCESSIVE if self.vocabulary.control_dt is not None else ()
        groups = sorted(self.vocabulary.groups)
        if not groups:
            return self.source.unknown(name.start, "function", name.text, valid)
        return self.source.unknown(
            name.start, "function or probe", name.text, [*valid, *groups], "functions and probes"
        )

    def _unexpected(self, expected: str) -> UsageError:
        token = self.token
        meant = tree.MEANT.get(token.text) if token.kind == "unknown" else None
        shown = quoted(shortened(token.text, SHOWN))
        hint = f" (did you mean {meant}?)" if meant else self._unit_hint()
        shown = "the end" if token.kind == "end" else shown + hint
        return self._unquoted() or self.source.fault(token.start, shown, expected)

    def _unit_hint(self) -> str:
        """Returns a remark on the unit after a number, which is no part of expressions; empty for any other token."""
        factor = tree.UNITS.get(self.token.text)
        if factor is None or not self.text[: self.token.start].rstrip()[-1:].isdigit():
            return ""
        return f" (numbers have no units; write {factor})" if factor else " (numbers have no units; leave it out)"

    def _unquoted(self) -> UsageError | None:
        """Returns the error of a column that lacks its quotes here; None if there is no such column."""
        for name in self.vocabulary.names:
            start = self.text.find(name, max(0, self.token.start - len(name)))
            if not is_bare(name) and 0 <= start <= self.token.start < start + len(name):
                return self.source.fault(start, f"the column {clean(name)} without quotes", clean(spelled(name)))
        return None


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
            return tree.RowwiseReduction(name.start, end, self._kind(values), name.text, tuple(values))
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
            value = tree.RowwiseReduction(value.start, value.end, value.kind, "max", (magnitude,))
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
