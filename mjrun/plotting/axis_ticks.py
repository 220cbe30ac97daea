"""Ticks of axes: as many as their length has room for, with self-contained labels."""

import math
from collections.abc import Callable, Iterable, Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.ticker import Formatter, Locator, NullFormatter, NullLocator

from mjrun.plotting.figure_data import DPI, ParameterAxis
from mjrun.plotting.matplotlib_figure import SMALL, FigureLayout, rgb
from mjrun.plotting.tick_labels import labels_of, linear_ticks, log_ticks

ACROSS, UP = (5.0, 10), (2.3, 8)  # room for a tick along the axis [em], and maximum number of ticks
LONGEST = 9  # maximum width of a category's name on a vertical axis [em]
DECADES = 8  # maximum number of decades of a logarithmic axis with minor ticks
WHOLE = 8  # maximum number of categories on a horizontal axis with all names shown


def set_scale(canvas: FigureLayout, axes: Axes, name: str, scale: ParameterAxis, *, whole: bool = False) -> None:
    """Sets the range and the ticks of the axis `name`, x or y, from a scale; `whole` limits ticks to whole numbers."""
    axis = axes.xaxis if name == "x" else axes.yaxis
    axes.set(**{f"{name}scale": "log" if scale.log else "linear", f"{name}lim": (scale.low, scale.high)})
    if scale.categories:
        category_ticks(axis, scale.categories, canvas)
    else:
        number_ticks(axis, canvas.em, whole=whole)


def set_scales(canvas: FigureLayout, axes: Axes, x: ParameterAxis, y: ParameterAxis, *, whole: bool = False) -> None:
    """Sets both axes of a panel of curves, with a grid and a line at zero; `whole` limits the ticks of y."""
    set_scale(canvas, axes, "x", x)
    set_scale(canvas, axes, "y", y, whole=whole)
    axes.grid(True)
    if not y.log and y.low < 0 < y.high:
        axes.axhline(0, color=rgb(canvas.theme.zero), linewidth=canvas.hair, zorder=1)


def number_ticks(axis: Axis, em: float, *, whole: bool = False) -> None:
    """Adds ticks at round numbers, or at whole numbers only, to an axis whose scale is already set."""
    axis.set_major_locator(_NumberLocator(axis, em, whole))
    axis.set_major_formatter(_NumberFormatter(axis))
    axis.set_minor_locator(_MinorLocator(axis) if axis.get_scale() == "log" else NullLocator())
    axis.set_minor_formatter(NullFormatter())


def category_ticks(axis: Axis, names: Sequence[str], canvas: FigureLayout) -> None:
    """Adds ticks at 0, 1, 2, … with the names of categories, or with some of them if they do not all fit."""
    em = canvas.em
    shown = [canvas.shown(name) for name in names]
    if isinstance(axis, YAxis):
        needed, room = 1.5 * em, LONGEST * em
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
