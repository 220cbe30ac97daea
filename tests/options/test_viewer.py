"""The options of a live view say where it is, and take what they say."""

from fractions import Fraction

import pytest

from mjrun.errors import BadValueError
from mjrun.options.option import FrontEnd, options_of
from mjrun.options.viewer import ViewerOptions


def test_values_are_checked_and_exact() -> None:
    assert ViewerOptions(speed="1/3").speed == Fraction(1, 3)  # type: ignore[arg-type]
    assert ViewerOptions().browser is None
    for wrong in ({"speed": 0}, {"port": 0}, {"port": 70000}, {"browser": "firefox"}):
        with pytest.raises(BadValueError):
            ViewerOptions(**wrong)  # type: ignore[arg-type]


def test_no_document_can_open_a_window() -> None:
    assert not any(FrontEnd.DOCUMENT in each.places for each in options_of(ViewerOptions))
