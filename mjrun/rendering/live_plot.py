"""A small live plot of values over time, drawn frame by frame beside or under a video."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw

from mjrun.dataclass import dataclass
from mjrun.palette import ON_DARK
from mjrun.rendering.colormaps import figures, segmentation_palette, ticks
from mjrun.rendering.text import (
    BACKGROUND,
    INK,
    LINE,
    baseline,
    blend,
    crisp,
    fitted,
    fitted_ends,
    letters,
    rounded,
    width_of,
    write,
)

_GREY = (166, 170, 178)  # of marks and units
_GRID, _ZERO, _FAINT, _HAIR = 22, 64, 70, 120  # opacities, of 255
_SAMPLES = 4  # factor by which lines are drawn larger before averaging
_LARGEST = 1e200  # larger values count as infinite, and values below the inverse as zero
_FLATTEST = 1e-4  # the smallest range of an axis, as a share of the largest value
# Stages of shortening a legend until it fits: the width of names [em], and whether units are shown.
_SHORTER = ((40, True), (14, True), (14, False), (9, False), (6, False), (4, False))


def live_plot_size(size: tuple[int, int], side: str = "under") -> tuple[int, int]:
    """Returns the width and height of a live plot that suits a video of a size (width, height)."""
    width, height = size
    if side == "under":
        return width, max(80, 2 * round(0.13 * height))
    return max(160, 2 * round(0.2 * width)), height


@dataclass(frozen=True)
class Axes:
    """The positions of times and values in an image.

    Attributes:
      box: left, top, right and bottom edge of the plot [pixels].
      times, values: the values at its edges.
    """

    box: tuple[int, int, int, int]
    times: tuple[float, float]
    values: tuple[float, float]

    def x(self, time: float | np.ndarray) -> np.ndarray:
        """Returns pixels from the left edge of the image; times outside are moved to the nearest edge."""
        share = (np.asarray(time) - self.times[0]) / (self.times[1] - self.times[0])
        return self.box[0] + np.clip(share, 0, 1) * (self.box[2] - self.box[0])

    def y(self, value: float | np.ndarray) -> np.ndarray:
        """Returns pixels from the top of the image."""
        share = (np.asarray(value) - self.values[0]) / (self.values[1] - self.values[0])
        return self.box[3] - share * (self.box[3] - self.box[1])


@dataclass(frozen=True)
class _LegendEntry:
    """An entry of the legend: where it begins, where its value ends [pixels; 0: not shown], and its row.

    Without a name it consists of `unit` alone.
    """

    name: str
    unit: str
    colour: tuple[int, int, int]
    x: float = 0.0
    end: float = 0.0
    row: int = 0


class LivePlot:
    """Curves over time in fixed axes, of which `draw` shows an instant.

    All series share the vertical axis. As many as fit are named, with their values.

    Args:
      times: ascending [s], `(n,)`, at least one.
      values: `(n, k)`; values that are not finite are gaps.
      names, units: the names and the units of the k series.
      size: width and height of the image [pixels].
      em: size of the letters [pixels]; the size legible in a video when None.
      left: the minimum distance of the vertical axis from the left edge [pixels].
    """

    def __init__(
        self,
        times: np.ndarray,
        values: np.ndarray,
        names: Sequence[str],
        units: Sequence[str],
        size: tuple[int, int],
        em: float | None = None,
        left: int = 0,
    ) -> None:
        self._arguments = times, values, names, units, size, em
        self._times = np.asarray(times, float)
        self._values = np.where(np.abs(values) < _LARGEST, values, np.nan)
        self._em = crisp(em or min(0.095 * size[1], size[0] / 28))
        low, high = _padded(self._values)
        self._step = 10.0 ** (math.floor(math.log10(high - low)) - 2)  # a hundredth or less of the range
        colours = _colours(len(names))
        entries = [_LegendEntry(letters(n), letters(u), c) for n, u, c in zip(names, units, colours, strict=True)]
        self._entries = self._legend(entries, size)
        first, last = float(self._times[0]), float(self._times[-1])
        span = first, (last if last > first else first + 1)
        self.axes = Axes(self._box(size, (low, high), left), span, (low, high))
        ground = self._ground(size)
        self._later, self._now = ground, ground.copy()
        for series in reversed(range(len(colours))):  # the first on top
            curve, corner = self._curve(self._values[:, series])
            blend(self._later, (curve * (_FAINT / 255)).astype(np.uint8), *corner, colours[series])
            blend(self._now, curve, *corner, colours[series])
        self._colours = colours

    def draw(self, time: float) -> np.ndarray:
        """Draws the image `(h, w, 3)` uint8 at `time` [s]: curves are bright up to it and faint after."""
        x, (_, top, _, bottom) = float(self.axes.x(time)), self.axes.box
        image = self._later.copy()
        image[:, : round(x)] = self._now[:, : round(x)]
        hair = max(1, round(self._em / 14))
        blend(image, np.full((bottom - top, hair), _HAIR, np.uint8), round(x - hair / 2), top, INK)
        heads = [self.head(series, time) for series in range(len(self._colours))]
        for head, colour in reversed(list(zip(heads, self._colours, strict=True))):
            if math.isfinite(head):
                self._dot(image, x, float(self.axes.y(head)), colour)
        for entry, head in zip(self._entries, heads, strict=False):
            if entry.end and entry.name:
                write(image, self._figures(head), (entry.end, self._baseline(entry.row)), self._em, align=1.0)
        return image

    def moved(self, left: int) -> "LivePlot":
        """Returns the same live plot with its vertical axis at least `left` [pixels] from the left edge."""
        return LivePlot(*self._arguments, left)

    def head(self, series: int, time: float) -> float:
        """Returns the value of a series at `time`, on the line between two samples; nan in a gap."""
        column, times = self._values[:, series], self._times
        after = int(np.searchsorted(times, time))
        if after == 0 or after == len(times) or times[after] == time:
            return float(column[min(after, len(times) - 1)])
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return float(column[after - 1] + share * (column[after] - column[after - 1]))

    def _figures(self, value: float) -> str:
        return letters(figures([value], self._step)[0]) if math.isfinite(value) else "…"

    def _dot(self, image: np.ndarray, x: float, y: float, colour: tuple[int, int, int]) -> None:
        """Draws a disc centred at `x`, `y`, ringed with the background."""
        for radius, tint in ((0.44 * self._em, BACKGROUND), (0.3 * self._em, colour)):
            reach = math.ceil(radius) + 1
            column, row = math.floor(x) - reach, math.floor(y) - reach
            v, u = np.mgrid[: 2 * reach + 1, : 2 * reach + 1] + 0.5
            inside = radius + 0.5 - np.hypot(u - (x - column), v - (y - row))
            blend(image, np.round(np.clip(inside, 0, 1) * 255).astype(np.uint8), column, row, tint)

    def _baseline(self, row: int) -> int:
        """Returns the baseline of a row of the legend [pixels]."""
        line = round(LINE * self._em)
        return baseline(round(0.6 * self._em) + row * line, line, self._em)

    def _legend(self, entries: list[_LegendEntry], size: tuple[int, int]) -> list[_LegendEntry]:
        """Returns the entries that fit, in rows above a plot that remains at least as high as they, and 3.5 lines."""
        lines = size[1] / (LINE * self._em) - 2
        rows = max(1, int(min(lines / 2, lines - 3.5))) if lines > 1 else 0
        placed: list[_LegendEntry] = []
        for room, with_units in _SHORTER:
            placed = list(self._flow(entries, room * self._em, size[0], with_units))
            if not placed or placed[-1].row < rows:
                break
        return self._counted([entry for entry in placed if entry.row < rows], len(entries), size[0])

    def _counted(self, placed: list[_LegendEntry], count: int, width: int) -> list[_LegendEntry]:
        """Returns the entries that leave room for a count of the omitted ones, and an entry with that count."""
        for shown in range(len(placed), 0, -1):
            if shown == count:
                break
            last, more = placed[shown - 1], f"… {count - shown} more"
            x = last.end + width_of(last.unit, self._em) + 1.6 * self._em
            if last.end and x + width_of(more, self._em) <= width - round(0.7 * self._em):
                return [*placed[:shown], _LegendEntry("", more, INK, x, x, last.row)]
        return placed

    def _flow(self, entries: list[_LegendEntry], room: float, width: int, with_units: bool) -> Iterator[_LegendEntry]:
        """Yields the entries, placed in as many rows as they need."""
        em, row, inset = self._em, 0, round(0.7 * self._em)
        units = [f" {entry.unit}" if entry.unit and with_units else "" for entry in entries]
        values = [self._value_width(series) for series in range(len(entries))]
        rooms = [
            min(room, width - 2 * inset - 1.5 * em - value - width_of(unit, em))
            for value, unit in zip(values, units, strict=True)
        ]
        names = _shortened([entry.name for entry in entries], em, rooms)
        pen: float = inset
        for entry, name, value, unit in zip(entries, names, values, units, strict=True):
            after = width_of(unit, em)
            end = pen + 1.5 * em + width_of(name, em) + value
            if end + after > width - inset and pen > inset:
                end, pen, row = end - pen + inset, inset, row + 1
            fits = end + after <= width - inset
            yield replace(entry, name=name, unit=unit, x=pen, end=end if fits else 0.0, row=row)
            pen = end + after + 1.6 * em

    def _value_width(self, series: int) -> float:
        """Returns the width of the widest value of a series, with the space before it [pixels]."""
        finite = self._values[:, series][np.isfinite(self._values[:, series])]
        extremes = [finite.min(), finite.max()] if finite.size else []
        return 0.5 * self._em + max((width_of(self._figures(float(v)), self._em) for v in extremes), default=self._em)

    def _box(self, size: tuple[int, int], values: tuple[float, float], least_left: int) -> tuple[int, int, int, int]:
        """Returns the edges of the plot within the space that legend and tick labels leave."""
        width, height = size
        em, inset = self._em, round(0.7 * self._em)
        rows = self._entries[-1].row + 1 if self._entries else 0
        top = self._baseline(rows - 1) + round(0.85 * em) if rows else inset
        bottom = max(top + 1, height - inset - (round(1.15 * em) if height >= 5 * em else 0))
        self._marks, step = ticks(*values, (values[1] - values[0]) * max(1.45 * em / (bottom - top), 0.12))
        self._labels = [letters(text) for text in figures(self._marks, step)]
        labels = math.ceil(max((width_of(text, em) for text in self._labels), default=0) + 0.5 * em)
        left = max(least_left, inset + labels)
        return left, top, max(left + 1, width - inset - round(0.3 * em)), bottom

    def _ground(self, size: tuple[int, int]) -> np.ndarray:
        """Draws everything that does not change: the grid, its marks, and the names."""
        em, (left, top, right, bottom), (first, last) = self._em, self.axes.box, self.axes.times
        image = np.full((size[1], size[0], 3), BACKGROUND, np.uint8)
        hair = max(1, round(em / 16))
        for mark, text in zip(self._marks, self._labels, strict=True):
            y = round(float(self.axes.y(mark)) - hair / 2)
            opacity = _ZERO if abs(mark) < 1e-12 * max(map(abs, self.axes.values)) else _GRID
            blend(image, np.full((hair, right - left), opacity, np.uint8), left, y, INK)
            write(image, text, (left - 0.5 * em, baseline(y, hair, em)), em, _GREY, align=1.0)
        instants, step = ticks(first, last, (last - first) * max(5 * em / (right - left), 0.09))
        for row, (instant, text) in enumerate(zip(instants, figures(instants, step), strict=True)):
            x = float(self.axes.x(instant))
            blend(image, np.full((bottom - top, hair), _GRID, np.uint8), round(x - hair / 2), top, INK)
            if bottom < size[1] - 1.5 * em:
                text = letters(text) + (" s" if row == len(instants) - 1 else "")
                half = width_of(text, em) / 2
                middle = min(x, size[0] - half - 0.3 * em)
                write(image, text, (middle, baseline(bottom + 0.3 * em, LINE * em, em)), em, _GREY, align=0.5)
        thick = max(2, round(em / 6))
        for entry in self._entries:
            line = self._baseline(entry.row)
            if entry.name:
                mark = rounded(round(em), thick, thick / 2)
                blend(image, mark, round(entry.x), round(line - 0.34 * em - thick / 2), entry.colour)
                write(image, entry.name, (entry.x + 1.5 * em, line), em)
            if entry.end:
                write(image, entry.unit, (entry.end, line), em, _GREY)
        return image

    def _curve(self, values: np.ndarray) -> tuple[np.ndarray, tuple[int, int]]:
        """Returns the coverage of a curve, uint8, and the x, y of its corner in the image."""
        left, top, right, bottom = self.axes.box
        thick = max(1.2, self._em / 8)
        pad = math.ceil(thick)
        canvas = Image.new("L", ((right - left + 2 * pad) * _SAMPLES, (bottom - top + 2 * pad) * _SAMPLES))
        pen = ImageDraw.Draw(canvas)
        width = round(thick * _SAMPLES)
        x = (self.axes.x(self._times) - left + pad) * _SAMPLES - 0.5  # Pillow counts from the centres of pixels
        y = (self.axes.y(values) - top + pad) * _SAMPLES - 0.5
        for run in _runs(np.isfinite(values)):
            points = _thinned(x[run], y[run])
            if len(points) > 1:
                pen.line([*map(tuple, points.tolist())], 255, width, joint="curve")
            for u, v in (points[0], points[-1]):
                pen.ellipse((u - width / 2, v - width / 2, u + width / 2, v + width / 2), 255)
        return np.asarray(canvas.reduce(_SAMPLES)), (left - pad, top - pad)


def aligned(live_plots: Sequence[LivePlot]) -> list[LivePlot]:
    """Returns the live plots with their vertical axes aligned at the distance that the widest tick labels require."""
    left = max((live_plot.axes.box[0] for live_plot in live_plots), default=0)
    return [live_plot if live_plot.axes.box[0] == left else live_plot.moved(left) for live_plot in live_plots]


def _padded(values: np.ndarray) -> tuple[float, float]:
    """Returns the range of an axis: that of the values with a margin."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    span = max(high - low, _FLATTEST * max(abs(low), abs(high)))
    span = span if span > 1 / _LARGEST else 2.0
    return (low + high - 1.1 * span) / 2, (low + high + 1.1 * span) / 2


