"""A sheet of pixels on which matplotlib draws: its settings, and text that fits and that its font has."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import matplotlib
import numpy as np
from matplotlib import font_manager
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mjrun.errors import clean
from mjrun.palette import Colour
from mjrun.plotting.theme import Theme

DPI = 96  # pixels per inch, as in CSS, so that sizes in an svg are those asked for
POINT = 72 / DPI  # [points per pixel]
FONT = "DejaVu Sans"  # which comes with matplotlib: Latin, Greek, Cyrillic and symbols
LONGEST = 200  # letters of a text that is too wide, of which some are shown


@contextmanager
def settings() -> Iterator[None]:
    """Matplotlib with our settings, and none of the user's, which would make other pictures elsewhere."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rc("font", family=[FONT])
        matplotlib.rc("text", parse_math=False, usetex=False)  # `$` and `_` in names are themselves
        matplotlib.rc("path", simplify=False)  # done already, without loss
        matplotlib.rc("svg", fonttype="none", hashsalt="mjrun")  # text stays text, and identifiers stay the same
        matplotlib.rc("pdf", fonttype=42)
        yield


class Canvas:
    """A figure whose places are in pixels from its top left, as text sizes and widths of lines are in pixels.

    Args:
      size: width and height [pixels].
      any_letter: whether letters that the font does not have are left as they are, for whoever shows them.
    """

    def __init__(self, size: tuple[int, int], theme: Theme, any_letter: bool) -> None:
        self.width, self.height = size
        self.theme, self._any_letter = theme, any_letter
        self.figure = Figure(figsize=(self.width / DPI, self.height / DPI), dpi=DPI, facecolor=rgb(theme.ground))
        self._agg = FigureCanvasAgg(self.figure)

    def pixels(self) -> np.ndarray:
        """What is drawn: `(height, width, 3)` uint8."""
        self._agg.draw()
        return np.ascontiguousarray(np.asarray(self._agg.buffer_rgba())[:, :, :3])

    def box(self, left: float, top: float, right: float, bottom: float) -> tuple[float, float, float, float]:
        """A rectangle as matplotlib places axes."""
        across, up = (right - left) / self.width, (bottom - top) / self.height
        return left / self.width, 1 - bottom / self.height, across, up

    def text(
        self, text: str, x: float, y: float, size: float, colour: Colour, *, bold: bool = False, plate: bool = False
    ) -> None:
        """Writes `text`, as `fitted` returns it, from x on with its middle at y; on a `plate` of the ground."""
        face = {"facecolor": rgb(self.theme.ground), "edgecolor": "none", "alpha": 0.8, "pad": 0.1 * size}
        self.figure.text(
            x / self.width,
            1 - y / self.height,
            text,
            fontsize=size * POINT,
            va="center_baseline",
            ha="left",
            weight="bold" if bold else "normal",
            color=rgb(colour),
            bbox=face if plate else None,
            zorder=5,
        )

    def line(self, line: Line2D, x: float, y: float, length: float) -> None:
        """Draws a horizontal line that looks like `line`."""
        line.set_transform(self.figure.transFigure)
        line.set_data([x / self.width, (x + length) / self.width], [1 - y / self.height] * 2)
        self.figure.add_artist(line)

    def measure(self, text: str, size: float, *, bold: bool = False) -> float:
        """The width of a text [pixels]."""
        weight = "bold" if bold else "normal"
        font = font_manager.FontProperties(family=FONT, size=size * POINT, weight=weight)
        return float(self._agg.get_renderer().get_text_width_height_descent(_drawable(text), font, False)[0])

    def fitted(self, text: str, room: float, size: float, *, bold: bool = False) -> str:
        """`text` as it is shown in `room` [pixels]: some of its middle is left out if need be."""
        text = self.shown(text)
        if self.measure(text, size, bold=bold) <= room:
            return text
        for kept in range(min(len(text), LONGEST), 1, -1):
            head = kept // 3
            short = f"{text[:head]}…{text[len(text) - (kept - head) :]}"
            if self.measure(short, size, bold=bold) <= room:
                return short
        return text[:1]

    def shown(self, text: str) -> str:
        """A text as it can be drawn: cleaned, and what the font does not have as its number, `\\u4f4d`."""
        return clean(text) if self._any_letter else _drawable(clean(text))


def rgb(colour: Colour) -> tuple[float, float, float]:
    """A colour as matplotlib has them."""
    return colour[0] / 255, colour[1] / 255, colour[2] / 255


def _drawable(text: str) -> str:
    letters = _letters()
    return "".join(c if ord(c) in letters else c.encode("ascii", "backslashreplace").decode() for c in text)


@cache
def _letters() -> frozenset[int]:
    """The letters of the font."""
    return frozenset(font_manager.get_font(font_manager.findfont(FONT)).get_charmap())
