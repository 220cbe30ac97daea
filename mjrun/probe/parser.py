"""From the text of an assertion to its tree: tokens, precedence, and errors that point at a character."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, quoted
from mjrun.probe.expression import (
    AGGREGATES,
    ARITHMETIC,
    COMPARISON,
    CONSTANTS,
    ELEMENTWISE,
    FIXED,
    FUNCTIONS,
    KEYWORDS,
    LEVELS,
    MEANT,
    NOT,
    ROW,
    SEVERAL,
    SIGN,
    START,
    TABLE,
    Aggregate,
    Call,
    ColumnValue,
    Comparison,
    EachRow,
    Node,
    Number,
    Several,
    Truth,
    Value,
    is_mixed,
    is_row,
    negated,
)

LONGEST = 10_000  # characters of an expression
DEEPEST = 100  # expressions within expressions
SHOWN = 72  # characters of an expression that a message shows

_SPACE = re.compile(r"\s*")
_DIGITS = re.compile(r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"[^\W\d]\w*")
_NAME = re.compile(r"\w+(?:[/:.\-]\w+)*")
_GOES_ON = re.compile(r"\w|[:.]+\w")  # so a name does not end here
_OPERATOR = re.compile(r"\*\*|<=|>=|==|!=|[-+*/^<>(),]")
_QUOTED = re.compile(r"'((?:[^']|'')*)'|`((?:[^`]|``)*)`", re.DOTALL)
_BARE = re.compile(r"\w(?:[\w/:.\-]*\w)?(?: \w(?:[\w/:.\-]*\w)?)*")


def is_bare(name: str) -> bool:
    """Whether the column `name` may be written without quotes."""
    return bool(_BARE.fullmatch(name)) and not set(name.split(" ")) & {*KEYWORDS} and not _DIGITS.fullmatch(name)


def spelled(name: str) -> str:
    """The column `name` as an expression spells it: in quotes where it needs them."""
    return name if is_bare(name) else "'" + name.replace("'", "''") + "'"


@dataclass(frozen=True)
class _Token:
    kind: str  # number, column, word, operator, unknown, end
    text: str
    start: int
    end: int


class _Scanner:
    """Cuts `text` into tokens, one at a time."""

    def __init__(self, text: str, columns: Sequence[str]) -> None:
        self.text, self.columns = text, columns
        self.bare = {name for name in columns if is_bare(name)}
        self.lengths = sorted({len(name) for name in self.bare}, reverse=True)

    def token(self, position: int) -> _Token:
        """The token at or after `position`."""
        space = _SPACE.match(self.text, position)
        start = space.end() if space else position
        found = [t for t in (self._number(start), self._column(start), self._word(start)) if t]
        if found:
            return max(found, key=lambda token: token.end)  # the first of the longest
        if start == len(self.text):
            return _Token("end", "", start, start)
        if self.text[start] in "'`":
            return self._quoted(start)
        if operator := _OPERATOR.match(self.text, start):
            return _Token("operator", operator[0], start, operator.end())
        name = _NAME.match(self.text, start)
        return _Token("unknown", name[0] if name else self.text[start], start, name.end() if name else start + 1)

    def _number(self, start: int) -> _Token | None:
        digits = _DIGITS.match(self.text, start)
        return _Token("number", digits[0], start, digits.end()) if digits else None

    def _column(self, start: int) -> _Token | None:
        for length in self.lengths:
            name, end = self.text[start : start + length], start + length
            if name in self.bare and not _GOES_ON.match(self.text, end):
                called = name in FUNCTIONS and self.text[end:].lstrip().startswith("(")
                return None if called else _Token("column", name, start, end)
        return None

    def _word(self, start: int) -> _Token | None:
        """A word of the language; a longer name that begins with it is none."""
        word, name = _WORD.match(self.text, start), _NAME.match(self.text, start)
        if not word or not name:
            return None
        if word[0] in KEYWORDS:
            return _Token("operator", word[0], start, word.end())
        known = word[0] in CONSTANTS or word[0] in FUNCTIONS
        ends = word.end() == name.end() or self.text[word.end()] in "/-"
        return _Token("word", word[0], start, word.end()) if known and ends else None

    def _quoted(self, start: int) -> _Token:
        found = _QUOTED.match(self.text, start)
        if not found:
            raise fault(self.text, start, "a quote that is not closed", f"another {self.text[start]}")
        quote = self.text[start]
        name = found[0][1:-1].replace(quote * 2, quote)
        if name not in self.columns:
            raise unknown(self.text, start, "column", name, self.columns)
        return _Token("column", name, start, found.end())


# --- errors ----------------------------------------------------------------------------------------


def fault(text: str, position: int, found: str, expected: str) -> UsageError:
    """What is wrong with the expression `text`, and a line that points at it."""
    first = max(0, position - SHOWN // 2)
    before = ("…" if first else "") + clean(text[first:position])
    last = first + SHOWN
    after = clean(text[position:last]) + ("…" if last < len(text) else "")
    pointer = f"\n  {before}{after}\n  {' ' * len(before)}^" if text.strip() else ""
    return UsageError(f"--assert, character {position + 1}: found {found}, expected {expected}{pointer}")


def unknown(text: str, position: int, kind: str, name: str, valid: Sequence[str]) -> UnknownNameError:
    """The name at `position` of `text` is not among the valid ones."""
    whole = text if len(text) <= SHOWN else text[:SHOWN] + "…"
    return UnknownNameError(kind, name, valid, where=f"{quoted(whole)}, character {position + 1}")


# --- the parser ------------------------------------------------------------------------------------


class Parser:
    """Precedence climbing: an expression of a level is operands joined by operators above that level."""

    def __init__(self, text: str, columns: Sequence[str]) -> None:
        self.text, self.scanner, self.depth = text, _Scanner(text, columns), 0
        self.token, self.end = self.scanner.token(0), 0

    def whole(self) -> Truth:
        """The whole text as one truth, in which `EachRow` marks what is checked row by row."""
        node = self._expression(0)
        if self.token.kind != "end":
            raise self._unexpected("an operator or the end")
        return self._planned(self._truth(node))

    def _take(self) -> _Token:
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
        operators: list[_Token] = []
        operands = [first]
        while self.token.kind == "operator" and LEVELS.get(self.token.text) == level:
            operators.append(self._take())
            operands.append(self._expression(min(level, SIGN)))
        if level < NOT:
            truths = tuple(self._truth(node) for node in operands)
            return Several(start, self.end, operators[0].text == "and", truths)
        values = tuple(self._value(node) for node in operands)
        if level == COMPARISON:
            return self._compared(start, operators, values)
        functions = tuple(ARITHMETIC[token.text] for token in operators)
        return Call(start, self.end, self._kind(values), functions, values)

    def _operand(self, floor: int) -> Node:
        token = self.token
        match token.kind, token.text:
            case "number", _:
                return self._number(self._take())
            case "column", _:
                self._take()
                return ColumnValue(token.start, token.end, ROW, token.text)
            case "word", _:
                return self._named(self._take())
            case "operator", "(":
                return self._group()
            case "operator", ("-" | "+"):
                return self._signed(self._take())
            case "operator", "not" if floor <= NOT:
                self._take()
                return negated(self._truth(self._expression(NOT)))
            case "unknown", text if _NAME.fullmatch(text):
                raise self._unknown(token)
        raise self._unexpected("a number, a column, a function" + (", '(' or 'not'" if floor <= NOT else " or '('"))

    def _number(self, token: _Token) -> Value:
        value = float(token.text)
        if math.isinf(value):
            raise fault(self.text, token.start, f"a number beyond all floats ({token.text[:SHOWN]})", "less, or inf")
        return Number(token.start, token.end, FIXED, value)

    def _named(self, token: _Token) -> Value:
        if token.text in CONSTANTS:
            return Number(token.start, token.end, FIXED, CONSTANTS[token.text])
        if not self._is("("):
            raise self._unexpected(f"'(' after {token.text}")
        arguments: list[Value] = []
        while not arguments or self._is(","):
            self._take()
            arguments.append(self._value(self._expression(COMPARISON)))
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

    def _signed(self, sign: _Token) -> Value:
        value = self._value(self._expression(SIGN))
        function = np.negative if sign.text == "-" else np.positive
        return Call(sign.start, self.end, value.kind, (function,), (value,))

    def _call(self, name: _Token, values: list[Value]) -> Value:
        if len(values) == 1 and name.text in AGGREGATES:
            return self._aggregate(name, values[0])
        if name.text in SEVERAL:
            functions = (SEVERAL[name.text],) * (len(values) - 1)
            return Call(name.start, self.end, self._kind(values), functions, tuple(values))
        if len(values) > 1:
            raise fault(self.text, name.start, f"{name.text} of {len(values)} values", f"{name.text} of one")
        return Call(name.start, self.end, values[0].kind, (ELEMENTWISE[name.text],), tuple(values))

    def _aggregate(self, name: _Token, value: Value) -> Value:
        if value.kind == FIXED:
            raise fault(self.text, value.start, f"{name.text} of what is the same on all rows", "a column in it")
        if value.kind != ROW:
            raise fault(self.text, value.start, f"an aggregate within {name.text}", "values per row in it")
        return Aggregate(name.start, self.end, START if name.text == "first" else TABLE, name.text, value)

    def _compared(self, start: int, operators: list[_Token], values: tuple[Value, ...]) -> Truth:
        pairs = []
        for token, left, right in zip(operators, values, values[1:], strict=False):
            if self._kind([left, right]) == FIXED:
                raise fault(self.text, left.start, "a comparison of numbers only", "a column on one side")
            pairs.append(Comparison(left.start, right.end, token.text, (left, right)))
        return pairs[0] if len(pairs) == 1 else Several(start, self.end, True, tuple(pairs))

    def _kind(self, values: Sequence[Value]) -> str:
        """By what a combination of `values` is known."""
        kinds = {value.kind for value in values}
        if kinds >= {ROW, TABLE}:
            late = next(value for value in values if value.kind == TABLE)
            raise fault(
                self.text,
                late.start,
                "an aggregate next to values per row, and it is known after the last row only",
                "aggregates only, values per row only, or first(…) among them",
            )
        return next(kind for kind in (TABLE, ROW, START, FIXED) if kind in kinds)

    def _value(self, node: Node) -> Value:
        if isinstance(node, Value):
            return node
        raise fault(self.text, node.start, "a comparison", "a number")

    def _truth(self, node: Node) -> Truth:
        if isinstance(node, Truth):
            return node
        raise fault(self.text, node.start, "a number", "a comparison (< <= > >= == !=)")

    def _planned(self, truth: Truth) -> Truth:
        """`truth` with what is checked row by row marked; all aggregates are outside of the marks."""
        if not isinstance(truth, Several):
            return EachRow(truth.start, truth.end, truth) if is_row(truth) else truth
        if truth.every:
            return Several(truth.start, truth.end, True, tuple(map(self._planned, truth.parts)))
        parts = list(self._alternatives(truth))
        rows = [part for part in parts if is_row(part) and not is_mixed(part)]
        rest = [self._planned(part) for part in parts if part not in rows]
        if bool(rows) + sum(map(is_mixed, rest)) > 1:
            raise fault(
                self.text,
                truth.start,
                "an 'or' whose sides hold values per row, and an 'and' with aggregates among them",
                "two assertions, or aggregates only",
            )
        if not rows:
            return Several(truth.start, truth.end, False, tuple(rest))
        row = EachRow(rows[0].start, rows[-1].end, Several(truth.start, truth.end, False, tuple(rows)))
        return Several(truth.start, truth.end, False, (row, *rest)) if rest else row

    def _alternatives(self, truth: Truth) -> Iterator[Truth]:
        if isinstance(truth, Several) and not truth.every:
            for part in truth.parts:
                yield from self._alternatives(part)
        else:
            yield truth

    def _unknown(self, token: _Token) -> UsageError:
        called = self.text[token.end :].lstrip().startswith("(") and _WORD.fullmatch(token.text)
        kind, valid = ("function", FUNCTIONS) if called else ("column", self.scanner.columns)
        return self._unquoted() or unknown(self.text, token.start, kind, token.text, valid)

    def _unexpected(self, expected: str) -> UsageError:
        token = self.token
        meant = MEANT.get(token.text) if token.kind == "unknown" else None
        found = quoted(token.text if len(token.text) <= SHOWN else token.text[:SHOWN] + "…")
        hint = f" (did you mean {meant}?)" if meant else ""
        found = "the end" if token.kind == "end" else found + hint
        return self._unquoted() or fault(self.text, token.start, found, expected)

    def _unquoted(self) -> UsageError | None:
        """The error that a column is written here without the quotes that it needs, if so."""
        for name in self.scanner.columns:
            start = self.text.find(name, max(0, self.token.start - len(name)))
            if not is_bare(name) and 0 <= start <= self.token.start < start + len(name):
                return fault(self.text, start, f"column {quoted(name)} without quotes", clean(spelled(name)))
        return None
