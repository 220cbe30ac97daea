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
from tests.cases import cases
from tests.probe.expression_oracle import judged


@cases("text, place, found, expected")
def test_what_is_no_assertion_is_reported_where_what_was_found_and_what_is_valid(
    text: str, place: int, found: str | None, expected: str | None
) -> None:
    with pytest.raises(UsageError) as caught:
        parse(text, ["time", "x", "y", "q[0]", "v/1"])
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


@cases("text, message")
def test_what_does_not_go_together_is_reported(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Parser(text, "y", Vocabulary(NAMES)).row_value()
