"""Theorems about assertions: what they say of a table, however it is split, and what is no assertion."""

import ast
import math
import random
import statistics
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mjrun.errors import UnknownNameError, UsageError, clean
from mjrun.probe import assertion
from mjrun.probe.aggregate import CHUNK, shown
from mjrun.probe.assertion import Verdict, parse
from mjrun.probe.expression import FUNCTIONS
from mjrun.probe.parser import DEEPEST, LONGEST
from mjrun.probe.scanner import is_bare, spelled

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


# --- what an assertion says ------------------------------------------------------------------------

TIMED = ["time", "x", "y"]
ROWS = [[0, 1, 4], [0.5, 3, -2], [1, 3, 0], [1.5, -2, 4]]

VERDICTS = [
    ("max(x) < 3.5", True, "it is 3, at row 1, time 0.5"),
    ("max(x) < 3", False, "it is 3, at row 1, time 0.5"),
    ("min(x) > -2", False, "it is -2, at row 3, time 1.5"),
    ("min(y) == -2", True, "it is -2, at row 1, time 0.5"),
    ("first(x) == 1", True, "it is 1, at row 0, time 0"),
    ("last(time) == 1.5", True, "it is 1.5, at row 3, time 1.5"),
    ("last(time) == 1.5000000000000002", False, "it is 1.5, at row 3, time 1.5"),
    ("count(x) == 4", True, "it is 4"),
    ("sum(x) != 5", False, "it is 5"),
    ("mean(x) == 1.25", True, "it is 1.25"),
    ("rms(y) == 3", True, "it is 3"),
    ("std(time)^2 < 0.3126", True, "it is 0.31250000000000006 (std(time) is 0.5590169943749475)"),
    ("abs(x) < 4", True, "it holds on all 4 rows"),
    ("abs(x) <= 2", False, "it is 3, at row 1, time 0.5, the first of 2 such rows"),
    ("x > -2", False, "it is -2, at row 3, time 1.5"),
    ("2 > x", False, "it is 3, at row 1, time 0.5, the first of 2 such rows"),
    ("not x < 1", False, "it is -2, at row 3, time 1.5"),
    ("x < 3 or y < 1", True, "it holds on all 4 rows"),
    ("x < 3 or y < 0", False, "x is 3, y is 0, at row 2, time 1"),
    ("x < 9 and y < 9", True, "x < 9 holds on all 4 rows; y < 9 holds on all 4 rows"),
    ("x < 9 and y < 4", False, "y is 4, at row 0, time 0, the first of 2 such rows"),
    ("not (x > 9 or y > 9)", True, "x > 9 holds on all 4 rows; y > 9 holds on all 4 rows"),
    ("x < 0 or max(y) == 4", True, "max(y) is 4, at row 0, time 0"),
    (
        "x < 0 or max(y) < 4",
        False,
        "x is 1, at row 0, time 0, the first of 3 such rows; max(y) is 4, at row 0, time 0",
    ),
    ("-2 <= x <= 3", True, "-2 <= x holds on all 4 rows; x <= 3 holds on all 4 rows"),
    ("0 < max(x) < 1", False, "it is 3, at row 1, time 0.5"),
    (
        "max(x) - min(x) < 5",
        False,
        "it is 5 (max(x) is 3, at row 1, time 0.5; min(x) is -2, at row 3, time 1.5)",
    ),
    ("max(x) > max(y)", False, "max(x) is 3, at row 1, time 0.5; max(y) is 4, at row 0, time 0"),
    ("abs(x - first(x)) < 3", False, "it is 3, at row 3, time 1.5"),
    ("x <= first(x)", False, "x is 3, first(x) is 1, at row 1, time 0.5, the first of 2 such rows"),
    ("max(abs(y - first(y))) == 6", True, "it is 6, at row 1, time 0.5"),
    ("min(x, y, 0) >= -2", True, "it holds on all 4 rows"),
    ("max(max(x), max(y), 5) == 5", True, "it is 5 (max(x) is 3, at row 1, time 0.5; max(y) is 4, at row 0, time 0)"),
    ("log(x) < 9", False, "it is nan (no comparison with nan holds), at row 3, time 1.5"),
    ("not log(x) < 9", False, "it is 0, at row 0, time 0, the first of 4 such rows"),
    ("max(sqrt(x)) < 9", False, "it is nan (no comparison with nan holds), at row 3, time 1.5"),
    ("mean(sqrt(x)) != 9", False, "it is nan (no comparison with nan holds), at row 3, time 1.5"),
    ("x / y < inf", False, "it is inf, at row 2, time 1"),
    ("sum(x / y) == inf", True, "it is inf, at row 2, time 1"),
    ("exp(0*x) == 1 and cos(0*x) == 1 and sin(0*x) == tan(0*x)", True, None),
    ("-2^2 == 0*x - 4 and 2^-1 == 0*x + .5 and 2^3^2 == 0*x + 512 and 2**3 == 0*x + 8", True, None),
    ("x^2 == x*x and -x^2 == -(x*x) and x - 1 - 1 == x - 2 and 8/2/2 == 0*x + 2", True, None),
    ("+x == - -x and 2*-x == -2*x and 1e0 + 1. + .5 == 2.5 + 0*x", True, None),
    ("abs(sin(pi + 0*x)) < 1e-15", True, "it holds on all 4 rows"),
    ("\t( (x) )\n<9", True, "it holds on all 4 rows"),
]


