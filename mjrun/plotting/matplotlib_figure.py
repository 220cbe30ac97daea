"""A figure that matplotlib lays out: its style, and text that fits and that its font supports."""

from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from typing import Any

import matplotlib
import numpy as np
from matplotlib import font_manager
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mjrun.errors import clean
from mjrun.palette import Colour
from mjrun.plotting.figure_data import DPI, POINT, PanelGrid
from mjrun.plotting.theme import Theme

FONT = "DejaVu Sans"  # part of matplotlib: Latin, Greek, Cyrillic and symbols
LONGEST = 200  # maximum number of letters of a text that is shortened
SMALL = 0.92  # size of letters of ticks and keys [em]
TITLE = 1.25  # size of letters of a figure's title [em]


@contextmanager
def settings(theme: Theme, em: float) -> Generator[None]:
    """Applies mjrun's style to matplotlib, with letters of `em` pixels, instead of the user's settings."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rc("font", family=[FONT])
        matplotlib.rc("text", parse_math=False, usetex=False)  # `$` and `_` in names are literal
        matplotlib.rc("path", simplify=False)  # curves are already reduced, without loss
        matplotlib.rc("svg", fonttype="none", hashsalt="mjrun")  # text remains text, and identifiers are reproducible
        matplotlib.rc("pdf", fonttype=42)
        matplotlib.rcParams.update(_style(theme, em * POINT))
        yield


def _style(theme: Theme, em: float) -> dict[Any, Any]:
    """Returns matplotlib's settings for a theme, with letters of `em` points."""
    ink, grey = rgb(theme.ink), rgb(theme.grey)
    hair = max(0.8 * POINT, em / 16)
    ticks: dict[str, Any] = {"major.size": 0, "major.pad": 0.35 * em, "labelsize": SMALL * em, "color": grey}
    ticks |= {"minor.size": 0.2 * em, "minor.width": hair}
    return {
        "figure.facecolor": rgb(theme.ground),
        "figure.titlesize": TITLE * em,
        "figure.titleweight": "bold",
        "text.color": ink,
        "axes.facecolor": "none",
        "axes.edgecolor": rgb(theme.zero),
        "axes.linewidth": hair,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.axisbelow": True,
        "axes.labelcolor": ink,
        "axes.labelsize": em,
        "axes.labelpad": 0.3 * em,
        "axes.titlecolor": ink,
        "axes.titlelocation": "left",
        "axes.titlesize": em,
        "axes.titlepad": 0.4 * em,
        "axes.xmargin": 0,
        "grid.color": rgb(theme.grid),
        "grid.linewidth": hair,
        "hatch.linewidth": hair,
        "lines.linewidth": max(1.25 * POINT, 0.125 * em) * theme.weight,
        "lines.dash_capstyle": "butt",
        "lines.solid_capstyle": "round",
        "lines.solid_joinstyle": "round",
        "legend.fontsize": SMALL * em,
        "legend.frameon": False,
        "legend.borderpad": 0.2,
        "legend.borderaxespad": 0.7,
        "legend.handlelength": 1.6,
        "legend.handletextpad": 0.45,
        "legend.columnspacing": 1.6,
        **{f"{axis}tick.{key}": value for axis in "xy" for key, value in ticks.items()},
    }


