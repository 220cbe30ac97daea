"""YAML text is read as the value that was written, with numbers short and exact."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mjrun.document.tree import exact, number
from mjrun.document.yaml_text import yaml_text
from mjrun.errors import UsageError
from mjrun.timeline import rational
from tests.document.camera_strategies import names, positives, texts
from tests.document.documents import Anything, read

exacts = (
    st.fractions(min_value=Fraction(1, 10**6), max_value=10**6)
    | positives
    | positives.map(repr)
    | st.sampled_from(["30000/1001", "1e2", Fraction(2**53 + 1), Fraction(1, 10)])
)

values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats(allow_nan=False, allow_infinity=False) | texts,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(names, inner, max_size=4),
    max_leaves=12,
)


@given(values)
@example(["a" * 150, "b c " * 60, {"d" * 200: ["e  f " * 60]}])
@settings(max_examples=75, deadline=None)
def test_yaml_text_is_read_as_what_was_written(value: Any) -> None:
    Path("d.yaml").write_text(yaml_text({"a": value}), encoding="utf-8")
    assert read("d.yaml", Anything).a == value


def is_some_float(value: Fraction) -> bool:
    """Whether a float prints as `value`."""
    try:
        return Fraction(repr(float(value))) == value
    except OverflowError:
        return False


@given(exacts | st.just(Fraction(10**400)))
def test_exact_numbers_are_numbers_where_that_is_exact(value: Any) -> None:
    found = exact(value)
    assert rational(found) == rational(value)
    assert isinstance(found, str) != is_some_float(rational(value))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1"), (0.1, "0.1"), (-0.0, "0"), (1e16, "1e+16"), (1e-5, "1e-05"), ("60", "60"),
        (Fraction(1, 4), "0.25"), (Fraction(1, 3), "1/3"), (Fraction(30000, 1001), "30000/1001"),
        (Fraction(2**53 + 1), "'9007199254740993'"),
    ],
)  # fmt: skip
def test_numbers_are_as_short_as_they_are_exact(value: Any, text: str) -> None:
    assert yaml_text({"a": exact(value)}) == f"a: {text}\n"


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_numbers_that_are_not_finite_are_not_printed(value: float) -> None:
    with pytest.raises(UsageError, match=f"^a document cannot contain the number {value}; numbers must be finite$"):
        number(value)
