"""Expressions as trees, and their values on rows: see `mjrun.probe.assertion` for the language.

A tree becomes a function once, which is called on each block of rows. Aggregates may also be combined without rows:
their values are Python's numbers. Columns that are adjacent in a matrix have vectors that are parts of it; equal sums,
norms and extremes of the columns of a matrix are computed once.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import cache, cached_property, lru_cache
from operator import add, eq, ge, gt, le, lt, mul, neg, pos, sub
from typing import Any

import numpy as np

from mjrun.dataclass import dataclass

LEVELS = {"or": 1, "and": 2, "<": 4, "<=": 4, ">": 4, ">=": 4, "==": 4, "!=": 4}
LEVELS |= {"+": 5, "-": 5, "*": 6, "/": 6, "^": 8, "**": 8}
NOT, COMPARISON, SIGN = 3, 4, 7
FINITE, NOT_FINITE = "finite", "not finite"  # comparisons with infinity; the second holds for NaN
COMPLEMENT = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}
COMPLEMENT |= {FINITE: NOT_FINITE, NOT_FINITE: FINITE}
CONSTANTS = {"pi": math.pi, "inf": math.inf}
KEYWORDS = ("and", "or", "not")
MEANT = {"=": "==", "&": "and", "|": "or", "!": "not", "≤": "<=", "≥": ">=", "≠": "!=", "×": "*", "−": "-"}
# What replaces a unit after a number.
UNITS = {"deg": "* pi/180", "mm": "* 0.001", "cm": "* 0.01", "ms": "* 0.001", "rad": "", "m": "", "s": ""}
REMEMBERED = 1024  # expressions


def _quotient(dividend: Any, divisor: Any) -> Any:
    try:
        return dividend / divisor
    except ZeroDivisionError:  # of Python's own numbers
        return np.divide(dividend, divisor)


def _power(base: Any, exponent: Any) -> Any:
    is_number = isinstance(exponent, float) or np.ndim(exponent) == 0
    return base * base if is_number and exponent == 2 else np.power(base, exponent)


def _norm(vector: np.ndarray, axis: int) -> np.ndarray:
    return np.sqrt(np.add.reduce(vector * vector, axis=axis))


Function = Callable[..., Any]
# Python's operators are NumPy's for arrays, and far faster for single numbers, with the same bits.
ARITHMETIC: dict[str, Function] = {"+": add, "-": sub, "*": mul, "/": _quotient}
ARITHMETIC |= {"^": _power, "**": _power}
COMPARE: dict[str, Function] = {"<": lt, "<=": le, ">": gt, ">=": ge}
COMPARE |= {"==": eq, "!=": lambda left, right: (left < right) | (left > right)}  # false for NaN
COMPARE |= {FINITE: lambda value, limit: np.isfinite(value), NOT_FINITE: lambda value, limit: ~np.isfinite(value)}
ELEMENTWISE: dict[str, Function] = {"abs": abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log}
ELEMENTWISE |= {"sin": np.sin, "cos": np.cos, "tan": np.tan, "tanh": np.tanh}
FOLDED: dict[str, np.ufunc] = {"min": np.minimum, "max": np.maximum, "sum": np.add}
REDUCED: dict[str, Function] = {name: function.reduce for name, function in FOLDED.items()} | {"norm": _norm}
OTHERS = ("norm", "clip", "where", "isfinite")  # functions of values at one instant that are neither of the above
SUCCESSIVE = ("previous", "rate")  # functions of values at control instants that follow each other
AGGREGATES = ("min", "max", "mean", "rms", "std", "sum", "first", "last", "count", "share", "median", "quantile")
OF_CONDITIONS = ("count", "share")  # which need no value but the condition
MEANINGS = {
    "abs sqrt exp log sin cos tan tanh (x)": "one value per row from one per row",
    "min max sum norm (x, y, …)": "of several values, row by row; norm is √(x² + y² + …)",
    "clip (x, low, high)": "x, but at least low and at most high",
    "where (condition, x, y)": "x on rows where the condition holds, else y",
    "isfinite (x)": "a condition: x is neither infinite nor NaN",
    "min max mean rms std sum first last count median (x)": "over all rows",
    "quantile (x, fraction)": "the value below which a fraction of all rows lies",
    "mean (x, condition), …": "any aggregate over the rows on which a condition holds",
    "count share (condition)": "the number and the share of rows on which a condition holds",
    "previous (x)": "only in tasks: the value at the control instant before; at the first of an episode, x itself",
    "rate (x)": "only in tasks: (x − previous(x)) / control_dt",
}
FUNCTIONS = (*ELEMENTWISE, *OTHERS, *AGGREGATES)

# Times at which the value of an expression is known: at once, from the first row on, on each row, after all rows.
FIXED, START, ROW, TABLE = "fixed", "start", "row", "table"

# Functions whose value has the unit of their operands.
KEEPING_UNITS = {ARITHMETIC["+"], ARITHMETIC["-"], abs, neg, pos, *FOLDED.values()}
ANY_UNIT = None  # of a number in the text, which takes the unit of what it is added to or compared with


# --- what is parsed --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class NumericExpression:
    """An expression whose value is a number, or a vector, written from character `start` to `end`."""

    start: int
    end: int
    kind: str

    @property
    def width(self) -> int:
        """The length of a vector; 0 for a single number."""
        return 0


@dataclass(frozen=True, eq=False)
class NumberLiteral(NumericExpression):
    """A number in the text."""

    value: float


@dataclass(frozen=True, eq=False)
class ColumnReference(NumericExpression):
    """The column `name` of the table."""

    name: str


@dataclass(frozen=True, eq=False)
class TextLiteral(NumericExpression):
    """A text in quotes, with which a column is compared."""

    text: str


@dataclass(frozen=True, eq=False)
class TextMatch(NumericExpression):
    """One where the column `name` has this text, zero where it has another, NaN where it has none."""

    name: str
    text: str


@dataclass(frozen=True, eq=False)
class ColumnVector(NumericExpression):
    """The columns `names` of the table, side by side."""

    names: tuple[str, ...]

    @property
    def width(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class FunctionCall(NumericExpression):
    """One function of one operand, or several functions that fold operands from the left; elementwise."""

    functions: tuple[Function, ...]
    operands: tuple[NumericExpression, ...]

    @property
    def width(self) -> int:
        return max(operand.width for operand in self.operands)


@dataclass(frozen=True, eq=False)
class RowwiseReduction(NumericExpression):
    """A number computed from all numbers of the operands, such as their norm."""

    name: str
    operands: tuple[NumericExpression, ...]


@dataclass(frozen=True, eq=False)
class ConditionalValue(NumericExpression):
    """A choice: the first operand where the condition holds, else the second."""

    condition: "BooleanExpression"
    operands: tuple[NumericExpression, NumericExpression]

    @property
    def width(self) -> int:
        return max(operand.width for operand in self.operands)


@dataclass(frozen=True, eq=False)
class PreviousValue(NumericExpression):
    """The value of the operand at the control instant before."""

    operand: NumericExpression

    @property
    def width(self) -> int:
        return self.operand.width


@dataclass(frozen=True, eq=False)
class AggregateCall(NumericExpression):
    """A function of the operand on all rows, such as `mean`.

    Attributes:
      condition: condition on the rows that count; None for all.
      fraction: fraction of the values below a quantile.
    """

    name: str
    operand: NumericExpression
    condition: "BooleanExpression | None" = None
    fraction: float = 0.5


@dataclass(frozen=True, eq=False)
class BooleanExpression:
    """An expression that is true or false."""

    start: int
    end: int


@dataclass(frozen=True, eq=False)
class Comparison(BooleanExpression):
    """Two sides and the operator between them."""

    operator: str
    sides: tuple[NumericExpression, NumericExpression]


@dataclass(frozen=True, eq=False)
class BooleanOperation(BooleanExpression):
    """`and`, where `every` part must hold, or `or`."""

    every: bool
    parts: tuple[BooleanExpression, ...]


@dataclass(frozen=True, eq=False)
class HoldsOnEveryRow(BooleanExpression):
    """A check that `truth` holds on each row."""

    truth: BooleanExpression


Node = NumericExpression | BooleanExpression


def parts(node: Node) -> tuple[Node, ...]:
    """Returns the operands and conditions of `node`."""
    match node:
        case FunctionCall(operands=nodes) | RowwiseReduction(operands=nodes) | Comparison(sides=nodes):
            return nodes
        case BooleanOperation(parts=nodes):
            return nodes
        case ConditionalValue(condition=condition, operands=nodes):
            return (condition, *nodes)
        case PreviousValue(operand=node):
            return (node,)
        case AggregateCall(operand=node, condition=condition):
            return (node,) if condition is None else (node, condition)
        case HoldsOnEveryRow(truth=node):
            return (node,)
    return ()


def walk(node: Node) -> Iterator[Node]:
    """Yields `node` and all nodes in it, operands first."""
    for part in parts(node):
        yield from walk(part)
    yield node


def meaning(value: Any) -> Any:
    """Returns a key of an expression, or of a part of one: the same wherever equal ones are written."""
    match value:
        case NumericExpression() | BooleanExpression():
            parts = (part for name, part in vars(value).items() if name not in ("start", "end"))
            return type(value), *map(meaning, parts)
        case tuple():
            return tuple(map(meaning, value))
        case float():
            return value.hex()  # 0 and −0 differ
    return value


def columns_read(node: Node) -> tuple[str, ...]:
    """Returns the names of the columns that `node` reads, in the order of their first occurrence."""
    names: dict[str, None] = {}
    for part in walk(node):
        if isinstance(part, ColumnReference):
            names[part.name] = None
        elif isinstance(part, ColumnVector):
            names |= dict.fromkeys(part.names)
    return tuple(names)


@dataclass(frozen=True, eq=False)
class ParsedExpression:
    """A valid expression.

    Attributes:
      text: text as written.
      root: root of its
    """

    text: str
    root: Any = field(repr=False)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns that it reads, in the order of their first occurrence."""
        return columns_read(self.root)

    @cached_property
    def aggregates(self) -> tuple["AggregateCall", ...]:
        """The aggregates in it, operands first."""
        return tuple(node for node in walk(self.root) if isinstance(node, AggregateCall))


