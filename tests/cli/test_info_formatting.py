"""Theorems about the numbers, names and columns of `mjrun info`."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.cli import info_formatting as formatting


@dataclass(frozen=True)
class Row:
    name: str | None = None
    mass: float | None = None
    axis: tuple[float, ...] | None = None
    range: tuple[float, float] | None = None
    unit: str = ""


@given(st.floats(-1e300, 1e300))
def test_a_number_reads_back_to_five_digits_and_zero_has_no_sign(value: float) -> None:
    text = formatting.number(value)
    assert float(text) == pytest.approx(value, rel=1e-4)
    assert text != "-0"


def test_nothing_is_written_for_what_is_not_there() -> None:
    assert formatting.number(None) == formatting.vector(None) == formatting.span(None) == ""
    assert formatting.slots(None, 3) == formatting.slots(2, 0) == ""
    assert formatting.reference(None, None) == ""


@given(start=st.integers(0, 50), count=st.integers(1, 9))
def test_slots_address_as_python_does(start: int, count: int) -> None:
    vector = list(range(100))
    taken = eval(f"vector[{formatting.slots(start, count)}]")
    assert taken == (vector[start] if count == 1 else vector[start : start + count])


@given(st.integers(0, 2**45))
def test_a_size_is_right_to_its_one_decimal(count: int) -> None:
    value, unit = formatting.size(count).split()
    power = 1024 ** formatting.UNITS.index(unit)
    assert abs(float(value) * power - count) <= 0.05 * power
    assert float(value) < 1024.05 or unit == formatting.UNITS[-1]


def test_an_unknown_size_is_a_question_mark() -> None:
    assert formatting.size(None) == "?"


def test_vectors_ranges_and_references_are_written_as_mjcf_and_options_have_them() -> None:
    assert formatting.vector((1.0, -0.0, 0.25)) == "1 0 0.25"
    assert formatting.span((-1.5, 0.2)) == "-1.5..0.2"
    assert formatting.reference("geom", "a\x1b") == r"geom/a\x1b"
    assert formatting.common(["N", "N·m", "N"]) == "N, N·m"


def test_a_column_of_numbers_is_blank_where_all_are_as_usual() -> None:
    assert not any(formatting.numbers("mass", [Row(mass=0.0), Row(mass=None)], "mass").cells)
    assert not any(formatting.numbers("mass", [Row(mass=3.0)] * 2, "mass", usual=3).cells)
    assert formatting.numbers("mass", [Row(mass=0.0), Row(mass=2.5)], "mass").cells == ["0", "2.5"]


def test_a_column_of_ranges_has_the_units_that_occur_in_its_rows() -> None:
    rows = [Row(range=(-1, 1), unit="rad"), Row(range=(0, 2), unit="m"), Row(unit="px"), Row(range=(0, 1), unit="rad")]
    column = formatting.ranges("range", rows, "range")
    assert column.cells == ["-1..1", "0..2", "", "0..1"]
    assert column.unit == "rad\nm"


def test_texts_are_cleaned() -> None:
    assert formatting.names([Row(name="a\nb"), Row(name=None)]).cells == [r"a\nb", ""]
