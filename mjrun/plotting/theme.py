"""How figures look: the colours of a style, and the patterns of lines that have the same colour."""

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