def comparisons(truth: BooleanExpression) -> Iterator[Comparison]:
    """Yields the comparisons in `truth`, except the conditions of aggregates."""
    if isinstance(truth, Comparison):
        yield truth
    for part in parts(truth) if isinstance(truth, BooleanOperation | HoldsOnEveryRow) else ():
        if isinstance(part, BooleanExpression):
            yield from comparisons(part)


def sides(truth: BooleanExpression) -> list[NumericExpression]:
    """Returns the sides of the comparisons in `truth`, except constants."""
    return [side for comparison in comparisons(truth) for side in comparison.sides if side.kind != FIXED]


def is_row(truth: BooleanExpression) -> bool:
    """Returns whether `truth` compares values per row."""
    return any(side.kind == ROW for side in sides(truth))


def is_mixed(truth: BooleanExpression) -> bool:
    """Returns whether some of its comparisons use values per row, and others aggregates."""
    return len({is_row(comparison) for comparison in comparisons(truth)}) == 2


def negated(truth: BooleanExpression) -> BooleanExpression:
    """Returns the negation of `truth`."""
    match truth:
        case Comparison(start, end, operator, sides):
            return Comparison(start, end, COMPLEMENT[operator], sides)
        case BooleanOperation(start, end, every, parts):
            return BooleanOperation(start, end, not every, tuple(map(negated, parts)))
    raise TypeError(truth)


