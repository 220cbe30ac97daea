"""Figures that follow a page: light on light ground, dark on dark."""

import re

from mjrun.palette import Colour
from mjrun.plotting.theme import THEMES, Theme

LIGHT, DARK = THEMES["light"], THEMES["dark"]
_HEX = re.compile(r"#[0-9a-f]{6}\b")


def adaptive(svg: str) -> str:
    """A figure in the light style with variables for its colours, which `theme_style` declares."""
    names = {_hex(colour): name for name, colour in reversed(_colours(LIGHT).items())}
    return _HEX.sub(lambda found: f"var({names[found[0]]})" if found[0] in names else found[0], svg)


def theme_style() -> str:
    """The variables of `adaptive`: those of the light style, and on dark screens those of the dark one."""
    dark = f"@media screen and (prefers-color-scheme: dark) {{\n  {_declared(DARK)}\n}}"
    return f"{_declared(LIGHT)}\n{dark}\n"


def _declared(theme: Theme) -> str:
    return ":root {" + "".join(f" {name}: {_hex(colour)};" for name, colour in _colours(theme).items()) + " }"


def _colours(theme: Theme) -> dict[str, Colour]:
    plain = {"ground": theme.ground, "ink": theme.ink, "grey": theme.grey, "grid": theme.grid, "zero": theme.zero}
    curves = {f"curve-{index}": colour for index, colour in enumerate(theme.curves)}
    return {f"--figure-{name}": colour for name, colour in (plain | curves).items()}


def _hex(colour: Colour) -> str:
    return "#" + "".join(f"{part:02x}" for part in colour)
