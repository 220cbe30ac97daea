"""The tree of an assertion, and its value on rows: see `mjrun.probe.assertion` for the language."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

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
class Value:
    """A number: `start` and `end` are where it is written."""

    start: int
    end: int
    kind: str


@dataclass(frozen=True, eq=False)
class Number(Value):
    value: float


@dataclass(frozen=True, eq=False)
class ColumnValue(Value):
    name: str


@dataclass(frozen=True, eq=False)
class Call(Value):
    """One function of one operand, or several that fold operands from the left."""

    functions: tuple[Function, ...]
    operands: tuple[Value, ...]


@dataclass(frozen=True, eq=False)
class Aggregate(Value):
    name: str
    operand: Value


@dataclass(frozen=True, eq=False)
class Truth:
    """What holds or does not: a comparison, or whether all or any of its parts hold."""

    start: int
    end: int


@dataclass(frozen=True, eq=False)
class Comparison(Truth):
    operator: str
    sides: tuple[Value, Value]


@dataclass(frozen=True, eq=False)
class Several(Truth):
    every: bool
    parts: tuple[Truth, ...]


@dataclass(frozen=True, eq=False)
class EachRow(Truth):
    """Whether `truth` holds on each row."""

    truth: Truth


Node = Value | Truth


def parts(node: Node) -> tuple[Node, ...]:
    match node:
        case Call(operands=nodes) | Comparison(sides=nodes) | Several(parts=nodes):
            return nodes
        case Aggregate(operand=node) | EachRow(truth=node):
            return (node,)
    return ()


def walk(node: Node) -> Iterator[Node]:
    """`node` and all within it, what is needed before what needs it."""
    for part in parts(node):
        yield from walk(part)
    yield node


def sides(truth: Truth) -> list[Value]:
    """What is compared in `truth`, apart from what the expression itself spells out."""
    pairs = [node.sides for node in walk(truth) if isinstance(node, Comparison)]
    return [side for pair in pairs for side in pair if side.kind != FIXED]


def is_row(truth: Truth) -> bool:
    return any(side.kind == ROW for side in sides(truth))


def is_mixed(truth: Truth) -> bool:
    comparisons = [node for node in walk(truth) if isinstance(node, Comparison)]
    return len({is_row(comparison) for comparison in comparisons}) == 2


def negated(truth: Truth) -> Truth:
    match truth:
        case Comparison(start, end, operator, sides):
            return Comparison(start, end, COMPLEMENT[operator], sides)
        case Several(start, end, every, parts):
            return Several(start, end, not every, tuple(map(negated, parts)))
    raise TypeError(truth)


# --- evaluation ------------------------------------------------------------------------------------

Known = dict["Aggregate", float]


def number_of(value: Value, columns: dict[str, np.ndarray], known: Known) -> Any:
    match value:
        case Number(value=number):
            return number
        case ColumnValue(name=name):
            return columns[name]
        case Aggregate():
            return known[value]
        case Call(functions=functions, operands=(first, *rest)):
            result = number_of(first, columns, known)
            if not rest:
                return functions[0](result)
            for function, operand in zip(functions, rest, strict=True):
                result = function(result, number_of(operand, columns, known))
            return result
    raise TypeError(value)


def holds_on(truth: Truth, columns: dict[str, np.ndarray], known: Known) -> Any:
    """Whether `truth` holds, row by row where it has rows."""
    match truth:
        case Comparison(operator=operator, sides=(left, right)):
            return COMPARE[operator](number_of(left, columns, known), number_of(right, columns, known))
        case Several(every=every, parts=(first, *rest)):
            result = holds_on(first, columns, known)
            for part in rest:
                other = holds_on(part, columns, known)
                result = result & other if every else result | other
            return result
    raise TypeError(truth)
