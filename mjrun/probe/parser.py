"""Parses the text of an expression into a tree, with errors that point at the place of a fault."""

import math
from collections.abc import Iterator, Sequence
from operator import neg, pos

import numpy as np

from mjrun.errors import UsageError, clean, quoted
from mjrun.probe import expression as tree
from mjrun.probe.node_builder import NodeBuilder
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
        """Parses the whole text as one truth of a table, in which `AllRows` marks the checks row by row."""
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
                token.start, f"a number too large for floating point ({token.text[:SHOWN]})", "less, or inf"
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
            return tree.AllRows(truth.start, truth.end, truth) if tree.is_row(truth) else truth
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
        row = tree.AllRows(rows[0].start, rows[-1].end, either)
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
        shown = quoted(token.text if len(token.text) <= SHOWN else token.text[:SHOWN] + "…")
        hint = f" (did you mean {meant}?)" if meant else ""
        shown = "the end" if token.kind == "end" else shown + hint
        return self._unquoted() or self.source.fault(token.start, shown, expected)

    def _unquoted(self) -> UsageError | None:
        """Returns the error of a column that lacks its quotes here; None if there is no such column."""
        for name in self.vocabulary.names:
            start = self.text.find(name, max(0, self.token.start - len(name)))
            if not is_bare(name) and 0 <= start <= self.token.start < start + len(name):
                return self.source.fault(start, f"the column {clean(name)} without quotes", clean(spelled(name)))
        return None