@pytest.mark.parametrize(("text", "passed", "told"), VERDICTS)
def test_a_verdict_says_whether_with_which_values_and_where(text: str, passed: bool, told: str | None) -> None:
    verdict = judged(text, TIMED, ROWS)
    assert (verdict.text, verdict.passed) == (text, passed)
    assert told is None or verdict.message == f"{clean(text)}: {told}"


def test_without_a_time_column_the_row_alone_is_told_and_rows_count_from_the_first_that_was_fed() -> None:
    assert judged("max(x) < 2", ["x"], [1, 3]).message == "max(x) < 2: it is 3, at row 1"
    assert judged("max(x) < 2", ["x"], [1, 3], [1], first=10).message == "max(x) < 2: it is 3, at row 11"
    assert judged("x < 2", ["x"], [1]).message == "x < 2: it holds on the only row"


@pytest.mark.parametrize("text", ["x < 1", "count(x) == 0", "not max(x) < 1"])
def test_no_rows_at_all_is_a_failure(text: str) -> None:
    assert judged(text, ["x"], []) == Verdict(text, False, f"{text}: there are no rows")
    checker = parse(text, ["x"]).checker()
    checker.feed(np.empty((0, 1)), 0)
    assert not checker.verdict().passed


def test_a_checker_is_fresh_and_a_verdict_may_be_asked_twice() -> None:
    parsed = parse("max(x) < 2", ["x"])
    first, second = parsed.checker(), parsed.checker()
    first.feed(np.array([[3.0]]), 0)
    second.feed(np.array([[1.0]]), 0)
    assert [first.verdict().passed, second.verdict().passed] == [False, True]
    assert first.verdict() == first.verdict()


def test_the_columns_of_an_assertion_are_those_it_reads_in_the_order_of_the_table() -> None:
    assert parse("max(c) < first(a) and c > 1", ["a", "b", "c", "time"]).columns == ("a", "c")


@pytest.mark.parametrize(("shape", "row"), [((2, 2), 3), ((2,), 3), ((2, 1), 2), ((2, 1), 4)])
def test_a_block_of_other_columns_or_out_of_order_is_a_bug_of_the_caller(shape: tuple[int, ...], row: int) -> None:
    checker = parse("x < 1", ["x"]).checker()
    checker.feed(np.zeros((3, 1)), 0)
    with pytest.raises(ValueError, match="block"):
        checker.feed(np.zeros(shape), row)


# --- names -----------------------------------------------------------------------------------------

