"""Nodes from their parts: when their values are known, how many numbers they have, and what cannot be combined."""

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.probe.expression import FIXED, ROW, START, TABLE, ColumnReference, ColumnVector, NumberLiteral, Reduction
from mjrun.probe.node_builder import NodeBuilder
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import SourceText, Token, Vocabulary

NAMES = ["x", "q/a", "q/b", "r/a", "r/b", "r/c"]


def builder(aggregates: bool = True) -> NodeBuilder:
    made = NodeBuilder(SourceText("max(x, 'q/*')", "y"), Vocabulary(NAMES))
    made.aggregates = aggregates
    return made


X, VECTOR = ColumnReference(4, 5, ROW, "x"), ColumnVector(7, 12, ROW, ("q/a", "q/b"))
ONE, MAX = NumberLiteral(0, 1, FIXED, 1.0), Token("word", "max", 0, 3)


def test_a_function_of_vectors_reduces_them_and_of_one_value_aggregates() -> None:
    reduced = builder().call(MAX, [X, VECTOR], 13)
    assert isinstance(reduced, Reduction)
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
