"""The appearance of figures: the colours of each style, and line patterns for curves of the same colour.

Figures in a page follow its colour scheme: light on a light background, dark on a dark one.
"""

import re

from mjrun.dataclass import dataclass
from mjrun.palette import ON_DARK, ON_LIGHT, Colour, css

SOLID = ()
# Lengths of dashes and gaps, in widths of the line.
PATTERNS: tuple[tuple[float, ...], ...] = (
    SOLID,
    (4, 1.6),
    (1.1, 1.3),
    (6, 1.5, 1.1, 1.5),
    (9, 2.5),
    (3, 1, 1, 1, 1, 1),
)


@dataclass(frozen=True)
class Theme:
    """The colours and lines of a style.

    Attributes:
      ground, ink, grey, grid, zero: colours of the background, of text, of secondary text, of the grid, and of its
        line at zero.
      curves: colours of curves, in order.
      dashed: whether curves of different colours also have different patterns.
      weight: width of lines, as a share of the usual width.
    """

    ground: Colour
    ink: Colour
    grey: Colour
    grid: Colour
    zero: Colour
    curves: tuple[Colour, ...]
    dashed: bool = False
    weight: float = 1.0

    def colour(self, index: int) -> Colour:
        """Returns the colour of a curve."""
        return self.curves[index % len(self.curves)]

    def pattern(self, index: int, variant: int = 0) -> tuple[float, ...]:
        """Returns the pattern of a curve, a new one when the colours repeat; `variant` selects a later one."""
        rounds = index // len(self.curves)
        first = index + rounds if self.dashed else rounds
        return PATTERNS[(first + variant) % len(PATTERNS)]


THEMES = {
    "light": Theme((255, 255, 255), (31, 35, 40), (98, 106, 118), (230, 233, 238), (176, 183, 194), ON_LIGHT),
    "dark": Theme((14, 15, 18), (242, 243, 245), (166, 170, 178), (42, 44, 50), (92, 96, 104), ON_DARK),
    "print": Theme((255, 255, 255), (0, 0, 0), (60, 60, 60), (215, 215, 215), (140, 140, 140), ON_LIGHT, True, 1.15),
}
_HEX = re.compile(r"#[0-9a-f]{6}\b")


def adaptive(svg: str) -> str:
    """Replaces the colours of a figure in the light style by variables, which `theme_style` declares."""
    names = {css(colour): name for name, colour in reversed(_colours(THEMES["light"]).items())}
    return _HEX.sub(lambda match: f"var({names[match[0]]})" if match[0] in names else match[0], svg)


def theme_style() -> str:
    """Declares the variables of `adaptive`: the light style's, and on dark screens the dark style's."""
    dark = f"@media screen and (prefers-color-scheme: dark) {{\n  {_declared(THEMES['dark'])}\n}}"
    return f"{_declared(THEMES['light'])}\n{dark}\n"


def _declared(theme: Theme) -> str:
    return ":root {" + "".join(f" {name}: {css(colour)};" for name, colour in _colours(theme).items()) + " }"


def _colours(theme: Theme) -> dict[str, Colour]:
    plain = {"ground": theme.ground, "ink": theme.ink, "grey": theme.grey, "grid": theme.grid, "zero": theme.zero}
    curves = {f"curve-{index}": colour for index, colour in enumerate(theme.curves)}
    return {f"--figure-{name}": colour for name, colour in (plain | curves).items()}