def _shortened(names: Sequence[str], em: float, rooms: Sequence[float]) -> Sequence[str]:
    """Shortens each of `names` to its room [pixels], dropping its first parts if necessary.

    A name that is still too long loses its end, or its middle where more of the names then differ.
    """
    last = [_last_parts(name, em, room) for name, room in zip(names, rooms, strict=True)]
    cuts = [[cut(name, em, room) for name, room in zip(last, rooms, strict=True)] for cut in (fitted, fitted_ends)]
    return max(cuts, key=lambda cut: len({*cut}))


def _last_parts(name: str, em: float, room: float) -> str:
    """Drops the first parts of a name that is wider than `room` [pixels]."""
    while width_of(name, em) > room and "/" in name:
        name = name.partition("/")[2]
    return name


def _colours(count: int) -> list[tuple[int, int, int]]:
    """Returns a colour for each series."""
    if count <= len(ON_DARK):
        return list(ON_DARK[:count])
    return [(r, g, b) for r, g, b in segmentation_palette(count).tolist()]


def _runs(present: np.ndarray) -> Iterator[slice]:
    """Yields the stretches without a gap."""
    edges = np.flatnonzero(np.diff(present, prepend=False, append=False))
    yield from (slice(a, b) for a, b in edges.reshape(-1, 2).tolist())


def _thinned(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Returns points `(m, 2)` that draw the same line: the first, lowest, highest and last of each pixel column.

    U. Jugel and others, "M4: a visualization-oriented time series data aggregation", 2014.
    """
    starts = np.flatnonzero(np.diff(np.floor(x), prepend=-np.inf))
    if len(x) <= 4 * len(starts):
        return np.column_stack([x, y])
    ends = np.append(starts[1:], len(x)) - 1
    middle = (x[starts] + x[ends]) / 2
    columns = [x[starts], middle, middle, x[ends]]
    rows = [y[starts], np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts), y[ends]]
    return np.column_stack([np.ravel(columns, order="F"), np.ravel(rows, order="F")])
