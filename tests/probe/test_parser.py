"""What is no assertion: where it goes wrong, what was found there and what is valid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UnknownNameError, UsageError, clean
from mjrun.probe.assertion import parse
from mjrun.probe.expression import (
    FIXED,
    FUNCTIONS,
    ROW,
    START,
    TABLE,
    ColumnReference,
    ColumnVector,
    NumberLiteral,
    RowwiseReduction,
)
from mjrun.probe.parser import DEEPEST, LONGEST, NodeBuilder, Parser
from mjrun.probe.scanner import SourceText, Token, Vocabulary
from tests.probe.expression_oracle import judged

OPERAND = "a number, a column, a function"
ONE_NUMBER = "one number: norm(…), sum(…), min(…) or max(…) of it"
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
    ("x.real < 1", 1, None, None),
    ("x < 1; y < 1", 6, "';'", "an operator or the end"),
    ("'x < 1", 1, "a quote that is not closed", "another '"),
    ("`x < 1", 1, "a quote that is not closed", "another `"),
    ('"x < 1', 1, "a quote that is not closed", 'another "'),
    ("'?' < 1", 1, "a vector of 2 numbers", ONE_NUMBER),
    ("max(mean('?')) < 1", 10, "a vector of 2 numbers", ONE_NUMBER),
    ("max('?' + 1, x < 1) < 1", 5, "a vector of 2 numbers", ONE_NUMBER),
    ("sum('?' * '*') < 1", 11, "a vector of 4 numbers next to one of 2", "vectors of the same length"),
    ("where(x, 1, 2) < 1", 7, "a number", COMPARISONS),
    ("where(x < 1, y) < 1", 1, "where of 2 values", "where(condition, x, y)"),
    ("where(x < 1, max(x), y) < 1", 14, LATE, EARLY),
    ("clip(x, 0) < 1", 1, "clip of 2 values", "clip(x, low, high)"),
    ("tanh(x, y) < 1", 1, "tanh of 2 values", "tanh of one"),
    ("isfinite(3)", 10, "a number only", "a column in it"),
    ("isfinite(x) + 1 < 1", 1, "a comparison", "a number"),
    ("previous(x) < 1", 1, "previous, which only tasks have", "values of one instant"),
    ("max(rate(x)) < 1", 5, "rate, which only tasks have", "values of one instant"),
    ("x < 1e999", 5, "a number too large for floating point (1e999)", "less, or inf"),
    ("max < 1", 5, "'<'", "'(' after max"),
    ("max() < 1", 5, "')'", f"{OPERAND}, '(' or 'not'"),
    ("max(x,) < 1", 7, "')'", f"{OPERAND}, '(' or 'not'"),
    ("abs() < 1", 5, "')'", f"{OPERAND} or '('"),
    ("abs(x < 1) < 2", 7, "'<'", "+ - * / ^, ',' or ')'"),
    ("max(x < 1) < 2", 5, "a comparison", "a number"),
    ("abs(x, y) < 1", 1, "abs of 2 values", "abs of one"),
    ("mean(x, y, 1) < 1", 9, "a number", COMPARISONS),
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
    ("q[0] < 1", 1, "the column q[0] without quotes", "'q[0]'"),
    (
        "(x < 1 and max(y) < 1) or x > 2",
        1,
        "an 'or' whose sides hold values per row, and an 'and' with aggregates among them",
        "two assertions, or aggregates only",
    ),
]


@pytest.mark.parametrize(("text", "place", "found", "expected"), WRONG)
def test_what_is_no_assertion_is_reported_where_what_was_found_and_what_is_valid(
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
def test_an_unknown_name_is_reported_with_near_and_valid_ones(text: str, message: str) -> None:
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
@settings(max_examples=150, deadline=None)
def test_any_text_is_an_assertion_or_a_usage_error_fit_for_a_terminal(text: str) -> None:
    columns = ["x", "a/b", "a", "x y", "\x1b[2J"]
    try:
        message = judged(text, columns, np.ones((2, 5))).message
    except UsageError as error:
        message = str(error)
    assert [clean(line) for line in message.split("\n")] == message.split("\n")


NAMES = ["x", "q/a", "q/b", "r/a", "r/b", "r/c"]


def builder(aggregates: bool = True) -> NodeBuilder:
    made = NodeBuilder(SourceText("max(x, 'q/*')", "y"), Vocabulary(NAMES))
    made.aggregates = aggregates
    return made


X, VECTOR = ColumnReference(4, 5, ROW, "x"), ColumnVector(7, 12, ROW, ("q/a", "q/b"))
ONE, MAX = NumberLiteral(0, 1, FIXED, 1.0), Token("word", "max", 0, 3)


def test_a_function_of_vectors_reduces_them_and_of_one_value_aggregates() -> None:
    reduced = builder().call(MAX, [X, VECTOR], 13)
    assert isinstance(reduced, RowwiseReduction)
    assert (reduced.kind, reduced.width, reduced.operands) == (ROW, 0, (X, VECTOR))
    assert builder().call(MAX, [X], 13).kind == TABLE  # type: ignore[union-attr]
    assert builder().call(MAX, [X, ONE], 13).kind == ROW  # type: ignore[union-attr]
    with pytest.raises(UsageError, match="max over all instants"):
        builder(aggregates=False).call(MAX, [X], 13)


def test_what_is_elementwise_is_as_wide_as_its_vectors() -> None:
    call = builder().elementwise(0, 13, [np.add, np.multiply], [ONE, VECTOR, X])
    assert (call.kind, call.width, call.start, call.end) == (ROW, 2, 0, 13)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("norm(3, 4)", FIXED),
        ("norm('q/*')", ROW),
        ("first(x) + 1", START),
        ("where(x > first(x), 1, 2)", ROW),
        ("where(max(x) > 3, mean(x), 2)", TABLE),
        ("clip(x, first(x), 1)", ROW),
        ("sum(x, 1)", ROW),
        ("max(norm('q/*'))", TABLE),
    ],
)
def test_the_kind_of_a_value_is_that_of_its_latest_part(text: str, kind: str) -> None:
    parser = Parser(text, "y", Vocabulary(NAMES))
    assert parser.nodes.value(parser._expression(0)).kind == kind


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("'q/*' + 'r/*'", "a vector of 3 numbers next to one of 2, expected vectors of the same length"),
        ("where(x > 0, 'q/*', 'r/*')", "a vector of 3 numbers next to one of 2"),
        ("where(x > max(x), 1, 2)", "an aggregate next to values per row"),
        ("mean('q/*')", "a vector of 2 numbers, expected one number"),
        ("rate(x)", "rate, which only tasks have"),
    ],
)
def test_what_does_not_go_together_is_reported(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Parser(text, "y", Vocabulary(NAMES)).row_value()