NAMES = ["a", "b", "a/b", "a-b", "qpos/hip", "qpos/hip/x", "joint:3", "left foot/x", "v1.2", "a[0]", "it's", "x`y", "1"]
NAMES += ["max", "pi", "not", "or else", "é/ß", "e1"]


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("a/b < 1", ("a/b",)),
        ("a / b < 1", ("a", "b")),
        ("(a)/b < 1", ("a", "b")),
        ("a/'b' < 1", ("a", "b")),
        ("a-b < 1", ("a-b",)),
        ("a -b < 1", ("a", "b")),
        ("b/a < 1", ("a", "b")),
        ("b-1 < 1", ("b",)),
        ("qpos/hip/x < 1", ("qpos/hip/x",)),
        ("qpos/hip/a < 1", ("a", "qpos/hip")),
        ("qpos/hip/2 < 1", ("qpos/hip",)),
        ("joint:3 < 1", ("joint:3",)),
        ("left foot/x < 1", ("left foot/x",)),
        ("v1.2<1", ("v1.2",)),
        ("'a[0]' < 1", ("a[0]",)),
        ("'it''s' < 1", ("it's",)),
        ("`it's` < 1", ("it's",)),
        ("`x``y` < 1", ("x`y",)),
        ("'1' < 1", ("1",)),
        ("max < 1", ("max",)),
        ("max(max) < max (a, 1)", None),
        ("max(max) < 1", ("max",)),
        ("pi < 1", ("pi",)),
        ("not 'not' < 1", ("not",)),
        ("'or else' < 1 or b < 1", ("b", "or else")),
        ("é/ß < 1", ("é/ß",)),
        ("2*e1 < 2e1", ("e1",)),
    ],
)
def test_the_longest_known_name_is_read_and_division_otherwise(text: str, columns: tuple[str, ...] | None) -> None:
    if columns is None:
        with pytest.raises(UsageError, match="an aggregate next to values per row"):
            parse(text, NAMES)
    else:
        assert parse(text, NAMES).columns == columns


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=5, unique=True))
@settings(max_examples=200, deadline=None)
def test_every_name_can_be_spelled_whatever_its_neighbours(columns: list[str]) -> None:
    for index, name in enumerate(columns):
        row = np.zeros((1, len(columns)))
        row[0, index] = 3
        assert judged(f"{spelled(name)} == 3", columns, row).passed
        assert not is_bare(name) or spelled(name) == name


# --- what is no assertion --------------------------------------------------------------------------

OPERAND = "a number, a column, a function"
COMPARISONS = "a comparison (< <= > >= == !=)"
LATE = "an aggregate next to values per row, and it is known after the last row only"
EARLY = "aggregates only, values per row only, or first(…) among them"

