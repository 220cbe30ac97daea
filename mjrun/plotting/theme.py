"""How figures look: the colours of a style, and the patterns of lines that have the same colour.

The figures of a page follow it: light on light ground, dark on dark.
"""

import re
from dataclasses import dataclass

from mjrun.palette import ON_DARK, ON_LIGHT, Colour

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
    """The look of a style.

    Attributes:
      ground, ink, grey, grid, zero: colours of the background, of text, of what is less important, of the grid, and of
        its line at zero.
      curves: their colours, in order.
      dashed: whether curves of different colours have different patterns too.
      weight: width of lines, as a share of the usual one.
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
        """The colour of a curve."""
        return self.curves[index % len(self.curves)]

    def pattern(self, index: int, variant: int = 0) -> tuple[float, ...]:
        """The pattern of a curve, a new one when the colours are used up; `variant` takes one further on."""
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
    """A figure in the light style with variables for its colours, which `theme_style` declares."""
    names = {_hex(colour): name for name, colour in reversed(_colours(THEMES["light"]).items())}
    return _HEX.sub(lambda found: f"var({names[found[0]]})" if found[0] in names else found[0], svg)


def theme_style() -> str:
    """The variables of `adaptive`: those of the light style, and on dark screens those of the dark one."""
    dark = f"@media screen and (prefers-color-scheme: dark) {{\n  {_declared(THEMES['dark'])}\n}}"
    return f"{_declared(THEMES['light'])}\n{dark}\n"


def _declared(theme: Theme) -> str:
    return ":root {" + "".join(f" {name}: {_hex(colour)};" for name, colour in _colours(theme).items()) + " }"


def _colours(theme: Theme) -> dict[str, Colour]:
    plain = {"ground": theme.ground, "ink": theme.ink, "grey": theme.grey, "grid": theme.grid, "zero": theme.zero}
    curves = {f"curve-{index}": colour for index, colour in enumerate(theme.curves)}
    return {f"--figure-{name}": colour for name, colour in (plain | curves).items()}


def _hex(colour: Colour) -> str:
    return "#" + "".join(f"{part:02x}" for part in colour)
