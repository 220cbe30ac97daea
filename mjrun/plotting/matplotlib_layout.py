"""A figure that matplotlib lays out: its style, text that fits and that its font supports, ticks of axes."""

import math
from bisect import bisect_left
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import matplotlib
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import Formatter, Locator, NullFormatter, NullLocator

from mjrun.errors import UsageError, clean, option, quoted
from mjrun.palette import Colour
from mjrun.plotting.figure_data import DPI, POINT, AxisScale, PanelGrid
from mjrun.plotting.theme import Theme
from mjrun.plotting.tick_labels import labels_of, linear_ticks, log_ticks

FONT = "DejaVu Sans"  # part of matplotlib: Latin, Greek, Cyrillic and symbols
LONGEST = 200  # maximum number of letters of a text that is shortened
SMALL = 0.92  # size of letters of ticks and keys [em]
TITLE = 1.25  # size of letters of a figure's title [em]
ACROSS, UP = (5.0, 10), (2.3, 8)  # room for a tick along the axis [em], and maximum number of ticks
LONGEST_CATEGORY = 9  # maximum width of a category's name on a vertical axis [em]
DECADES = 8  # maximum number of decades of a logarithmic axis with minor ticks
FEW_DOTS = 50  # maximum number of dots that are large
TURN = 5  # length of the dashes of coinciding curves, in widths of the line
WHOLE = 8  # maximum number of categories on a horizontal axis with all names shown


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
        "axes.titley": 1.0,  # nothing is in its way, which matplotlib would find by measuring all axes
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


class MatplotlibFigure:
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

        def shortened(length: int) -> str:
            head = length // 3
            return f"{text[:head]}…{text[len(text) - (length - head) :]}"

        lengths = range(2, min(len(text), LONGEST) + 1)
        fitting = bisect_left(lengths, True, key=lambda n: self.measure(shortened(n), size, bold=bold) > room)
        return shortened(lengths[fitting - 1]) if fitting else text[:1]

    def shown(self, text: str) -> str:
        """Returns a text as it can be drawn: cleaned, with missing letters replaced by their number, `\\u4f4d`."""
        return clean(text) if self._any_letter else _drawable(clean(text))


def curve_line(
    theme: Theme, colour: int, variant: int = 0, opacity: float = 1.0, turn: tuple[int, int] = (0, 1)
) -> Line2D:
    """Returns an empty line in the style of a curve.

    Args:
      turn: place among the curves that coincide, and their number: their dashes alternate.
    """
    line, (place, count) = Line2D([], [], color=rgb(theme.colour(colour)), alpha=opacity), turn
    if count > 1:
        line.set_linestyle((-place * TURN, (TURN, (count - 1) * TURN)))
    elif pattern := theme.pattern(colour, variant):
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


def dot_size(count: int) -> float:
    """Returns the size of `count` dots that no line joins, as a multiple of the width of lines."""
    return 4.0 if count <= FEW_DOTS else 2.4


def set_scale(canvas: MatplotlibFigure, axes: Axes, name: str, scale: AxisScale) -> None:
    """Sets the range and the ticks of the axis `name`, x or y, from a scale.

    Raises:
      UsageError: its ends are further apart than the largest float.
    """
    if not math.isfinite(scale.high - scale.low):
        raise UsageError(
            f"the values of {quoted(scale.name or name)} are too far apart for an axis\n"
            f"{option(f'{name}lim')} shows those in a narrower range"
        )
    axis = axes.xaxis if name == "x" else axes.yaxis
    axes.set(**{f"{name}scale": "log" if scale.log else "linear", f"{name}lim": (scale.low, scale.high)})
    if scale.categories:
        category_ticks(axis, scale.categories, canvas)
    else:
        number_ticks(axis, canvas.em, whole=scale.whole)


def set_scales(canvas: MatplotlibFigure, axes: Axes, x: AxisScale, y: AxisScale) -> None:
    """Sets both axes of a panel of curves, with a grid and a line at zero."""
    set_scale(canvas, axes, "x", x)
    set_scale(canvas, axes, "y", y)
    axes.grid(True)
    if not y.log and y.low < 0 < y.high:
        axes.axhline(0, color=rgb(canvas.theme.zero), linewidth=canvas.hair, zorder=1)