class FigureLayout:
    """A figure whose axes matplotlib places once all their parts are present.

    To be created and saved within `settings`.

    Args:
      any_letter: whether letters missing in the font are kept, for a viewer with other fonts.

    Attributes:
      width, height: the size of the figure [pixels].
      em: size of letters [pixels].
      hair, weight: widths of thin lines and of curves [points].
    """

    def __init__(self, grid: PanelGrid, theme: Theme, any_letter: bool = False) -> None:
        (self.width, self.height), self.em = grid.size, grid.em
        self.theme, self._any_letter = theme, any_letter
        self.hair: float = matplotlib.rcParams["axes.linewidth"]
        self.weight: float = matplotlib.rcParams["lines.linewidth"]
        self.figure = Figure(figsize=(self.width / DPI, self.height / DPI), dpi=DPI)
        pads = {"w_pad": 0.7 * self.em / DPI, "h_pad": 0.5 * self.em / DPI, "wspace": 0, "hspace": 0}
        margin = 0.5 * self.em / np.array([self.width, self.height])
        self.figure.set_layout_engine("constrained", rect=(*margin, *(1 - 2 * margin)), **pads)
        self._agg = FigureCanvasAgg(self.figure)

    def pixels(self) -> np.ndarray:
        """Renders the figure: `(height, width, 3)` uint8."""
        self._agg.draw()
        return np.ascontiguousarray(np.asarray(self._agg.buffer_rgba())[:, :, :3])

    def settle(self, title: str = "") -> None:
        """Places all axes at whole pixels, and fits the texts above and below them into their room."""
        heading = self.figure.suptitle(self.shown(title), x=0, ha="left") if title else None
        engine = self.figure.get_layout_engine()
        assert engine
        engine.execute(self.figure)
        self.figure.set_layout_engine("none")
        size = np.array([self.width, self.height])
        panels = [axes for axes in self.figure.axes if axes.get_subplotspec()]  # without colour bars
        for axes in self.figure.axes:
            place = axes.get_position()
            axes.set_position((*np.round(place.p0 * size) / size, *np.round(place.size * size) / size))
        boxes = [axes.get_window_extent() for axes in panels]
        for axes, box in zip(panels, boxes, strict=True):
            end = min((other.x0 for other in boxes if other.x0 > box.x1), default=self.width) - 0.7 * self.em
            axes.set_title(self.fitted(axes.get_title("left"), end - box.x0, self.em))
            axes.set_xlabel(self.fitted(axes.get_xlabel(), box.width, self.em))
            axes.set_ylabel(self.fitted(axes.get_ylabel(), box.height, self.em))
        if heading:
            left = min(box.x0 for box in boxes)
            heading.set_x(left / self.width)
            heading.set_text(self.fitted(title, self.width - left - self.em, TITLE * self.em, bold=True))

    def measure(self, text: str, size: float, *, bold: bool = False) -> float:
        """Returns the width of a text [pixels]."""
        weight = "bold" if bold else "normal"
        font = font_manager.FontProperties(family=FONT, size=size * POINT, weight=weight)
        return float(self._agg.get_renderer().get_text_width_height_descent(_drawable(text), font, False)[0])

    def fitted(self, text: str, room: float, size: float, *, bold: bool = False) -> str:
        """Returns `text` as shown in `room` [pixels], with part of its middle omitted if necessary."""
        text = self.shown(text)
        if self.measure(text, size, bold=bold) <= room:
            return text
        for length in range(min(len(text), LONGEST), 1, -1):
            head = length // 3
            short = f"{text[:head]}…{text[len(text) - (length - head) :]}"
            if self.measure(short, size, bold=bold) <= room:
                return short
        return text[:1]

    def shown(self, text: str) -> str:
        """Returns a text as it can be drawn: cleaned, with missing letters replaced by their number, `\\u4f4d`."""
        return clean(text) if self._any_letter else _drawable(clean(text))


def curve_line(theme: Theme, colour: int, variant: int = 0, opacity: float = 1.0) -> Line2D:
    """Returns an empty line in the style of a curve."""
    line = Line2D([], [], color=rgb(theme.colour(colour)), alpha=opacity)
    if pattern := theme.pattern(colour, variant):
        line.set_linestyle((0, pattern))
    return line


def rgb(colour: Colour) -> tuple[float, float, float]:
    """Returns a colour in matplotlib's format."""
    return colour[0] / 255, colour[1] / 255, colour[2] / 255


def _drawable(text: str) -> str:
    letters = _letters()
    return "".join(c if ord(c) in letters else c.encode("ascii", "backslashreplace").decode() for c in text)


@cache
def _letters() -> frozenset[int]:
    """Returns the code points that the font has."""
    return frozenset(font_manager.get_font(font_manager.findfont(FONT)).get_charmap())
