"""Colours of a figure that follows its page are those of the two styles."""

import re

from mjrun.plotting.page_theme import adaptive, theme_style
from mjrun.plotting.theme import THEMES, Theme


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
