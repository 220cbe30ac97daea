"""From the text of an expression to its tree: precedence, what may stand where, and errors that say so."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from mjrun.errors import UsageError, clean, counted, quoted
from mjrun.probe.expression import (
    AGGREGATES,
    ARITHMETIC,
    COMPARISON,
    ELEMENTWISE,
    FINITE,
    FIXED,
    FOLDED,
    LEVELS,
    MEANT,
    NOT,
    OF_CONDITIONS,
    OTHERS,
    ROW,
    SIGN,
    START,
    SUCCESSIVE,
    TABLE,
    AggregateCall,
    AllRows,
    BooleanExpression,
    BooleanOperation,
    Choice,
    ColumnReference,
    ColumnVector,
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
    negated,
    sides,
    walk,
)
from mjrun.probe.scanner import SHOWN, Scanner, SourceText, Token, Vocabulary, is_bare, is_name, is_word, spelled

LONGEST = 10_000  # characters of an expression
DEEPEST = 100  # expressions within expressions


class Parser:
    """Precedence climbing: an expression of a level is operands joined by operators above that level.

    Args:
      aggregates: whether there are any; without them all values are per row.
      control_dt: the time between two rows [s], where a row may refer to the one before it as `previous` and `rate` do.
    """

    def __init__(
        self,
        source: SourceText,
        vocabulary: Vocabulary,
        aggregates: bool = True,
        control_dt: float | None = None,
    ) -> None:
        if len(source.text) > LONGEST:
            raise UsageError(f"{source.label}: {len(source.text)} characters, expected at most {LONGEST}")
        self.source, self.text, self.vocabulary, self.aggregates = source, source.text, vocabulary, aggregates
        self.control_dt = control_dt
        self.scanner, self.depth = Scanner(source, vocabulary), 0
        self.token, self.end = self.scanner.token(0), 0

    def whole(self) -> BooleanExpression:
        """The whole text as one truth, in which `AllRows` marks what is checked row by row."""
        return self._planned(self.truth())

    def truth(self) -> BooleanExpression:
        """The whole text as one truth."""
        return self._truth(self._to_end())

    def row_value(self) -> NumericExpression:
        """The whole text as one number per row."""
        value = self._scalar(self._to_end())
        for node in walk(value):
            if isinstance(node, AggregateCall) and node.kind != START:
                raise self.source.fault(node.start, f"{node.name} over all rows", "values per row, or first(…)")
        return value

    def table_value(self) -> NumericExpression:
        """The whole text as one number of the table."""
        value = self._scalar(self._to_end())
        if value.kind == ROW:
            raise self.source.fault(value.start, "values per row", f"one number, such as max({self.text.strip()})")
        if value.kind == FIXED:
            raise self.source.fault(value.start, "what no simulation changes", "a column in it")
        return value

    def _to_end(self) -> Node:
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

    def _expression(self, floor: int) -> Node:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self._unexpected(f"at most {DEEPEST} expressions within each other")
        start, left = self.token.start, self._operand(floor)
        while self.token.kind == "operator" and (level := LEVELS.get(self.token.text, 0)) > floor:
            left = self._chain(start, left, level)
        self.depth -= 1
        return left

    def _chain(self, start: int, first: Node, level: int) -> Node:
        """Operands joined by operators of one level; `^` takes what is right of it first."""
        operators: list[Token] = []
        operands = [first]
        while self.token.kind == "operator" and LEVELS.get(self.token.text) == level:
            operators.append(self._take())
            operands.append(self._expression(min(level, SIGN)))
        if level < NOT:
            truths = tuple(self._truth(node) for node in operands)
            return BooleanOperation(start, self.end, operators[0].text == "and", truths)
        if level == COMPARISON:
            return self._compared(start, operators, tuple(self._scalar(node) for node in operands))
        values = [self._value(node) for node in operands]
        return self._elementwise(start, [ARITHMETIC[token.text] for token in operators], values)

    def _operand(self, floor: int) -> Node:
        token = self.token
        match token.kind, token.text:
            case "number", _:
                return self._number(self._take())
            case "column", _:
                self._take()
                return ColumnReference(token.start, token.end, ROW, token.text)
            case "wildcard", _:
                self._take()
                return ColumnVector(token.start, token.end, ROW, self.vocabulary.matching(token.text))
            case "word", _:
                return self._named(self._take())
            case "operator", "(":
                return self._group()
            case "operator", ("-" | "+"):
                return self._signed(self._take())
            case "operator", "not" if floor <= NOT:
                self._take()
                return negated(self._truth(self._expression(NOT)))
            case "unknown", text if is_name(text):
                raise self._unknown(token)
        raise self._unexpected("a number, a column, a function" + (", '(' or 'not'" if floor <= NOT else " or '('"))

    def _number(self, token: Token) -> NumericExpression:
        value = float(token.text)
        if math.isinf(value):
            raise self.source.fault(token.start, f"a number beyond all floats ({token.text[:SHOWN]})", "less, or inf")
        return NumberLiteral(token.start, token.end, FIXED, value)

    def _named(self, token: Token) -> Node:
        if token.text in self.vocabulary.constants:
            return NumberLiteral(token.start, token.end, FIXED, self.vocabulary.constants[token.text])
        if not self._is("("):
            raise self._unexpected(f"'(' after {token.text}")
        arguments: list[Node] = []
        while not arguments or self._is(","):
            self._take()
            arguments.append(self._expression(0 if token.text in (*AGGREGATES, "where") else COMPARISON))
        self._close("+ - * / ^, ',' or ')'")
        return self._call(token, arguments)

    def _group(self) -> Node:
        self._take()
        node = self._expression(0)
        self._close("an operator or ')'")
        return node

    def _close(self, expected: str) -> None:
        if not self._is(")"):
            raise self._unexpected(expected)
        self._take()

    def _signed(self, sign: Token) -> NumericExpression:
        value = self._value(self._expression(SIGN))
        return self._elementwise(sign.start, [np.negative if sign.text == "-" else np.positive], [value])

    def _call(self, name: Token, arguments: list[Node]) -> Node:
        conditional = any(isinstance(argument, BooleanExpression) for argument in arguments)
        wide = any(isinstance(argument, NumericExpression) and argument.width for argument in arguments)
        several = name.text in FOLDED and not conditional and (wide or len(arguments) > 1)
        if name.text in AGGREGATES and not several:
            return self._aggregate(name, arguments)
        if name.text == "where":
            return self._choice(name, arguments)

        values = [self._value(argument) for argument in arguments]
        if name.text == "norm" or (several and wide):
            return Reduction(name.start, self.end, self._kind(values), name.text, tuple(values))
        if several:
            return self._elementwise(name.start, [FOLDED[name.text]] * (len(values) - 1), values)
        if name.text == "clip":
            self._expect(name, values, 3, "clip(x, low, high)")
            return self._elementwise(name.start, [np.maximum, np.minimum], values)

        self._expect(name, values, 1, f"{name.text} of one")
        if name.text == "isfinite":
            return self._finiteness(name, values[0])
        if name.text in SUCCESSIVE:
            return self._successive(name, values[0])
        return self._elementwise(name.start, [ELEMENTWISE[name.text]], values)

    def _expect(self, name: Token, arguments: Sequence[Node], count: int, meant: str) -> None:
        if len(arguments) != count:
            written = "one value" if len(arguments) == 1 else f"{len(arguments)} values"
            raise self.source.fault(name.start, f"{name.text} of {written}", meant)

    def _elementwise(
        self, start: int, functions: Sequence[Function], values: Sequence[NumericExpression]
    ) -> FunctionCall:
        call = FunctionCall(start, self.end, self._kind(values), tuple(functions), tuple(values))
        self._check_widths(values)
        return call

    def _check_widths(self, values: Sequence[NumericExpression]) -> None:
        """Vectors that are combined have one width."""
        vectors = [value for value in values if value.width]
        for other in vectors[1:]:
            if other.width != vectors[0].width:
                shown = f"a vector of {counted(other.width, 'number')} next to one of {vectors[0].width}"
                raise self.source.fault(other.start, shown, "vectors of the same length")

    def _choice(self, name: Token, arguments: list[Node]) -> NumericExpression:
        """`where(condition, x, y)`."""
        self._expect(name, arguments, 3, "where(condition, x, y)")
        condition, first, second = self._truth(arguments[0]), self._value(arguments[1]), self._value(arguments[2])
        self._check_widths((first, second))
        kind = self._kind([*sides(condition), first, second])
        return Choice(name.start, self.end, kind, condition, (first, second))

    def _finiteness(self, name: Token, value: NumericExpression) -> BooleanExpression:
        """`isfinite(x)`; a vector is finite if all its numbers are."""
        if value.kind == FIXED:
            raise self.source.fault(value.start, "a number only", "a column in it")
        if value.width:
            magnitude = FunctionCall(value.start, value.end, value.kind, (np.abs,), (value,))
            value = Reduction(value.start, value.end, value.kind, "max", (magnitude,))
        return Comparison(name.start, self.end, FINITE, (value, NumberLiteral(self.end, self.end, FIXED, math.inf)))

    def _successive(self, name: Token, value: NumericExpression) -> NumericExpression:
        """`previous(x)` or `rate(x)`."""
        if self.control_dt is None:
            raise self.source.fault(name.start, f"{name.text}, which only tasks have", "values of one instant")
        if value.kind != ROW:
            raise self.source.fault(value.start, f"{name.text} of what never changes", "a column in it")
        previous = PreviousValue(name.start, self.end, ROW, value)
        if name.text == "previous":
            return previous
        step = NumberLiteral(self.end, self.end, FIXED, self.control_dt)
        return FunctionCall(name.start, self.end, ROW, (np.subtract, np.divide), (value, previous, step))

    def _aggregate(self, name: Token, arguments: list[Node]) -> NumericExpression:
        """`mean(x)`, `mean(x, when)`, `quantile(x, 0.9)`, `quantile(x, 0.9, when)`, `share(when)`."""
        if not self.aggregates:
            meant = f"{name.text} of several, or of a vector" if name.text in FOLDED else "values of one instant"
            raise self.source.fault(name.start, f"{name.text} over all instants", meant)
        first, *others = arguments
        if name.text == "share":
            first = self._truth(first)
        if isinstance(first, BooleanExpression) and name.text in OF_CONDITIONS:
            first, others = NumberLiteral(first.start, first.start, ROW, 1.0), [first, *others]
        value = self._scalar(first)
        fraction = self._fraction(name, others) if name.text == "quantile" else 0.5

        condition = self._row_condition(name, others.pop(0)) if others else None
        if others:
            raise self.source.fault(others[0].start, "one value more", f"the end of {name.text}(…)")
        if value.kind == FIXED:
            raise self.source.fault(value.start, f"{name.text} of what is the same on all rows", "a column in it")
        if value.kind != ROW:
            raise self.source.fault(value.start, f"an aggregate within {name.text}", "values per row in it")

        kind = START if name.text == "first" and condition is None else TABLE
        return AggregateCall(name.start, self.end, kind, name.text, value, condition, fraction)

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
        condition = self._truth(node)
        if not is_row(condition) or is_mixed(condition):
            raise self.source.fault(node.start, f"an aggregate as the condition of {name.text}", "values per row")
        return condition

    def _compared(self, start: int, operators: list[Token], values: tuple[NumericExpression, ...]) -> BooleanExpression:
        pairs = []
        for token, left, right in zip(operators, values, values[1:], strict=False):
            if self._kind([left, right]) == FIXED:
                raise self.source.fault(left.start, "a comparison of numbers only", "a column on one side")
            pairs.append(Comparison(left.start, right.end, token.text, (left, right)))
        return pairs[0] if len(pairs) == 1 else BooleanOperation(start, self.end, True, tuple(pairs))

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

    def _value(self, node: Node) -> NumericExpression:
        if isinstance(node, NumericExpression):
            return node
        raise self.source.fault(node.start, "a comparison", "a number")

    def _scalar(self, node: Node) -> NumericExpression:
        value = self._value(node)
        if value.width:
            shown = f"a vector of {counted(value.width, 'number')}"
            raise self.source.fault(value.start, shown, "one number: norm(…), sum(…), min(…) or max(…) of it")
        return value

    def _truth(self, node: Node) -> BooleanExpression:
        if isinstance(node, BooleanExpression):
            return node
        if isinstance(node, ColumnReference) and self.vocabulary.is_count(node.name):
            return Comparison(node.start, node.end, ">", (node, NumberLiteral(node.end, node.end, FIXED, 0.0)))
        raise self.source.fault(node.start, "a number", "a comparison (< <= > >= == !=)")

    def _planned(self, truth: BooleanExpression) -> BooleanExpression:
        """`truth` with what is checked row by row marked; all aggregates are outside of the marks."""
        if not isinstance(truth, BooleanOperation):
            return AllRows(truth.start, truth.end, truth) if is_row(truth) else truth
        if truth.every:
            return BooleanOperation(truth.start, truth.end, True, tuple(map(self._planned, truth.parts)))
        parts = list(self._alternatives(truth))
        rows = [part for part in parts if is_row(part) and not is_mixed(part)]
        rest = [self._planned(part) for part in parts if part not in rows]
        if bool(rows) + sum(map(is_mixed, rest)) > 1:
            raise self.source.fault(
                truth.start,
                "an 'or' whose sides hold values per row, and an 'and' with aggregates among them",
                "two assertions, or aggregates only",
            )
        if not rows:
            return BooleanOperation(truth.start, truth.end, False, tuple(rest))
        row = AllRows(rows[0].start, rows[-1].end, BooleanOperation(truth.start, truth.end, False, tuple(rows)))
        return BooleanOperation(truth.start, truth.end, False, (row, *rest)) if rest else row

    def _alternatives(self, truth: BooleanExpression) -> Iterator[BooleanExpression]:
        if isinstance(truth, BooleanOperation) and not truth.every:
            for part in truth.parts:
                yield from self._alternatives(part)
        else:
            yield truth

    def _unknown(self, token: Token) -> UsageError:
        if self.text[token.end :].lstrip().startswith("(") and is_word(token.text):
            return self._unquoted() or self._no_function(token)
        return self._unquoted() or self.vocabulary.missing(token.text, token.start, self.source)

    def _no_function(self, name: Token) -> UsageError:
        valid = [*ELEMENTWISE, *OTHERS, *(AGGREGATES if self.aggregates else FOLDED)]
        valid += SUCCESSIVE if self.control_dt is not None else ()
        groups = sorted(self.vocabulary.groups)
        if not groups:
            return self.source.unknown(name.start, "function", name.text, valid)
        return self.source.unknown(
            name.start, "function or probe", name.text, [*valid, *groups], "functions and probes"
        )

    def _unexpected(self, expected: str) -> UsageError:
        token = self.token
        meant = MEANT.get(token.text) if token.kind == "unknown" else None
        shown = quoted(token.text if len(token.text) <= SHOWN else token.text[:SHOWN] + "…")
        hint = f" (did you mean {meant}?)" if meant else ""
        shown = "the end" if token.kind == "end" else shown + hint
        return self._unquoted() or self.source.fault(token.start, shown, expected)

    def _unquoted(self) -> UsageError | None:
        """The error that a column is written here without the quotes that it needs, if so."""
        for name in self.vocabulary.names:
            start = self.text.find(name, max(0, self.token.start - len(name)))
            if not is_bare(name) and 0 <= start <= self.token.start < start + len(name):
                return self.source.fault(start, f"the column {clean(name)} without quotes", clean(spelled(name)))
        return None
