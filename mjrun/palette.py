"""Colours of curves that remain distinguishable in print and for colour-blind readers.

The hues of M. Okabe and K. Ito, "Color Universal Design", 2008, moved apart as far as protanopes and deuteranopes see
them, and darker on light ground. They are in the order in which they are used.
"""

Colour = tuple[int, int, int]

ON_LIGHT: tuple[Colour, ...] = (
    (0, 72, 175),  # blue
    (190, 76, 12),  # vermilion
    (25, 130, 112),  # bluish green
    (222, 78, 182),  # reddish purple
    (206, 146, 16),  # orange
    (58, 150, 255),  # sky blue
)
ON_DARK: tuple[Colour, ...] = (
    (60, 182, 255),  # sky blue
    (250, 173, 30),  # orange
    (5, 164, 117),  # bluish green
    (255, 114, 189),  # reddish purple
    (222, 247, 100),  # yellow
    (239, 97, 13),  # vermilion
)


def css(colour: Colour) -> str:
    """Returns a colour as CSS and SVG write it: `#0048af`."""
    return "#" + "".join(f"{part:02x}" for part in colour)
