"""Assertions about a table, such as `max(abs(energy/drift)) < 1e-3`: parsed whole, checked while rows stream by.

An assertion must hold on every row. A column has a value on each row; an aggregate has one value for the whole table,
the same on every row. So `abs(x) < 1` and `max(abs(x)) < 1` pass together, and differ in what a failure tells.

Grammar, from what binds loosest to what binds tightest::

    or                          row by row: `x < 1 or x > 2` holds if each row is on either side
    and
    not                         turns each comparison around: `not x < 1` is `x >= 1`, on every row
    < <= > >= == !=             chains as in mathematics, `0 < x < 1`; exact, `last(time) == 5` means this very float
    + -
    * /
    - +                         signs: `-2^2` is −4, `2^-1` is ½
    ^ **                        from the right: `2^3^2` is 2⁹; `x^2` is exactly `x*x`

Operands are numbers (`1e-3`, `.5`), `pi`, `inf`, columns, calls and parentheses.

    abs sqrt exp log sin cos tan (x)                one value per row from one per row
    min max (x, y, …)                               of several values: elementwise
    min max mean rms std sum first last count (x)   of one value: an aggregate over all rows

`std` is that of the whole population, `count` the number of rows. `first(x)` is known from the first row on, so it may
stand wherever a number may: `max(abs(x - first(x))) < 0.1`. Any other aggregate is known after the last row only: it
cannot be mixed with values per row in one comparison, nor stand inside another aggregate.

A column is called by its name. The longest known name at a place is taken: `a/b` is the column `a/b` where there is
one, and else `a` divided by `b`; `a / b` is a division always. A name with characters other than letters, digits,
`_ / : . -` and single inner spaces, or that is also a number or a keyword, is quoted, 'so' or `so`; a quote within is
doubled.

NaN: no comparison with NaN holds, not even `!=`, nor under `not`; an aggregate of values among which is a NaN is NaN.
`abs(x) < inf` therefore says that x is finite.

Sums are exact: `sum`, `mean`, `rms` and `std` are the true value rounded once. Rows are evaluated in pieces of `PIECE`
counted from the first, so a verdict does not depend on how the rows are split into blocks, to the last bit. Nothing
else is kept of them. An expression is read by this module alone and never reaches Python's own evaluation.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, quoted

LONGEST = 10_000  # characters of an expression
DEEPEST = 100  # expressions within expressions
PIECE = 512  # rows evaluated at once; sums of so many products of two 27-bit numbers fit 63 bits
SHOWN = 72  # characters of an expression that a message shows

# --- the language ----------------------------------------------------------------------------------

LEVELS = {"or": 1, "and": 2, "<": 4, "<=": 4, ">": 4, ">=": 4, "==": 4, "!=": 4}
LEVELS |= {"+": 5, "-": 5, "*": 6, "/": 6, "^": 8, "**": 8}
NOT, COMPARISON, SIGN, POWER = 3, 4, 7, 8
COMPLEMENT = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}
CONSTANTS = {"pi": math.pi, "inf": math.inf}
KEYWORDS = ("and", "or", "not")
MEANT = {"=": "==", "&": "and", "|": "or", "!": "not", "≤": "<=", "≥": ">=", "≠": "!=", "×": "*", "−": "-", '"': "'"}


def _power(base: Any, exponent: Any) -> Any:
    return np.square(base) if np.ndim(exponent) == 0 and exponent == 2 else np.power(base, exponent)


def _unequal(left: Any, right: Any) -> Any:
    return np.less(left, right) | np.greater(left, right)  # not so for NaN


Function = Callable[..., Any]
ARITHMETIC: dict[str, Function] = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
ARITHMETIC |= {"^": _power, "**": _power}
COMPARE: dict[str, Function] = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
COMPARE |= {"==": np.equal, "!=": _unequal}
ELEMENTWISE: dict[str, Function] = {"abs": np.abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log}
ELEMENTWISE |= {"sin": np.sin, "cos": np.cos, "tan": np.tan}
SEVERAL: dict[str, Function] = {"min": np.minimum, "max": np.maximum}
AGGREGATES = ("min", "max", "mean", "rms", "std", "sum", "first", "last", "count")
FUNCTIONS = (*ELEMENTWISE, *AGGREGATES)

# What an expression is known by: itself, the first row, each row, all rows.
FIXED, START, ROW, TABLE = "fixed", "start", "row", "table"


# --- what is parsed --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Value:
    """A number: `start` and `end` are where it is written."""

    start: int
    end: int
    kind: str


@dataclass(frozen=True, eq=False)
class _Number(_Value):
    value: float


@dataclass(frozen=True, eq=False)
class _Column(_Value):
    name: str


@dataclass(frozen=True, eq=False)
class _Call(_Value):
    """One function of one operand, or several that fold operands from the left."""

    functions: tuple[Function, ...]
    operands: tuple[_Value, ...]


@dataclass(frozen=True, eq=False)
class _Aggregate(_Value):
    name: str
    operand: _Value


@dataclass(frozen=True, eq=False)
class _Truth:
    """What holds or does not: a comparison, or whether all or any of its parts hold."""

    start: int
    end: int


@dataclass(frozen=True, eq=False)
class _Comparison(_Truth):
    operator: str
    sides: tuple[_Value, _Value]


@dataclass(frozen=True, eq=False)
class _Several(_Truth):
    every: bool
    parts: tuple[_Truth, ...]


@dataclass(frozen=True, eq=False)
class _EachRow(_Truth):
    """Whether `truth` holds on each row."""

    truth: _Truth


_Node = _Value | _Truth


def _inner(node: _Node) -> tuple[_Node, ...]:
    match node:
        case _Call(operands=nodes) | _Comparison(sides=nodes) | _Several(parts=nodes):
            return nodes
        case _Aggregate(operand=node) | _EachRow(truth=node):
            return (node,)
    return ()


def _walk(node: _Node) -> Iterator[_Node]:
    """`node` and all within it, what is needed before what needs it."""
    for inner in _inner(node):
        yield from _walk(inner)
    yield node


def _sides(truth: _Truth) -> list[_Value]:
    """What is compared in `truth`, apart from what the expression itself spells out."""
    pairs = [node.sides for node in _walk(truth) if isinstance(node, _Comparison)]
    return [side for pair in pairs for side in pair if side.kind != FIXED]


def _is_row(truth: _Truth) -> bool:
    return any(side.kind == ROW for side in _sides(truth))


def _is_mixed(truth: _Truth) -> bool:
    comparisons = [node for node in _walk(truth) if isinstance(node, _Comparison)]
    return len({_is_row(comparison) for comparison in comparisons}) == 2


def _negated(truth: _Truth) -> _Truth:
    match truth:
        case _Comparison(start, end, operator, sides):
            return _Comparison(start, end, COMPLEMENT[operator], sides)
        case _Several(start, end, every, parts):
            return _Several(start, end, not every, tuple(map(_negated, parts)))
    raise TypeError(truth)


# --- tokens ----------------------------------------------------------------------------------------

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


class _Parser:
    """Precedence climbing: an expression of a level is operands joined by operators above that level."""

    def __init__(self, text: str, columns: Sequence[str]) -> None:
        self.text, self.scanner, self.depth = text, _Scanner(text, columns), 0
        self.token, self.end = self.scanner.token(0), 0

    def whole(self) -> _Truth:
        """The whole text as one truth, in which `_EachRow` marks what is checked row by row."""
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

    def _expression(self, floor: int) -> _Node:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self._unexpected(f"at most {DEEPEST} expressions within each other")
        start, left = self.token.start, self._operand(floor)
        while self.token.kind == "operator" and (level := LEVELS.get(self.token.text, 0)) > floor:
            left = self._chain(start, left, level)
        self.depth -= 1
        return left

    def _chain(self, start: int, first: _Node, level: int) -> _Node:
        """Operands joined by operators of one level; `^` takes what is right of it first."""
        operators: list[_Token] = []
        operands = [first]
        while self.token.kind == "operator" and LEVELS.get(self.token.text) == level:
            operators.append(self._take())
            operands.append(self._expression(min(level, SIGN)))
        if level < NOT:
            truths = tuple(self._truth(node) for node in operands)
            return _Several(start, self.end, operators[0].text == "and", truths)
        values = tuple(self._value(node) for node in operands)
        if level == COMPARISON:
            return self._compared(start, operators, values)
        functions = tuple(ARITHMETIC[token.text] for token in operators)
        return _Call(start, self.end, self._kind(values), functions, values)

    def _operand(self, floor: int) -> _Node:
        token = self.token
        match token.kind, token.text:
            case "number", _:
                return self._number(self._take())
            case "column", _:
                self._take()
                return _Column(token.start, token.end, ROW, token.text)
            case "word", _:
                return self._named(self._take())
            case "operator", "(":
                return self._group()
            case "operator", ("-" | "+"):
                return self._signed(self._take())
            case "operator", "not" if floor <= NOT:
                self._take()
                return _negated(self._truth(self._expression(NOT)))
            case "unknown", text if _NAME.fullmatch(text):
                raise self._unknown(token)
        raise self._unexpected("a number, a column, a function" + (", '(' or 'not'" if floor <= NOT else " or '('"))

    def _number(self, token: _Token) -> _Value:
        value = float(token.text)
        if math.isinf(value):
            raise fault(self.text, token.start, f"a number beyond all floats ({token.text[:SHOWN]})", "less, or inf")
        return _Number(token.start, token.end, FIXED, value)

    def _named(self, token: _Token) -> _Value:
        if token.text in CONSTANTS:
            return _Number(token.start, token.end, FIXED, CONSTANTS[token.text])
        if not self._is("("):
            raise self._unexpected(f"'(' after {token.text}")
        arguments: list[_Value] = []
        while not arguments or self._is(","):
            self._take()
            arguments.append(self._value(self._expression(COMPARISON)))
        self._close("+ - * / ^, ',' or ')'")
        return self._call(token, arguments)

    def _group(self) -> _Node:
        self._take()
        node = self._expression(0)
        self._close("an operator or ')'")
        return node

    def _close(self, expected: str) -> None:
        if not self._is(")"):
            raise self._unexpected(expected)
        self._take()

    def _signed(self, sign: _Token) -> _Value:
        value = self._value(self._expression(SIGN))
        function = np.negative if sign.text == "-" else np.positive
        return _Call(sign.start, self.end, value.kind, (function,), (value,))

    def _call(self, name: _Token, values: list[_Value]) -> _Value:
        if len(values) == 1 and name.text in AGGREGATES:
            return self._aggregate(name, values[0])
        if name.text in SEVERAL:
            functions = (SEVERAL[name.text],) * (len(values) - 1)
            return _Call(name.start, self.end, self._kind(values), functions, tuple(values))
        if len(values) > 1:
            raise fault(self.text, name.start, f"{name.text} of {len(values)} values", f"{name.text} of one")
        return _Call(name.start, self.end, values[0].kind, (ELEMENTWISE[name.text],), tuple(values))

    def _aggregate(self, name: _Token, value: _Value) -> _Value:
        if value.kind == FIXED:
            raise fault(self.text, value.start, f"{name.text} of what is the same on all rows", "a column in it")
        if value.kind != ROW:
            raise fault(self.text, value.start, f"an aggregate within {name.text}", "values per row in it")
        return _Aggregate(name.start, self.end, START if name.text == "first" else TABLE, name.text, value)

    def _compared(self, start: int, operators: list[_Token], values: tuple[_Value, ...]) -> _Truth:
        pairs = []
        for token, left, right in zip(operators, values, values[1:], strict=False):
            if self._kind([left, right]) == FIXED:
                raise fault(self.text, left.start, "a comparison of numbers only", "a column on one side")
            pairs.append(_Comparison(left.start, right.end, token.text, (left, right)))
        return pairs[0] if len(pairs) == 1 else _Several(start, self.end, True, tuple(pairs))

    def _kind(self, values: Sequence[_Value]) -> str:
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

    def _value(self, node: _Node) -> _Value:
        if isinstance(node, _Value):
            return node
        raise fault(self.text, node.start, "a comparison", "a number")

    def _truth(self, node: _Node) -> _Truth:
        if isinstance(node, _Truth):
            return node
        raise fault(self.text, node.start, "a number", "a comparison (< <= > >= == !=)")

    def _planned(self, truth: _Truth) -> _Truth:
        """`truth` with what is checked row by row marked; all aggregates are outside of the marks."""
        if not isinstance(truth, _Several):
            return _EachRow(truth.start, truth.end, truth) if _is_row(truth) else truth
        if truth.every:
            return _Several(truth.start, truth.end, True, tuple(map(self._planned, truth.parts)))
        parts = list(self._alternatives(truth))
        rows = [part for part in parts if _is_row(part) and not _is_mixed(part)]
        rest = [self._planned(part) for part in parts if part not in rows]
        if bool(rows) + sum(map(_is_mixed, rest)) > 1:
            raise fault(
                self.text,
                truth.start,
                "an 'or' whose sides hold values per row, and an 'and' with aggregates among them",
                "two assertions, or aggregates only",
            )
        if not rows:
            return _Several(truth.start, truth.end, False, tuple(rest))
        row = _EachRow(rows[0].start, rows[-1].end, _Several(truth.start, truth.end, False, tuple(rows)))
        return _Several(truth.start, truth.end, False, (row, *rest)) if rest else row

    def _alternatives(self, truth: _Truth) -> Iterator[_Truth]:
        if isinstance(truth, _Several) and not truth.every:
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


# --- evaluation ------------------------------------------------------------------------------------

Known = dict["_Aggregate", float]


@dataclass(frozen=True)
class _Piece:
    """Some rows that follow each other: their columns, and the number of the first of them."""

    columns: dict[str, np.ndarray]
    first: int
    count: int

    def place(self, index: int) -> str:
        """Where the row at `index` is, as a message ends."""
        times = self.columns.get("time")
        return f", at row {self.first + index}" + ("" if times is None else f", time {shown(times[index])}")


def shown(value: float) -> str:
    """`value` as the shortest text that reads back as the same float."""
    return repr(float(value)).removesuffix(".0")


def _number(value: _Value, columns: dict[str, np.ndarray], known: Known) -> Any:
    match value:
        case _Number(value=number):
            return number
        case _Column(name=name):
            return columns[name]
        case _Aggregate():
            return known[value]
        case _Call(functions=functions, operands=(first, *rest)):
            result = _number(first, columns, known)
            if not rest:
                return functions[0](result)
            for function, operand in zip(functions, rest, strict=True):
                result = function(result, _number(operand, columns, known))
            return result
    raise TypeError(value)


def _on_rows(value: _Value, piece: _Piece, known: Known) -> np.ndarray:
    return np.broadcast_to(_number(value, piece.columns, known), piece.count)


def _holds(truth: _Truth, columns: dict[str, np.ndarray], known: Known) -> Any:
    """Whether `truth` holds, row by row where it has rows."""
    match truth:
        case _Comparison(operator=operator, sides=(left, right)):
            return COMPARE[operator](_number(left, columns, known), _number(right, columns, known))
        case _Several(every=every, parts=(first, *rest)):
            result = _holds(first, columns, known)
            for part in rest:
                other = _holds(part, columns, known)
                result = result & other if every else result | other
            return result
    raise TypeError(truth)


# --- what is kept of the rows ----------------------------------------------------------------------

_UNIT = 1126  # every float is a whole number of 2⁻¹¹²⁶, as its 53 bits stand below 2⁻¹⁰⁷³ at the least
_LOW = 27
_POWERS = {"count": (), "sum": (1,), "mean": (1,), "rms": (2,), "std": (1, 2)}  # of which sums are needed


def _exact(values: np.ndarray, power: int) -> int:
    """The sum of at most `PIECE` finite values, or of their squares, in units of 2⁻¹¹²⁶ or its square: exact."""
    fractions, exponents = np.frexp(values)
    mantissas = np.ldexp(fractions, 53).astype(np.int64)
    units, groups = np.unique(exponents, return_inverse=True)
    high, low = np.abs(mantissas) >> _LOW, np.abs(mantissas) & ((1 << _LOW) - 1)
    terms = {0: mantissas} if power == 1 else {0: low * low, _LOW + 1: high * low, 2 * _LOW: high * high}
    total = 0
    for shift, term in terms.items():
        sums = np.zeros(len(units), np.int64)
        np.add.at(sums, groups, term)
        total += sum(s << shift + power * (e - 53 + _UNIT) for s, e in zip(sums.tolist(), units.tolist(), strict=True))
    return total


def _ratio(numerator: int, denominator: int) -> float:
    """The float nearest to a quotient; beyond all floats it is infinite."""
    try:
        return numerator / denominator
    except OverflowError:
        return math.inf if numerator > 0 else -math.inf


def _root(numerator: int, denominator: int) -> float:
    """The float nearest to the square root of a quotient: one root with bits to spare, the last of them sticky."""
    shift = (numerator.bit_length() - denominator.bit_length() - 109) // 2
    if shift < 0:
        numerator <<= -2 * shift
    else:
        denominator <<= 2 * shift
    root = math.isqrt(numerator // denominator)
    root |= root * root * denominator != numerator
    return _ratio(root << max(shift, 0), 1 << max(-shift, 0))


class _Picked:
    """The value of one row: `find` names it in a piece, `better` says whether it replaces the one of earlier pieces."""

    def __init__(self, find: Callable[[np.ndarray], Any], better: Callable[[float, float], bool]) -> None:
        self._find, self._better, self._value, self.place = find, better, None, ""

    def add(self, values: np.ndarray, piece: _Piece) -> None:
        """Takes one piece."""
        index = int(self._find(values))
        value = float(values[index])
        if self._value is None or self._better(value, self._value):
            self._value, self.place = value, piece.place(index)

    @property
    def value(self) -> float:
        """What was found, once there was a row."""
        return math.nan if self._value is None else self._value


class _Summed:
    """Exact sums of the powers that `name` needs; `place` is the first row that is not finite, if there is one."""

    def __init__(self, name: str) -> None:
        self._name, self._count, self._totals, self.place = name, 0, {1: 0, 2: 0}, ""
        self._powers, self._infinite = _POWERS[name], {1: 0.0, 2: 0.0}

    def add(self, values: np.ndarray, piece: _Piece) -> None:
        """Takes one piece."""
        self._count += len(values)
        if not self._powers:
            return
        finite = np.isfinite(values)
        if not finite.all():
            self.place = self.place or piece.place(int(np.argmin(finite)))
            for power in (1, 2):
                self._infinite[power] += float(np.sum(values[~finite] ** power))
            values = values[finite]
        for power in self._powers:
            self._totals[power] += _exact(values, power)

    @property
    def value(self) -> float:
        """The aggregate of all rows so far."""
        n, total, squares = self._count, self._totals[1], self._totals[2]
        if self.place:
            return {"rms": self._infinite[2], "std": math.nan}.get(self._name, self._infinite[1])
        match self._name:
            case "count":
                return float(n)
            case "sum":
                return _ratio(total, 1 << _UNIT)
            case "mean":
                return _ratio(total, n << _UNIT)
            case "rms":
                return _root(squares, n << 2 * _UNIT)
        return _root(n * squares - total * total, n * n << 2 * _UNIT)


def _gatherer(name: str) -> _Picked | _Summed:
    match name:
        case "min":
            return _Picked(np.argmin, lambda new, old: old == old and not new >= old)  # the first NaN wins for good
        case "max":
            return _Picked(np.argmax, lambda new, old: old == old and not new <= old)
        case "first":
            return _Picked(lambda values: 0, lambda new, old: False)
        case "last":
            return _Picked(lambda values: len(values) - 1, lambda new, old: True)
    return _Summed(name)


class _Watch:
    """Where a truth fails first, what was compared there, and how often it fails."""

    def __init__(self, truth: _Truth) -> None:
        self.truth, self.failures, self.place = truth, 0, ""
        self.found: dict[_Value, float] = {}

    def add(self, piece: _Piece, known: Known) -> None:
        """Takes one piece."""
        holds = _holds(self.truth, piece.columns, known)
        failures = piece.count - int(np.count_nonzero(holds))
        if failures and not self.failures:
            index = int(np.argmin(holds))
            self.place = piece.place(index)
            self.found = {side: float(_on_rows(side, piece, known)[index]) for side in _sides(self.truth)}
        self.failures += failures


# --- the assertion ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Verdict:
    """Whether the assertion `text` holds, and a `message` that says with which values and where."""

    text: str
    passed: bool
    message: str


@dataclass(frozen=True, eq=False)
class Assertion:
    """An assertion that is well formed.

    Attributes:
      text: as it was written.
      columns: the names that it reads, in the order of the table.
      table: all columns of the table.
    """

    text: str
    columns: tuple[str, ...]
    table: tuple[str, ...]
    _truth: _Truth = field(repr=False)

    def checker(self) -> "Checker":
        """A new check, which has seen no row."""
        return Checker(self)


def parse(text: str, columns: Sequence[str]) -> Assertion:
    """The assertion that `text` says about a table of `columns`.

    Raises:
      UnknownNameError: a name is that of no column or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    if len(text) > LONGEST:
        raise UsageError(f"--assert: {len(text)} characters, expected at most {LONGEST}")
    truth = _Parser(text, columns).whole()
    read = {node.name for node in _walk(truth) if isinstance(node, _Column)}
    return Assertion(text, tuple(name for name in dict.fromkeys(columns) if name in read), tuple(columns), truth)


