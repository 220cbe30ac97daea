"""Columns of tables: how numbers, ranges and units are written, and when a column is blank."""

from fractions import Fraction

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mjrun.cli.table_cells import (
    UNITS,
    byte_size,
    common,
    number,
    numbers,
    ranges,
    reference,
    short_value,
    slots,
    span,
    texts,
    vector,
    vectors,
)


@given(st.floats(-1e300, 1e300))
def test_a_number_has_five_significant_digits_and_no_negative_zero(value: float) -> None:
    assert float(number(value)) == pytest.approx(value, rel=1e-4)
    assert number(value) != "-0"


def test_nothing_is_written_for_nothing() -> None:
    assert (number(None), vector(None), span(None), slots(None, 3), slots(2, 0), reference("geom", None)) == ("",) * 6


@given(st.integers(0, 50), st.integers(1, 9))
def test_slots_slice_a_vector_as_python_does(start: int, count: int) -> None:
    values = [*range(100)]
    first, _, last = slots(start, count).partition(":")
    assert (values[int(first) : int(last)] if last else [values[int(first)]]) == values[start : start + count]


@given(st.integers(0, 2**45))
@example(352512)  # 344.25 KiB, half a decimal from 344.2
def test_a_size_is_right_to_its_one_decimal(count: int) -> None:
    value, unit = byte_size(count).split()
    power = 1024 ** UNITS.index(unit)
    assert abs(Fraction(value) * power - count) <= Fraction(power, 20)
    assert float(value) < 1024.05 or unit == UNITS[-1]


@pytest.mark.parametrize(
    ("count", "expected"),
    [(None, "?"), (0, "0 B"), (1023, "1023 B"), (1024, "1.0 KiB"), (1536, "1.5 KiB"), (1 << 20, "1.0 MiB"),
     (5 << 40, "5120.0 GiB")],
)  # fmt: skip
def test_bytes_are_counted_in_powers_of_1024(count: int | None, expected: str) -> None:
    assert byte_size(count) == expected


def test_names_are_cleaned() -> None:
    assert list(texts("name", ["a\x1b[31m", None]).cells) == [r"a\x1b[31m", ""]
    assert reference("geom", "x\n") == r"geom/x\n"
    assert common(["b", "a", "b"]) == "b, a"


@pytest.mark.parametrize(
    ("values", "usual", "expected"),
    [([0, None, 0], 0, ["", "", ""]), ([0, None, 2.5], 0, ["0", "", "2.5"]), ([3, 3], 3, ["", ""])],
)
def test_a_column_of_usual_numbers_is_blank(values: list[float | None], usual: float, expected: list[str]) -> None:
    assert list(numbers("condim", values, usual=usual).cells) == expected


def test_a_range_has_its_own_unit_and_only_units_that_occur_are_shown() -> None:
    column = ranges("range", [(-1, 1), None, (0, 2), (0, 3)], ["rad", "kg", "m", "rad"])
    assert (list(column.cells), column.unit) == (["-1..1", "", "0..2", "0..3"], "rad\nm")


def test_vectors_are_written_as_in_mjcf() -> None:
    assert list(vectors("axis", [(0, 0.5, 1e-7), None]).cells) == ["0 0.5 1e-07", ""]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("0.123456789", "0.12346"),
        ("1e-05", "1e-05"),
        ("123456", "123456"),
        ("4294967295", "4294967295"),
        ("-1234567", "-1234567"),
        ("1_0", "1_0"),
        ("a.xml", "a.xml"),
    ],
)
def test_a_value_has_few_digits_unless_it_is_whole_or_a_text(text: str, shown: str) -> None:
    assert short_value(text) == shown