def expression_unit(root: NumericExpression, units: Mapping[str, str]) -> str:
    """Returns the unit of an expression; empty where it is a pure number, mixed or changed by a factor.

    Args:
      units: the units of columns, by name.
    """
    return _unit(root, units) or ""


def _unit(node: Node, units: Mapping[str, str]) -> str | None:
    match node:
        case NumberLiteral():
            return ANY_UNIT
        case ColumnReference(name=name):
            return units.get(name, "")
        case ColumnVector(names=names):
            return _common([units.get(name, "") for name in names])
        case FunctionCall(functions=functions, operands=operands) if KEEPING_UNITS.issuperset(functions):
            return _common([_unit(operand, units) for operand in operands])
        case RowwiseReduction(operands=operands) | ConditionalValue(operands=operands):
            return _common([_unit(operand, units) for operand in operands])
        case AggregateCall(name=name, operand=operand):
            return "" if name in OF_CONDITIONS else _unit(operand, units)
        case PreviousValue(operand=operand):
            return _unit(operand, units)
        case _:
            return ""


def _common(units: Sequence[str | None]) -> str | None:
    """Returns the unit that all have, empty if they differ."""
    different = {unit for unit in units if unit is not ANY_UNIT}
    if len(different) > 1:
        return ""
    return different.pop() if different else ANY_UNIT


