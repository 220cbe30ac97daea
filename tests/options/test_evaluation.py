"""Options of `mjrun eval`."""

import pytest

from mjrun.options.evaluation import LowestValuesKind
from mjrun.options.schema_validation import InvalidValueError


@pytest.mark.parametrize(
    ("text", "expected"),
    [("success=90%", ("success", 0.9)), ("return=-200", ("return", -200.0)), ("success_low=0.8", ("success_low", 0.8))],
)
def test_a_threshold_is_a_number_or_a_percentage(text: str, expected: tuple[str, float]) -> None:
    name, (number,) = LowestValuesKind().parse(text)
    assert (name, number) == expected


@pytest.mark.parametrize("text", ["0.9", "success", "=3", "success=most", "success=nan", "success=1,2", "a=%"])
def test_anything_else_is_none(text: str) -> None:
    with pytest.raises(InvalidValueError, match=r"success=90% or return=200"):
        LowestValuesKind().parse(text)