def number_ticks(axis: Axis, em: float, *, whole: bool = False) -> None:
    """Adds ticks at round numbers, or at whole numbers only, to an axis whose scale is already set."""
    axis.set_major_locator(_NumberLocator(axis, em, whole))
    axis.set_major_formatter(_NumberFormatter(axis))
    axis.set_minor_locator(_MinorLocator(axis) if axis.get_scale() == "log" else NullLocator())
    axis.set_minor_formatter(NullFormatter())


def category_ticks(axis: Axis, names: Sequence[str], canvas: MatplotlibFigure) -> None:
    """Adds ticks at 0, 1, 2, … with the names of categories, or with some of them if they do not all fit."""
    em = canvas.em
    shown = [canvas.shown(name) for name in names]
    if isinstance(axis, YAxis):
        needed, room = 1.5 * em, LONGEST_CATEGORY * em
    else:
        needed = max(canvas.measure(name, SMALL * em) for name in shown) + 0.9 * em if len(names) > WHOLE else 0.0
        room = None

    def fitted(name: str, space: float) -> str:
        return canvas.fitted(name, space - 0.6 * em if room is None else room, SMALL * em)

    axis.set_major_locator(_CategoryLocator(axis, len(names), needed))
    axis.set_major_formatter(_CategoryFormatter(axis, shown, fitted))
    axis.set_minor_locator(NullLocator())


def axis_length(axis: Axis) -> float:
    """Returns the length of an axis [pixels]."""
    box = axis.axes.get_window_extent()
    return (box.width if isinstance(axis, XAxis) else box.height) * DPI / axis.axes.figure.dpi


class _NumberLocator(Locator):
    """A locator of ticks at round numbers within the range of an axis.

    Args:
      em: size of letters [pixels].
      whole: whether ticks are at whole numbers only.
    """

    def __init__(self, axis: Axis, em: float, whole: bool) -> None:
        self._of, self._em, self._whole = axis, em, whole

    def __call__(self) -> Sequence[float]:
        return self.tick_values(*sorted(self._of.get_view_interval()))

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        room, most = ACROSS if isinstance(self._of, XAxis) else UP
        count = min(most, axis_length(self._of) / (room * self._em))
        if self._of.get_scale() == "log":
            return log_ticks(vmin, vmax, count)
        return linear_ticks(vmin, vmax, count, self._whole)


class _MinorLocator(Locator):
    """A locator of minor ticks on a logarithmic axis: 2 to 9 in each decade, unless decades are many."""

    def __init__(self, axis: Axis) -> None:
        self._of = axis

    def __call__(self) -> Sequence[float]:
        return self.tick_values(*sorted(self._of.get_view_interval()))

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        low, high = math.floor(math.log10(vmin)), math.floor(math.log10(vmax))
        if high - low > DECADES:
            return []
        ticks = [digit * 10.0**power for power in range(low, high + 1) for digit in range(2, 10)]
        return [tick for tick in ticks if vmin <= tick <= vmax]


class _NumberFormatter(Formatter):
    """A formatter that gives all ticks of an axis the digits that they need together."""

    def __init__(self, axis: Axis) -> None:
        self._of = axis

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self.format_ticks([x])[0]

    def format_ticks(self, values: Iterable[float]) -> list[str]:
        return labels_of(list(values), *sorted(self._of.get_view_interval()), log=self._of.get_scale() == "log")


class _CategoryLocator(Locator):
    """A locator of ticks at every k-th of `count` categories, each of which needs some room [pixels]."""

    def __init__(self, axis: Axis, count: int, needed: float) -> None:
        self._of, self._count, self._needed = axis, count, needed

    def __call__(self) -> Sequence[float]:
        return range(0, self._count, max(1, math.ceil(self._needed * self._count / axis_length(self._of))))


class _CategoryFormatter(Formatter):
    """A formatter of the names of categories.

    Args:
      fitted: shortens a name for the space between two ticks [pixels].
    """

    def __init__(self, axis: Axis, names: Sequence[str], fitted: Callable[[str, float], str]) -> None:
        self._of, self._names, self._fitted = axis, names, fitted

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self._names[round(x)]

    def format_ticks(self, values: Iterable[float]) -> list[str]:
        shown = [self._names[round(value)] for value in values]
        space = axis_length(self._of) / max(1, len(shown))
        return [self._fitted(name, space) for name in shown]