class Checker:
    """One pass of an assertion over a table. What it keeps does not grow with the rows."""

    def __init__(self, assertion: Assertion) -> None:
        self._assertion, self._truth = assertion, assertion._truth
        table = assertion.table
        self._names = [name for name in dict.fromkeys(table) if name in {*assertion.columns, "time"}]
        self._indices = [table.index(name) for name in self._names]
        self._buffer = np.empty((len(self._names), PIECE))
        self._first = self._count = self._waiting = 0  # rows evaluated and rows that wait, from the first on
        nodes = list(_walk(self._truth))
        self._gatherers = {node: _gatherer(node.name) for node in nodes if isinstance(node, _Aggregate)}
        self._watches = {node: _Watch(node.truth) for node in nodes if isinstance(node, _EachRow)}
        self._known: Known = {}  # what the first row told
        self._values: Known = {}  # what the last row told
        self._lone = len({self._written(side) for side in _sides(self._truth)}) == 1

    def feed(self, block: np.ndarray, first_row: int) -> None:
        """Takes the rows from `first_row` on: one column for each of the table's. The block may be used again.

        Raises:
          ValueError: the block has other columns, or does not follow the one before.
        """
        if block.ndim != 2 or block.shape[1] != len(self._assertion.table):
            raise ValueError(f"a block of shape {block.shape} for {len(self._assertion.table)} columns")
        seen = self._count + self._waiting
        self._first = self._first if seen else first_row
        if first_row != self._first + seen:
            raise ValueError(f"a block from row {first_row} after row {self._first + seen - 1}")
        start = 0
        while start < len(block):
            rows = block[start : start + PIECE - self._waiting, self._indices]
            self._buffer[:, self._waiting : self._waiting + len(rows)] = rows.T
            self._waiting, start = self._waiting + len(rows), start + len(rows)
            if self._waiting == PIECE:
                self._digest()

    def verdict(self) -> Verdict:
        """The outcome, after the last block. No rows at all is a failure."""
        self._digest()
        text = self._assertion.text
        if not self._count:
            return Verdict(text, False, f"{clean(text)}: there are no rows")
        with np.errstate(all="ignore"):
            self._values = {node: gatherer.value for node, gatherer in self._gatherers.items()}
            passed = self._outcome(self._truth)
            sentences = dict.fromkeys(self._sentences(self._truth, passed))
        return Verdict(text, passed, f"{clean(text)}: {'; '.join(sentences)}")

    def _digest(self) -> None:
        """Evaluates the rows that wait."""
        if not self._waiting:
            return
        columns = {name: row[: self._waiting] for name, row in zip(self._names, self._buffer, strict=True)}
        piece = _Piece(columns, self._first + self._count, self._waiting)
        self._count, self._waiting = self._count + self._waiting, 0
        with np.errstate(all="ignore"):
            for node, gatherer in self._gatherers.items():
                gatherer.add(_on_rows(node.operand, piece, self._known), piece)
                self._known[node] = gatherer.value if node.kind == START else math.nan
            for watch in self._watches.values():
                watch.add(piece, self._known)

    def _outcome(self, truth: _Truth) -> bool:
        match truth:
            case _EachRow():
                return not self._watches[truth].failures
            case _Several(every=every, parts=parts):
                return (all if every else any)(map(self._outcome, parts))
        return bool(_holds(truth, {}, self._values))

    def _sentences(self, truth: _Truth, outcome: bool) -> Iterator[str]:
        """What decided: the parts whose outcome is that of the whole."""
        match truth:
            case _Several(parts=parts):
                for part in parts:
                    if self._outcome(part) == outcome:
                        yield from self._sentences(part, outcome)
            case _EachRow() if outcome:
                rows = f"all {self._count} rows" if self._count > 1 else "the only row"
                yield f"{'it' if truth is self._truth else self._written(truth)} holds on {rows}"
            case _EachRow():
                yield self._failure(self._watches[truth])
            case _:
                yield from map(self._side, _sides(truth))

    def _failure(self, watch: _Watch) -> str:
        """The first row where a truth fails, and what is compared there."""
        sides = dict.fromkeys(self._told(side, value) for side, value in watch.found.items())
        more = f", the first of {watch.failures} such rows" if watch.failures > 1 else ""
        return ", ".join(sides) + watch.place + more

    def _side(self, side: _Value) -> str:
        """The value of one side of a comparison, and the rows that its aggregates come from."""
        sentence = self._told(side, float(_number(side, {}, self._values)))
        if isinstance(side, _Aggregate):
            return sentence + self._gatherers[side].place
        inner = [node for node in _walk(side) if isinstance(node, _Aggregate)]
        told = (f"{self._written(n)} is {shown(self._values[n])}{self._gatherers[n].place}" for n in inner)
        return f"{sentence} ({'; '.join(dict.fromkeys(told))})"

    def _told(self, side: _Value, value: float) -> str:
        subject = "it" if self._lone else self._written(side)
        return f"{subject} is {shown(value)}" + (" (no comparison with nan holds)" if math.isnan(value) else "")

    def _written(self, node: _Node) -> str:
        return clean(self._assertion.text[node.start : node.end])
