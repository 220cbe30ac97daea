"""Options of comparisons."""

import pytest

from mjrun.options.diff import ColumnTolerancesKind
from mjrun.options.schema_validation import InvalidValueError


def test_a_tolerance_is_absolute_or_absolute_and_relative() -> None:
    kind = ColumnTolerancesKind()
    assert kind.parse("qvel/*=1e-6") == ("qvel/*", (1e-6,))
    assert kind.parse("a=b=0,1e-3") == ("a=b", (0.0, 1e-3))
    assert kind({"x": 1, "y": [1, 2]}) == {"x": (1.0,), "y": (1.0, 2.0)}


@pytest.mark.parametrize("text", ["x", "x=", "=1", "x=one", "x=-1", "x=1,2,3", "x=nan", "x=1,inf"])
def test_what_is_no_tolerance_is_refused(text: str) -> None:
    with pytest.raises(InvalidValueError):
        ColumnTolerancesKind().parse(text)
