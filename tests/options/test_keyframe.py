"""What is said of a keyframe that is saved."""

from mjrun.options.keyframe import LAST_INSTANT, KeyframeOptions
from mjrun.options.option import options_of


def test_a_keyframe_has_a_file_and_a_name() -> None:
    assert {each.name for each in options_of(KeyframeOptions)} == {"output", "name", "manifest"}
    assert KeyframeOptions(None, "a.xml").name == LAST_INSTANT