WRONG = [
    ("", 1, "the end", f"{OPERAND}, '(' or 'not'"),
    ("  ", 3, "the end", f"{OPERAND}, '(' or 'not'"),
    ("max(x)", 1, "a number", COMPARISONS),
    ("x", 1, "a number", COMPARISONS),
    ("max(x", 6, "the end", "+ - * / ^, ',' or ')'"),
    ("(x < 1", 7, "the end", "an operator or ')'"),
    ("max(x)) < 1", 7, "')'", "an operator or the end"),
    (") x < 1", 1, "')'", f"{OPERAND}, '(' or 'not'"),
    ("x < 1 y", 7, "'y'", "an operator or the end"),
    ("x < 1 2", 7, "'2'", "an operator or the end"),
    ("3x < 1", 2, "'x'", "an operator or the end"),
    ("x between 1 and 2", 3, "'between'", "an operator or the end"),
    ("< 3", 1, "'<'", f"{OPERAND}, '(' or 'not'"),
    ("x <", 4, "the end", f"{OPERAND} or '('"),
    ("x < < 3", 5, "'<'", f"{OPERAND} or '('"),
    ("x + * 2 < 1", 5, "'*'", f"{OPERAND} or '('"),
    ("x = 1", 3, "'=' (did you mean ==?)", "an operator or the end"),
    ("x < 1 && y < 1", 7, "'&' (did you mean and?)", "an operator or the end"),
    ("x < 1 || y < 1", 7, "'|' (did you mean or?)", "an operator or the end"),
    ("!x < 1", 1, "'!' (did you mean not?)", f"{OPERAND}, '(' or 'not'"),
    ("x ≤ 1", 3, "'≤' (did you mean <=?)", "an operator or the end"),
    ("x % 2 < 1", 3, "'%'", "an operator or the end"),
    ('"x" < 1', 1, "'\"' (did you mean '?)", f"{OPERAND}, '(' or 'not'"),
    ("x.real < 1", 1, None, None),
    ("x < 1; y < 1", 6, "';'", "an operator or the end"),
    ("'x < 1", 1, "a quote that is not closed", "another '"),
    ("`x < 1", 1, "a quote that is not closed", "another `"),
    ("x < 1e999", 5, "a number beyond all floats (1e999)", "less, or inf"),
    ("max < 1", 5, "'<'", "'(' after max"),
    ("max() < 1", 5, "')'", f"{OPERAND} or '('"),
    ("max(x,) < 1", 7, "')'", f"{OPERAND} or '('"),
    ("max(x < 1) < 2", 7, "'<'", "+ - * / ^, ',' or ')'"),
    ("abs(x, y) < 1", 1, "abs of 2 values", "abs of one"),
    ("mean(x, y, 1) < 1", 1, "mean of 3 values", "mean of one"),
    ("max(mean(x)) < 1", 5, "an aggregate within max", "values per row in it"),
    ("max(first(x)) < 1", 5, "an aggregate within max", "values per row in it"),
    ("mean(x + 0*y - first(y)) < max(3)", 32, "max of what is the same on all rows", "a column in it"),
    ("max(x - mean(x)) < 1", 9, LATE, EARLY),
    ("x < max(x)", 5, LATE, EARLY),
    ("1 < 2", 1, "a comparison of numbers only", "a column on one side"),
    ("0 < 1 < x", 1, "a comparison of numbers only", "a column on one side"),
    ("(x < 1) + 1 < 2", 2, "a comparison", "a number"),
    ("x < (y < 1)", 6, "a comparison", "a number"),
    ("(x < 1) == (y < 1)", 2, "a comparison", "a number"),
    ("abs((x < 1)) < 1", 6, "a comparison", "a number"),
    ("-(x < 1)", 3, "a comparison", "a number"),
    ("x and y < 1", 1, "a number", COMPARISONS),
    ("x < 1 or y", 10, "a number", COMPARISONS),
    ("not x", 5, "a number", COMPARISONS),
    ("2 ^ not x < 1", 5, "'not'", f"{OPERAND} or '('"),
    ("and x < 1", 1, "'and'", f"{OPERAND}, '(' or 'not'"),
    ("x < 1 or", 9, "the end", f"{OPERAND}, '(' or 'not'"),
    ("q[0] < 1", 1, "column 'q[0]' without quotes", "'q[0]'"),
    (
        "(x < 1 and max(y) < 1) or x > 2",
        1,
        "an 'or' whose sides hold values per row, and an 'and' with aggregates among them",
        "two assertions, or aggregates only",
    ),
]


