"""Numbers stay exact, sizes are written in two ways, and one of something is a list of one."""

from fractions import Fraction
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from mjrun.document.document_model import Name
from mjrun.document.field_types import Exact, Instant, Numbers, Several, Size, as_tuple, checked_by, suggested
from mjrun.errors import UsageError


def read(annotation: Any, value: object) -> Any:
    return TypeAdapter(annotation).validate_python(value, strict=True)


@given(st.integers(1, 10**12), st.integers(1, 10**12))
def test_a_ratio_is_read_exactly(numerator: int, denominator: int) -> None:
    assert read(Exact, f"{numerator}/{denominator}") == Fraction(numerator, denominator)


@given(st.decimals(min_value="0.000001", max_value=10**9, places=6))
def test_a_decimal_number_is_read_exactly(value: Any) -> None:
    assert read(Exact, str(value)) == Fraction(str(value))
    assert read(Exact, float(value)) == Fraction(repr(float(value)))


@pytest.mark.parametrize("value", [0, -1, "0", "1/0", "fast", True, None, [1], float("inf"), float("nan"), "1e400"])
def test_what_is_no_positive_number_is_refused(value: object) -> None:
    with pytest.raises(ValidationError):
        read(Exact, value)


def test_an_instant_may_be_zero() -> None:
    assert read(Instant, 0) == read(Instant, "0") == 0
    with pytest.raises(ValidationError):
        read(Instant, -1)


@given(st.integers(1, 99999), st.integers(1, 99999))
def test_a_size_is_a_text_or_a_list(width: int, height: int) -> None:
    assert read(Size, f"{width}x{height}") == read(Size, f"{width}X{height}") == (width, height)
    assert read(Size, [width, height]) == (width, height)


@pytest.mark.parametrize(
    "value", ["640", "640x", "0x480", "-1x5", [640], [640, 0], [640, 480.0], [True, True], 5, None]
)
def test_what_is_no_size_is_refused(value: object) -> None:
    with pytest.raises(ValidationError):
        read(Size, value)


def test_one_of_several_is_a_list_of_one() -> None:
    assert as_tuple(read(Several[Name], "a")) == ("a",)
    assert as_tuple(read(Several[Name], ["a", "b"])) == ("a", "b")
    assert as_tuple(read(Several[Name], [])) == ()
    with pytest.raises(ValidationError):
        read(Several[Name], ["a", ""])


def test_numbers_are_one_or_a_list_of_some() -> None:
    assert read(Numbers, 2) == 2
    assert read(Numbers, [1, 0.5]) == [1, 0.5]
    for value in ("2", [], ["a"], True):
        with pytest.raises(ValidationError):
            read(Numbers, value)


def test_a_text_is_checked_by_a_function_and_editors_are_told_what_it_may_be() -> None:
    def check(text: str) -> None:
        if text != "oak":
            raise UsageError(f"no wood {text}")

    adapter = TypeAdapter[str](Annotated[str, checked_by(check), suggested(["oak"])])
    assert adapter.validate_python("oak") == "oak"
    with pytest.raises(ValidationError):
        adapter.validate_python("elm")
    assert adapter.json_schema() == {"type": "string", "enum": ["oak"]}
