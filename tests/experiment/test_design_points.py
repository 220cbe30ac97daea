"""Points that are computed from their index equal those of nested loops; a span equals exact decimals."""

import itertools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.experiment.design import Design, value_list
from mjrun.experiment.design_points import DesignColumn, GridPoints, NumberTexts, numbers, texts_at

COLUMNS = st.lists(st.lists(st.sampled_from(["1", "2", "0.5", "x"]), min_size=1, max_size=4), max_size=3)


def grid(columns: list[list[str]]) -> GridPoints:
    count = int(np.prod([len(texts) for texts in columns], initial=1))
    ends = np.cumprod([1, *[len(texts) for texts in columns]])[1:]
    return GridPoints([(texts, count // int(end)) for texts, end in zip(columns, ends, strict=True)], count)


@given(COLUMNS, st.data())
def test_points_are_those_of_nested_loops(columns: list[list[str]], data: Any) -> None:
    expected, made = list(itertools.product(*columns)), grid(columns)
    chosen = data.draw(st.lists(st.integers(0, len(expected) - 1), unique=True).map(sorted))
    some, some_expected = made.only(np.array(chosen, int)), [expected[index] for index in chosen]
    for points, all_expected in ((made, expected), (some, some_expected), (some.only(np.arange(len(chosen))), None)):
        all_expected = some_expected if all_expected is None else all_expected
        assert list(points) == [points[index] for index in range(len(points))] == all_expected
        part = slice(*sorted(data.draw(st.tuples(st.integers(0, 9), st.integers(0, 9)))))
        assert points[part] == all_expected[part]
        for number in range(len(columns)):
            column = Design(("p",) * len(columns), points).column(number)
            values = [point[number] for point in all_expected]
            assert texts_at(column.texts, column.places) == values
            assert sorted(column.distinct) == sorted({*values})
            assert [*points.distinct(number)] == [*column.distinct]
            assert len({*column.texts}) == len(column.texts)
            texts = column.numbers
            assert (texts is None) == ("x" in values)
            assert texts is None or texts.tolist() == [float(text) for text in values]


def test_the_digest_changes_with_every_value_and_their_order() -> None:
    columns = [["1", "2"], NumberTexts(np.array([1.0, 2.0]), has_integers=True)]
    base = GridPoints([(columns[0], 2), (columns[1], 1)], 4)
    others = [
        GridPoints([(columns[1], 2), (columns[0], 1)], 4),
        GridPoints([(columns[0], 1), (columns[1], 2)], 4),
        GridPoints([(columns[0], 2), (NumberTexts(np.array([1.0, 2.0])), 1)], 4),
        GridPoints([(columns[0], 2), (NumberTexts(np.array([1.0, 3.0]), has_integers=True), 1)], 4),
        base.only(np.array([0, 1, 2])),
        GridPoints([(["1,2"], 2), (columns[1], 1)], 2),
    ]
    assert len({made.digest for made in (base, *others)}) == 1 + len(others)
    assert GridPoints(base.columns, 4).digest == base.digest


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=9))
def test_numbers_have_the_shortest_texts(values: list[float]) -> None:
    texts = NumberTexts(np.array(values, float))
    assert list(texts) == [texts[index] for index in range(len(texts))] == [repr(value) for value in values]
    read, column = numbers(texts), DesignColumn.of(texts, np.arange(len(values)))
    assert read is not None
    assert read.tolist() == values
    assert texts_at(column.texts, column.places) == list(texts)
    assert len({*column.texts}) == len(column.texts) == len({*texts})
    assert [*texts.only(np.arange(len(values))[::2])] == [repr(value) for value in values[::2]]


@pytest.mark.parametrize("text", ["1..7:7", "0.1..0.7:7", "-1e-3..2:31", "1..1e12:5", "0..1e17:3", "1e-18..3e-18:3"])
def test_a_span_is_rounded_once(text: str) -> None:
    first, rest = text.split("..")
    last, count = rest.split(":")
    step = (Fraction(last) - Fraction(first)) / (int(count) - 1)
    exact = [Fraction(first) + step * index for index in range(int(count))]
    texts = [*value_list("p", text, "vary")]
    assert [float(value) for value in texts] == [float(value) for value in exact]
    assert [text.removeprefix("-").isdecimal() for text in texts] == [value.denominator == 1 for value in exact]


def test_whole_numbers_that_floats_round_stay_texts() -> None:
    large = 2**53
    for text in ("0.5", str(large), str(large + 2), "1e300", ""):
        assert numbers([text, "3"]) is not None
    assert numbers([str(large + 1), "3"]) is None
    column = DesignColumn([str(large), str(large + 1)], np.array([0, 1]))
    assert column.numbers is None
    assert [*column.distinct] == [str(large), str(large + 1)]
