"""No two curves of a panel look the same."""

import pytest

from mjrun.options.plot import STYLES
from mjrun.plotting.theme import PATTERNS, THEMES


def test_every_style_has_a_theme() -> None:
    assert tuple(THEMES) == STYLES


@pytest.mark.parametrize("style", STYLES)
def test_curves_differ_in_colour_or_pattern(style: str) -> None:
    theme = THEMES[style]
    count = len(theme.curves) * len(PATTERNS)
    looks = {(theme.colour(index), theme.pattern(index)) for index in range(count)}
    assert len(looks) == count


def test_on_paper_neighbours_differ_without_colour_too() -> None:
    theme = THEMES["print"]
    assert len({theme.pattern(index) for index in range(6)}) == 6


def test_a_second_column_of_a_table_has_another_pattern() -> None:
    assert THEMES["light"].pattern(0, 1) != THEMES["light"].pattern(0)
