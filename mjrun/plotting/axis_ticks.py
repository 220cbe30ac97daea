"""Ticks of axes: as many as their length has room for, with labels that can be read by themselves."""

import math
from collections.abc import Callable, Iterable, Sequence

from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.ticker import Formatter, Locator, NullLocator

from mjrun.plotting.canvas import DPI, SMALL, Canvas
from mjrun.plotting.ticks import labels_of, linear_ticks, log_ticks

ACROSS, UP = (5.0, 10), (2.3, 8)  # what a tick takes along the axis [em], and how many there are at most
LONGEST = 9  # name of a category on a vertical axis [em]
WHOLE = 8  # categories on a horizontal axis, up to which each has its name


def number_ticks(axis: Axis, em: float, *, whole: bool = False) -> None:
    """Gives an axis ticks at round numbers, or at whole ones alone; its scale is to be set before."""
    axis.set_major_locator(_NumberLocator(axis, em, whole))
    axis.set_major_formatter(_NumberFormatter(axis))
    axis.set_minor_locator(NullLocator())


def category_ticks(axis: Axis, names: Sequence[str], canvas: Canvas) -> None:
    """Gives an axis ticks at 0, 1, 2, …, with the names of categories, or some of them where they have no room."""
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
    """The length of an axis [pixels]."""
    box = axis.axes.get_window_extent()
    return (box.width if isinstance(axis, XAxis) else box.height) * DPI / axis.axes.figure.dpi


class _NumberLocator(Locator):
    """Ticks at round numbers within the range of an axis.

    Args:
      em: size of letters [pixels].
      whole: whether they are at whole numbers alone.
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


class _NumberFormatter(Formatter):
    """Labels of all ticks of an axis, which have the digits that they need together."""

    def __init__(self, axis: Axis) -> None:
        self._of = axis

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self.format_ticks([x])[0]

    def format_ticks(self, values: Iterable[float]) -> list[str]:
        return labels_of(list(values), *sorted(self._of.get_view_interval()), log=self._of.get_scale() == "log")


class _CategoryLocator(Locator):
    """Ticks at every k-th of `count` categories, each of which needs some room [pixels]."""

    def __init__(self, axis: Axis, count: int, needed: float) -> None:
        self._of, self._count, self._needed = axis, count, needed

    def __call__(self) -> Sequence[float]:
        return range(0, self._count, max(1, math.ceil(self._needed * self._count / axis_length(self._of))))


class _CategoryFormatter(Formatter):
    """Names of categories.

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
