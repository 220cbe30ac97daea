"""An independent reading of expressions, for tests: as tuples, by definition and with exact fractions."""

import math
import random
import statistics
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import strategies as st

from mjrun.probe.assertion import Verdict, parse
from mjrun.probe.scanner import spelled

NAN, INF = math.nan, math.inf


def judged(text: str, columns: list[str], table: Any, cuts: list[int] | None = None, first: int = 0) -> Verdict:
    """The verdict on `table`, fed in blocks that end at `cuts`; each block is spoiled after it is fed."""
    data = np.asarray(table, float).reshape(-1, len(columns))
    checker = parse(text, columns).checker()
    edges: list[int] = sorted({0, *(cuts or []), len(data)})
    for start, end in pairwise(edges):
        block = data[start:end].copy()
        checker.feed(block, first + start)
        block[:] = -7e77
    return checker.verdict()


VALUES = st.sampled_from([0.0, 1.0, -1.0, 2.0, 0.1, -3.5, 1e-9, 7e5, 1e16, 3.0, 0.5]) | st.floats(-1e3, 1e3).map(
    lambda x: x + 0.0
)
ODD = st.sampled_from([NAN, INF, -INF, 1e308, -1e308, 5e-324])
COLUMNS = ["time", "x", "a/b", "left foot"]
UNARY = {"abs": np.abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos, "tan": np.tan}
BINARY = {"+": (5, np.add), "-": (5, np.subtract), "*": (6, np.multiply), "/": (6, np.divide)}
RELATIONS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal}
RELATIONS["!="] = np.not_equal


def trees(leaves: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Numbers made of `leaves`, as tuples."""
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(st.sampled_from([*UNARY, "neg"]), inner),
            st.tuples(st.sampled_from([*BINARY]), inner, inner),
            st.tuples(
                st.just("^"), inner, st.sampled_from([("number", 2.0), ("number", 3.0), ("neg", ("number", 1.0))])
            ),
            st.tuples(st.sampled_from(["min", "max"]), inner, inner),
        ),
        max_leaves=5,
    )


NUMBERS = st.tuples(st.just("number"), st.sampled_from([0.0, 1.0, 2.0, 0.1, 1e-3, 7.0, INF, math.pi]))
COLUMN = st.tuples(st.just("column"), st.integers(0, len(COLUMNS) - 1))
FIRST = st.tuples(st.just("aggregate"), st.just("first"), COLUMN)
PER_ROW = st.tuples(st.just("+"), trees(COLUMN | NUMBERS | FIRST), COLUMN)
AGGREGATE = st.tuples(
    st.just("aggregate"),
    st.sampled_from(["min", "max", "mean", "rms", "std", "sum", "first", "last", "count"]),
    COLUMN | PER_ROW,
)
OF_TABLE = st.one_of(AGGREGATE, st.tuples(st.sampled_from([*BINARY]), AGGREGATE, trees(AGGREGATE | NUMBERS)))


def truths(numbers: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Truths about `numbers`, as tuples."""
    compared = st.tuples(st.just("compare"), st.sampled_from([*RELATIONS]), numbers, numbers | NUMBERS)
    return st.recursive(
        compared,
        lambda inner: st.tuples(st.just("not"), inner) | st.tuples(st.sampled_from(["and", "or"]), inner, inner),
        max_leaves=4,
    )


TRUTHS = st.one_of(
    truths(PER_ROW | COLUMN),
    truths(OF_TABLE),
    st.tuples(st.just("and"), truths(PER_ROW), truths(OF_TABLE)),
    st.tuples(st.just("or"), truths(OF_TABLE), truths(COLUMN)),
)
PRECEDENCE = {"or": 1, "and": 2, "not": 3, "compare": 4, "+": 5, "-": 5, "*": 6, "/": 6, "neg": 7, "^": 8}


def written(tree: Any, floor: int, dice: random.Random) -> str:
    """`tree` as text, with the parentheses it needs and some that it does not."""
    kind, *rest = tree
    level = PRECEDENCE.get(kind, 9)
    match kind:
        case "number":
            text = {INF: "inf", math.pi: "pi"}.get(rest[0], repr(rest[0]))
        case "column":
            text = dice.choice([spelled(COLUMNS[rest[0]]), f"`{COLUMNS[rest[0]]}`"])
        case "aggregate":
            text = f"{rest[0]}({written(rest[1], 5, dice)})"
        case "not":
            text = f"not {written(rest[0], 3, dice)}"
        case "neg":
            text = f"-{written(rest[0], 7, dice)}"
        case "compare":
            text = f"{written(rest[1], 5, dice)} {rest[0]} {written(rest[2], 5, dice)}"
        case "^":
            text = f"{written(rest[0], 9, dice)} {dice.choice(['^', '**'])} {written(rest[1], 7, dice)}"
        case _ if level < 9:
            text = f"{written(rest[0], level, dice)} {kind} {written(rest[1], level + 1, dice)}"
        case _:
            text = f"{kind}({', '.join(written(part, 5, dice) for part in rest)})"
    return f"({text})" if level < floor or dice.random() < 0.1 else text


def aggregate(name: str, values: np.ndarray) -> float:
    """By definition, with Python's own exact statistics."""
    listed = values.tolist()
    if name in ("min", "max", "first", "last", "count"):
        found = {"min": values.min(), "max": values.max(), "first": listed[0], "last": listed[-1], "count": len(listed)}
        return float(found[name])
    if name == "median":
        if np.isfinite(values).all():
            return float(statistics.median(map(Fraction, listed)))
        return float(np.median(values))
    if not np.isfinite(values).all():
        return {"rms": float(np.sum(values * values)), "std": NAN}.get(
            name, float(np.sum(values[~np.isfinite(values)]))
        )
    if name == "std":
        return statistics.pstdev(listed)
    if name == "rms":
        return statistics.pstdev([*listed, *(-x for x in listed)])
    total = sum(map(Fraction, listed)) / (len(listed) if name == "mean" else 1)
    try:
        return float(total)
    except OverflowError:
        return INF if total > 0 else -INF


def number(tree: Any, table: np.ndarray) -> np.ndarray:
    kind, *rest = tree
    match kind:
        case "number":
            return np.full(len(table), rest[0])
        case "column":
            return table[:, rest[0]]
        case "aggregate":
            return np.full(len(table), aggregate(rest[0], number(rest[1], table)))
    values = [number(part, table) for part in rest]
    if kind == "^":
        return values[0] * values[0] if rest[1] == ("number", 2.0) else np.power(*values)
    functions = {**UNARY, "neg": np.negative, "min": np.minimum, "max": np.maximum}
    return BINARY[kind][1](*values) if kind in BINARY else functions[kind](*values)


def truth(tree: Any, table: np.ndarray, wanted: bool = True) -> np.ndarray:
    """On which rows `tree` is as `wanted`; a comparison with NaN is neither true nor false."""
    kind, *rest = tree
    if kind == "not":
        return truth(rest[0], table, not wanted)
    if kind == "compare":
        left, right = number(rest[1], table), number(rest[2], table)
        return (RELATIONS[rest[0]](left, right) == wanted) & ~np.isnan(left) & ~np.isnan(right)
    parts = [truth(part, table, wanted) for part in rest]
    return parts[0] & parts[1] if (kind == "and") == wanted else parts[0] | parts[1]


TABLES = st.lists(st.tuples(*[VALUES] * len(COLUMNS)), min_size=1, max_size=6) | st.lists(
    st.tuples(*[VALUES | ODD] * len(COLUMNS)), min_size=1, max_size=4
)
