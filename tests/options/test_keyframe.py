"""What is said of a keyframe that is saved."""

import pytest

from mjrun.errors import UsageError
from mjrun.options.keyframe import LAST_INSTANT, KeyframeOptions
from mjrun.options.option import options_of


def test_a_keyframe_has_a_file_and_a_name() -> None:
    assert {each.name for each in options_of(KeyframeOptions)} == {"output", "name", "time", "step", "manifest"}
    assert KeyframeOptions(None, "a.xml").name == LAST_INSTANT


def test_the_instant_is_said_once() -> None:
    with pytest.raises(UsageError, match=r"^time and step exclude each other: both say when"):
        KeyframeOptions(None, "a.xml", time=1, step=3)
