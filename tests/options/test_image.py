"""Options of images."""

from fractions import Fraction

import pytest

from mjrun.errors import BadValueError, UsageError
from mjrun.options.image import ImageOptions


def test_an_instant_is_said_once() -> None:
    with pytest.raises(UsageError, match=r"^time and step exclude each other: both say when"):
        ImageOptions(None, "a.png", time=1, step=2)


def test_a_time_is_exact_from_zero_on_and_events_pass_to_the_image() -> None:
    event = object()
    assert ImageOptions(None, "a.png", time=0.1).time == Fraction(1, 10)
    assert ImageOptions(None, "a.png", time=0).time == 0
    assert ImageOptions(None, "a.png", time=event).time is event
    with pytest.raises(BadValueError, match=r"^time: '-1' is not a number from 0 on"):
        ImageOptions(None, "a.png", time=-1)


def test_only_yes_and_no_are_yes_and_no() -> None:
    with pytest.raises(BadValueError, match=r"^legend: '1' is not true or false"):
        ImageOptions(None, "a.png", legend=1)  # type: ignore[arg-type]
