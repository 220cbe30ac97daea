"""No two curves of a panel look the same."""

import re

import pytest

from mjrun.options.plot import STYLES
from mjrun.plotting.theme import PATTERNS, THEMES, Theme, adaptive, theme_style


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


def shown(svg: str, declarations: str) -> str:
    """What a browser shows: variables are what was declared last."""
    values = dict(re.findall(r"(--[\w-]+): (#\w+);", declarations))
    return re.sub(r"var\((--[\w-]+)\)", lambda found: values[found[1]], svg)


def colours(theme: Theme) -> list[str]:
    every = [theme.ground, theme.ink, theme.grey, theme.grid, theme.zero, *theme.curves]
    return ["#{:02x}{:02x}{:02x}".format(*colour) for colour in every]


def test_a_light_figure_is_itself_on_light_ground_and_the_dark_one_on_dark() -> None:
    light, dark = ("; ".join(colours(THEMES[style])) for style in ("light", "dark"))
    figure, style = adaptive(light), theme_style()
    assert "#" not in figure
    assert shown(figure, style.partition("@media")[0]) == light
    assert shown(figure, style) == dark


def test_other_colours_stay() -> None:
    assert adaptive("fill: #123456; d: #ffffffff") == "fill: #123456; d: #ffffffff"