class ColumnLayout:
    """The places of columns in a matrix.

    Attributes:
      places: indices of the columns, by name.
      run: returns the slice of adjacent columns, given their names; None if they are not adjacent.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.places = {name: place for place, name in enumerate(names)}
        self.run = cache(self._run)

    def _run(self, names: tuple[str, ...]) -> slice | None:
        places = [self.places.get(name, -1) for name in names]
        run = slice(places[0], places[0] + len(names))
        return run if places == list(range(run.start, run.stop)) and run.start >= 0 else None


class ColumnMatrix(Mapping[str, Any]):
    """Columns of n rows, each `(n,)`, contiguous; and vectors of them.

    Args:
      layout: places of the columns in the matrix.
      matrix: `(n, columns)`.
      others: columns outside the matrix.

    Attributes:
      reduced: the values of reductions that have been computed, by their identity.
    """

    def __init__(self, layout: ColumnLayout, matrix: np.ndarray, others: Mapping[str, Any]) -> None:
        self._layout = layout
        self._matrix = matrix
        self._others = others
        self._columns = dict[str, Any](others)
        self.reduced = dict[object, Any]()

    def __getitem__(self, name: str) -> Any:
        column = self._columns.get(name)
        if column is None:
            column = self._columns[name] = np.ascontiguousarray(self._matrix[:, self._layout.places[name]])
        return column

    def __iter__(self) -> Iterator[str]:
        yield from self._layout.places
        yield from self._others

    def __len__(self) -> int:
        return len(self._layout.places) + len(self._others)

    def vector(self, names: tuple[str, ...]) -> np.ndarray:
        """Returns the columns `names` side by side, `(n, len(names))`; of adjacent columns a view of the matrix."""
        run = self._layout.run(names)
        if run is None:
            return np.stack([self[name] for name in names], axis=-1)
        return self._matrix[:, run]


Columns = Mapping[str, np.ndarray]
KnownValues = dict[NumericExpression, Any]  # values of aggregates, previous values and matches, by node
Evaluation = Callable[[Columns, KnownValues], Any]


def evaluate(value: NumericExpression, columns: Columns, known: KnownValues) -> Any:
    """Returns the value on each row of `columns`, or one for all; `known` has the values that other rows determine.

    Returns:
      A number, or one for each of n rows, `(n,)`; of a vector `(n, width)` in C order.
    """
    return evaluation(value)(columns, known)


def evaluate_truth(truth: BooleanExpression, columns: Columns, known: KnownValues) -> Any:
    """Returns whether `truth` holds, row by row if it has rows."""
    return truth_evaluation(truth)(columns, known)


@lru_cache(REMEMBERED)
def evaluation(value: NumericExpression) -> Evaluation:
    """Returns `evaluate` of one expression."""
    match value:
        case NumberLiteral(value=number):
            return lambda columns, known: number
        case ColumnReference(name=name):
            return lambda columns, known: columns[name]
        case ColumnVector(names=names):
            return lambda columns, known: _vector(columns, names)
        case AggregateCall() | PreviousValue() | TextMatch():
            return lambda columns, known: known[value]
        case FunctionCall():
            return _call(value)
        case RowwiseReduction():
            return _reduction(value)
        case ConditionalValue(condition=condition, operands=operands):
            return _choice(truth_evaluation(condition), *_aligned(operands), is_vector=value.width > 0)
    raise TypeError(value)


@lru_cache(REMEMBERED)
def truth_evaluation(truth: BooleanExpression) -> Evaluation:
    """Returns `evaluate_truth` of one condition."""
    match truth:
        case Comparison(operator=operator, sides=sides):
            compare = COMPARE[operator]
            left, right = map(evaluation, sides)
            return lambda columns, known: compare(left(columns, known), right(columns, known))
        case BooleanOperation(every=every, parts=parts):
            first, *rest = map(truth_evaluation, parts)

            def operation(columns: Columns, known: KnownValues) -> Any:
                result = first(columns, known)
                for part in rest:
                    other = part(columns, known)
                    result = result & other if every else result | other
                return result

            return operation
    raise TypeError(truth)


@lru_cache(REMEMBERED)
def _identity(meaning: tuple[Any, ...]) -> object:
    """Returns an object for all expressions with a meaning, whose hash takes no time."""
    return object()


def _reduction(value: RowwiseReduction) -> Evaluation:
    """Evaluates a reduction; that of a matrix once, however many expressions contain it."""
    function, numbers = REDUCED[value.name], _side_by_side(value.operands)
    depends_on_known = any(isinstance(node, AggregateCall | PreviousValue | TextMatch) for node in walk(value))
    identity = None if depends_on_known else _identity(meaning(value))

    def reduced(columns: Columns, known: KnownValues) -> Any:
        if identity is None or not isinstance(columns, ColumnMatrix):
            return function(numbers(columns, known), axis=-1)
        values = columns.reduced.get(identity)
        if values is None:
            values = columns.reduced[identity] = function(numbers(columns, known), axis=-1)
        return values

    return reduced


def _choice(holds: Evaluation, first: Evaluation, second: Evaluation, is_vector: bool) -> Evaluation:
    condition = _beside_vector(holds) if is_vector else holds
    return lambda columns, known: np.where(condition(columns, known), first(columns, known), second(columns, known))


def _call(call: FunctionCall) -> Evaluation:
    first, *rest = _aligned(call.operands)
    if not rest:
        (function,) = call.functions
        return lambda columns, known: function(first(columns, known))
    steps = list(zip(call.functions, rest, strict=True))

    def folded(columns: Columns, known: KnownValues) -> Any:
        result = first(columns, known)
        for function, operand in steps:
            result = function(result, operand(columns, known))
        return result

    return folded


def _vector(columns: Columns, names: tuple[str, ...]) -> np.ndarray:
    if isinstance(columns, ColumnMatrix):
        return columns.vector(names)
    return np.stack([columns[name] for name in names], axis=-1)


def _aligned(operands: Sequence[NumericExpression]) -> list[Evaluation]:
    """Returns the evaluations of `operands`; if one is a vector, numpy combines all of them row by row."""
    if not any(operand.width for operand in operands):
        return list(map(evaluation, operands))
    return [evaluation(each) if each.width else _beside_vector(evaluation(each)) for each in operands]


def _beside_vector(values_of: Evaluation) -> Evaluation:
    """Turns one value per row into a vector of one."""

    def beside(columns: Columns, known: KnownValues) -> Any:
        values = values_of(columns, known)
        return values[..., None] if isinstance(values, np.ndarray) and values.ndim else values

    return beside


def _side_by_side(operands: Sequence[NumericExpression]) -> Evaluation:
    """Returns all numbers of `operands` on each row: `(n, k)` in C order, so that sums do not depend on n."""
    evaluations = list(map(evaluation, operands))
    if len(operands) == 1 and operands[0].width:
        (only,) = evaluations
        return lambda columns, known: np.ascontiguousarray(only(columns, known))
    widths = [operand.width for operand in operands]
    ends = np.cumsum([max(width, 1) for width in widths]).tolist()
    places = [end - 1 if not width else slice(end - width, end) for end, width in zip(ends, widths, strict=True)]

    several = [width > 0 for width in widths]

    def side_by_side(columns: Columns, known: KnownValues) -> np.ndarray:
        values = [each(columns, known) for each in evaluations]
        rows = ()
        for value, is_vector in zip(values, several, strict=True):
            if isinstance(value, np.ndarray) and value.ndim > is_vector:
                rows = value.shape[:1]
                break
        numbers = np.empty((*rows, ends[-1]))
        for place, value in zip(places, values, strict=True):
            numbers[..., place] = value
        return numbers

    return side_by_side