@pytest.mark.parametrize(("text", "place", "found", "expected"), WRONG)
def test_what_is_no_assertion_is_told_where_what_was_found_and_what_is_valid(
    text: str, place: int, found: str | None, expected: str | None
) -> None:
    with pytest.raises(UsageError) as caught:
        parse(text, ["time", "x", "y", "q[0]"])
    assert caught.value.exit_code == 2
    if found:
        pointer = f"\n  {text}\n  {' ' * (place - 1)}^" if text.strip() else ""
        assert str(caught.value) == f"assert, character {place}: found {found}, expected {expected}{pointer}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "max(xpos/torzo) < 1",
            "no column 'xpos/torzo' in 'max(xpos/torzo) < 1', character 5 (did you mean 'xpos/torso'?)\n"
            "columns: time, xpos/torso",
        ),
        ("'tim' < 1", "no column 'tim' in ''tim' < 1', character 1 (did you mean 'time'?)\ncolumns: time, xpos/torso"),
        ("xpos < 1", "no column 'xpos' in 'xpos < 1', character 1\ncolumns: time, xpos/torso"),
        (
            "time:3 < 1",
            "no column 'time:3' in 'time:3 < 1', character 1 (did you mean 'time'?)\ncolumns: time, xpos/torso",
        ),
        (
            "maxi(time) < 1",
            f"no function 'maxi' in 'maxi(time) < 1', character 1 (did you mean 'max'?)\n"
            f"functions: {', '.join(FUNCTIONS)}",
        ),
        (
            "__import__('os') < 1",
            f"no function '__import__' in '__import__('os') < 1', character 1\nfunctions: {', '.join(FUNCTIONS)}",
        ),
    ],
)
def test_an_unknown_name_is_told_with_near_and_valid_ones(text: str, message: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        parse(text, ["time", "xpos/torso"])
    assert str(caught.value) == message


def test_an_expression_too_long_is_refused_and_one_at_the_limit_is_not() -> None:
    with pytest.raises(UsageError, match=rf"^assert: {LONGEST + 1} characters, expected at most {LONGEST}$"):
        parse("x" * (LONGEST + 1), ["x"])
    longest = "+".join(["x"] * (LONGEST // 2 - 1)) + "<1"
    assert judged(longest.ljust(LONGEST), ["x"], [0]).passed


@pytest.mark.parametrize(
    ("opening", "inner", "closing"),
    [("(", "x", ")"), ("-", "x", ""), ("abs(", "x", ")"), ("1+(", "x", ")"), ("x^", "x", ""), ("not ", "x<1", "")],
)
def test_depth_is_bounded_well_within_pythons_own_limit(opening: str, inner: str, closing: str) -> None:
    def nested(depth: int) -> str:
        return opening * depth + inner + closing * depth + ("" if "<" in inner else "<1")

    judged(nested(DEEPEST // 2 - 2), ["x"], [0])
    for depth in (DEEPEST, 1000):
        with pytest.raises(UsageError, match=f"expected at most {DEEPEST} expressions within each other"):
            parse(nested(depth), ["x"])


PARTS = [*"xyab/.-+*^<>=!()',` \t019e", *"\x1b\u202eé²", " and ", " or ", " not ", "max(", "first(", "x", "a/b", " < "]


@given(st.lists(st.sampled_from(PARTS)).map("".join))
@settings(max_examples=500, deadline=None)
def test_any_text_is_an_assertion_or_a_usage_error_fit_for_a_terminal(text: str) -> None:
    columns = ["x", "a/b", "a", "x y", "\x1b[2J"]
    try:
        message = judged(text, columns, np.ones((2, 5))).message
    except UsageError as error:
        message = str(error)
    assert [clean(line) for line in message.split("\n")] == message.split("\n")


# --- an independent oracle -------------------------------------------------------------------------

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


@given(TRUTHS, TABLES, st.randoms(use_true_random=False))
@settings(max_examples=600, deadline=None)
def test_an_assertion_passes_where_an_oracle_finds_it_true_on_every_row(
    tree: Any, rows: list[Any], dice: random.Random
) -> None:
    text, table = written(tree, 0, dice), np.array(rows)
    assume(len(text) < LONGEST)
    with np.errstate(all="ignore"):
        expected = bool(truth(tree, table).all())
    verdict = judged(text, COLUMNS, table, list(range(len(rows))))
    assert (verdict.text, verdict.passed) == (text, expected), verdict.message


@given(st.lists(VALUES | ODD | st.floats(allow_nan=False), min_size=1, max_size=30), st.sampled_from(FUNCTIONS[7:]))
@settings(max_examples=400, deadline=None)
def test_every_aggregate_is_the_true_value_rounded_once(values: list[float], name: str) -> None:
    with np.errstate(all="ignore"):
        expected = aggregate(name, np.array(values))
    message = judged(f"{name}(x) < 0", ["x"], values).message.split(": it is ")[1]
    found = float(message.partition(",")[0].partition(" ")[0])
    assert found == expected or (math.isnan(found) and math.isnan(expected))


def test_the_oracles_own_precedence_is_pythons() -> None:
    dice = random.Random(1)
    leaf = [("number", 2.0), ("number", 7.0), ("number", 0.1)]
    for _ in range(300):
        tree: Any = dice.choice(leaf)
        for _ in range(4):
            pair = [tree, dice.choice(leaf)]
            dice.shuffle(pair)
            tree = dice.choice([("neg", tree), (dice.choice("+-*"), *pair), ("^", tree, ("number", 2.0))])
        text = written(tree, 0, dice)
        python = eval(text.replace("^", "**"), {"__builtins__": {}})
        assert judged(f"x == {text}", ["x"], [python]).passed


# --- any split of the table ------------------------------------------------------------------------

LONG = (
    np.random.default_rng(7).standard_normal((3 * CHUNK + 17, len(COLUMNS)))
    * np.logspace(-9, 9, 3 * CHUNK + 17)[:, None]
)
SPLIT = [
    "sum(x) < 0 and mean(x) < 0 and rms(x) < 0",
    "std(x) < 0 or sum(exp(x)) < 0 or sum(x^3) == 0 or mean(sin(time)) == 0",
    "max(x) < min(a/b) and last(x) < first(time)",
    "tan(x) * exp(-abs(x)) < .5",
    "abs(x - first(x)) < 1e9",
    "log(x) < 1 or x < -1e7",
]


@given(st.sampled_from(SPLIT), st.lists(st.integers(0, len(LONG)), max_size=12))
@settings(max_examples=100, deadline=None)
def test_a_verdict_does_not_depend_on_how_the_rows_are_split(text: str, cuts: list[int]) -> None:
    assert judged(text, COLUMNS, LONG, cuts) == judged(text, COLUMNS, LONG)


@pytest.mark.parametrize("text", SPLIT)
def test_rows_one_at_a_time_give_the_same_verdict_to_the_last_bit(text: str) -> None:
    assert judged(text, COLUMNS, LONG, list(range(len(LONG)))) == judged(text, COLUMNS, LONG)


@pytest.mark.parametrize("row", [0, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK, 3 * CHUNK + 16])
def test_a_single_bad_row_is_found_wherever_it_is(row: int) -> None:
    for bad, shows in ((9.0, "9"), (NAN, "nan (no comparison with nan holds)"), (INF, "inf")):
        table = np.zeros(3 * CHUNK + 17)
        table[row] = bad
        for text in ("x < 1", "max(x) < 1"):
            assert judged(text, ["x"], table).message == f"{text}: it is {shows}, at row {row}"


def test_sums_neither_cancel_nor_drift() -> None:
    assert judged("sum(x) == 2", ["x"], [1e308, 1, 1e308, 1, -1e308, -1e308]).passed
    assert judged("sum(x) == 1000 * .1 and mean(x) == .1", ["x"], [0.1] * 1000).passed
    tiny = 1e9 + np.tile([-0.001953125, 0.001953125], 3000)
    assert judged("std(x) == 0.001953125", ["x"], tiny).passed
    assert judged("rms(x) == 1e200 and std(x) == 0", ["x"], [1e200] * 3).passed
    assert judged("rms(x) == 5e-324", ["x"], [5e-324] * 3).passed
    assert judged("sum(x) == inf and mean(x) == 1e308", ["x"], [1e308] * 3).passed
    assert judged("sum(x) == -inf and mean(x) == -1e308", ["x"], [-1e308] * 3).passed


def test_what_a_checker_keeps_does_not_grow() -> None:
    def size() -> int:
        state = [vars(g) for g in checker._accumulators.values()] + [vars(w) for w in checker._row_checks.values()]
        return checker._buffer.nbytes + sum(len(str(value)) for kept in state for value in kept.values())

    checker, block = parse(f"{' and '.join(SPLIT[:1])} and x < 1", COLUMNS).checker(), np.ones((100 * CHUNK, 4))
    checker.feed(block, 0)
    before = size()
    checker.feed(block, len(block))
    assert size() <= before + 20


# --- trust -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("module", ["assertion", "aggregate", "expression", "parser", "scanner"])
def test_an_expression_never_reaches_pythons_own_evaluation(module: str) -> None:
    tree = ast.parse(Path(assertion.__file__).with_name(f"{module}.py").read_text("utf-8"))
    called = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert called.isdisjoint({"eval", "exec", "compile", "getattr", "setattr", "globals", "__import__", "open"})
    imported = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    ours = {"mjrun.errors"} | {f"mjrun.probe.{name}" for name in ("aggregate", "expression", "parser", "scanner")}
    assert imported <= {"math", "re", "numpy", "collections.abc", "dataclasses", "typing"} | ours


@given(st.floats())
def test_a_number_is_shown_so_that_it_reads_back(value: float) -> None:
    assert float(shown(value)) == value or math.isnan(value)
