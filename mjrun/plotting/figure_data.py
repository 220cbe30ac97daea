"""The data of a figure: panels of curves as points, with their marks, the ranges of their axes, and their grid.

Any number of samples is reduced to a few points that draw the same curve on a screen, in one pass. Samples are never
dropped at regular intervals, which would lose a spike of a single one. Of each stretch of x the first, lowest, highest
and last value remain: U. Jugel and others, "M4: a visualization-oriented time series data aggregation", 2014. Memory
does not grow with the number of samples, and their division into blocks has no effect.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, counted, option
from mjrun.plotting.curve_syntax import ReferenceLine

GROUP, GROUPS = 8, 4096  # points in a group of a path, and maximum number of groups
FLAT = 1e-9  # range of an axis, as a share of the largest value, below which curves count as constant
MARGIN = 0.06  # above and below curves, as a share of their range
Range = tuple[float, float]


@dataclass(frozen=True)
class CurvePoints:
    """The points of one curve: `x` and `y` `(n,)`; NaN breaks the line."""

    x: np.ndarray
    y: np.ndarray

    def is_same(self, other: "CurvePoints") -> bool:
        """Returns whether two curves are identical, and visible."""
        pairs = ((self.x, other.x), (self.y, other.y))
        return bool(np.isfinite(self.y).any()) and all(np.array_equal(*pair, equal_nan=True) for pair in pairs)


class XRangeFilter:
    """A filter of the samples that lines within a range of x need, with gaps in place of the others.

    The division of the samples into blocks has no effect.
    """

    def __init__(self, low: float, high: float) -> None:
        self._low, self._high = low, high
        self._side: int | None = None  # of the last sample: −1 below the range, 0 within, 1 above
        self._held: tuple[np.ndarray, np.ndarray] | None = None  # the last sample, while it is not needed
        self._is_gap = self._has_begun = False  # whether samples before the held one are left out; whether any is not

    def feed(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the needed samples of `x` `(n,)` and `y` `(n, curves)`; NaN breaks the line."""
        if self._held:
            x, y = np.concatenate([self._held[0], x]), np.concatenate([self._held[1], y])
        if not len(x):
            return x, y
        side = np.where(x < self._low, -1, np.where(x > self._high, 1, 0))
        previous = side[0] if self._held or self._side is None else self._side
        line = (side == 0) | (side != np.concatenate([[previous], side[:-1]]))  # from the sample before
        needed = line | np.append(line[1:], False)
        resumes = needed & ~np.concatenate([[not self._is_gap], needed[:-1]])

        places = np.flatnonzero(needed)
        gaps = np.searchsorted(places, np.flatnonzero(resumes))
        gaps = gaps if self._has_begun else gaps[gaps > 0]
        self._is_gap = not needed[-1] and (self._is_gap if len(x) == 1 else not needed[-2])
        self._held = None if needed[-1] else (x[-1:].copy(), y[-1:].copy())
        self._side, self._has_begun = int(side[-1]), self._has_begun or bool(len(places))
        x, y = x[places], y[places]
        return np.insert(x, gaps, x[gaps]), np.insert(y, gaps, np.nan, axis=0)


class Envelope:
    """The envelope of several curves over one x, whose samples arrive in blocks.

    While x ascends, samples are gathered in bins of x that double in width as x grows. From where x decreases, the
    rest is a path through the plane, in its original order.

    Args:
      curves: number of curves.
      bins: maximum number of bins, a power of two; after all samples, more than half of them span the range of x,
          unless x jumps.
      log: whether bins are of equal ratios of x, which must then be positive, rather than of equal widths.
      breaks: whether a line breaks where x decreases.

    Attributes:
      ascends: whether x has never decreased.
    """

    def __init__(self, curves: int, bins: int, *, log: bool = False, breaks: bool = False) -> None:
        self._bins = _Bins(curves, bins, log)
        self._path = _Path(curves, breaks)
        self.ascends, self._last = True, -np.inf

    def feed(self, x: np.ndarray, y: np.ndarray) -> None:
        """Adds samples: `x` `(n,)`, finite, and `y` `(n, curves)`, NaN for a gap."""
        if self.ascends and len(x):
            back = np.flatnonzero(x < np.append(self._last, x[:-1]))
            first = int(back[0]) if len(back) else len(x)
            self._bins.feed(x[:first], y[:first])
            self._last = float(x[first - 1]) if first else self._last
            if not len(back):
                return
            self.ascends = False
            early = self._bins.release()
            if not early:
                self._path.follow(self._last)
            for samples in early:
                self._path.feed(*samples)
            x, y = x[first:], y[first:]
        self._path.feed(x, y)

    def curves(self) -> list[CurvePoints]:
        """Returns the points of every curve so far."""
        ascending, rest = self._bins.curves(), self._path.curves()
        joined = [
            CurvePoints(np.concatenate([a.x, b.x]), np.concatenate([a.y, b.y]))
            for a, b in zip(ascending, rest, strict=True)
        ]
        return [_without_repetition(points) for points in joined]


class _Bins:
    """Unchanged samples while they are few, then bins of equal width in `key`, which is x or its logarithm."""

    def __init__(self, curves: int, bins: int, log: bool) -> None:
        self._count, self._log, self._first = curves, log, 2 * bins
        self._early: list[tuple[np.ndarray, np.ndarray]] = []
        self._rows = 0
        self._start, self._width = 0.0, 0.0  # of the bins, once used
        self._used = np.zeros(bins, bool)
        self._x = np.full((2, bins), np.nan)  # of the first and the last sample
        self._y = np.empty((0, 0, 0))  # first, lowest, highest, last: (4, bins, curves)

    def feed(self, x: np.ndarray, y: np.ndarray) -> None:
        room = self._first - self._rows
        if room > 0:
            self._early.append((x[:room].copy(), y[:room].copy()))
            self._rows += len(x[:room])
            x, y = x[room:], y[room:]
        if not len(x):
            return
        if not self._y.size:
            self._begin()
        self._gather(x, y)

    def release(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Returns and forgets the samples, unless they are already in bins."""
        early, self._early = self._early, []
        return early

    def curves(self) -> list[CurvePoints]:
        if not self._y.size:
            x = np.concatenate([x for x, _ in self._early]) if self._early else np.empty(0)
            parts = [y for _, y in self._early]
            y = np.concatenate(parts) if parts else np.empty((0, self._count))
            return [CurvePoints(x, y[:, curve]) for curve in range(self._count)]
        begin, end = self._x[:, self._used]
        x = np.stack([begin, (begin + end) / 2, (begin + end) / 2, end])
        points: list[CurvePoints] = []
        for first, low, high, last in np.moveaxis(self._y[:, self._used], 2, 0):
            falls = first > last
            y = np.stack([first, np.where(falls, high, low), np.where(falls, low, high), last])
            points.append(CurvePoints(np.ravel(x, order="F"), np.ravel(y, order="F")))
        return points

    def _begin(self) -> None:
        x = np.concatenate([x for x, _ in self._early])
        y = np.concatenate([y for _, y in self._early])
        key, bins = self._key(x), len(self._used)
        self._start = float(key[0])
        self._width = float(key[-1] - key[0]) / bins or float(np.spacing(abs(self._start) or 1.0))
        self._y = np.full((4, bins, self._count), np.nan)
        self._early = []
        self._gather(x, y)

    def _key(self, x: np.ndarray) -> np.ndarray:
        return np.log10(x) if self._log else x

    def _gather(self, x: np.ndarray, y: np.ndarray) -> None:
        place = self._key(x) - self._start
        with np.errstate(over="ignore"):
            index = np.floor(place / self._width)
            while index[-1] >= len(self._used):
                self._double()
                # Half is exactly what the wider bin gives, unless it is infinite.
                index = np.floor(index / 2 if np.isfinite(index[-1]) else place / self._width)
        starts = np.flatnonzero(np.diff(index, prepend=-1.0))
        ends = np.append(starts[1:], len(x)) - 1
        at = index[starts].astype(int)
        fresh = ~self._used[at]

        self._x[0, at] = np.where(fresh, x[starts], self._x[0, at])
        self._x[1, at] = x[ends]
        first, low, high, last = self._y
        first[at] = np.where(fresh[:, None], y[starts], first[at])
        low[at] = np.fmin(low[at], np.fmin.reduceat(y, starts))
        high[at] = np.fmax(high[at], np.fmax.reduceat(y, starts))
        last[at] = y[ends]
        self._used[at] = True

    def _double(self) -> None:
        """Merges every two bins."""
        self._width *= 2
        even, odd = self._used[::2], self._used[1::2]
        half, rest = len(even), len(self._used) - len(even)
        x_first = np.where(even, self._x[0, ::2], self._x[0, 1::2])
        x_last = np.where(odd, self._x[1, 1::2], self._x[1, ::2])
        self._x = np.concatenate([np.stack([x_first, x_last]), np.full((2, rest), np.nan)], axis=1)

        one, other = self._y[:, ::2], self._y[:, 1::2]
        merged = np.full_like(self._y, np.nan)
        merged[0, :half] = np.where(even[:, None], one[0], other[0])
        merged[1, :half] = np.fmin(one[1], other[1])
        merged[2, :half] = np.fmax(one[2], other[2])
        merged[3, :half] = np.where(odd[:, None], other[3], one[3])
        self._y, self._used = merged, np.concatenate([even | odd, np.zeros(rest, bool)])


class _Path:
    """Samples in their original order, in groups, which are merged pairwise when many; extremes are preserved."""

    def __init__(self, curves: int, breaks: bool) -> None:
        self._breaks, self._last = breaks, np.nan
        self._tails = [np.empty((0, 2)) for _ in range(curves)]  # samples of an incomplete group
        self._trees = [_GroupTree() for _ in range(curves)]

    def follow(self, x: float) -> None:
        """Sets the last x of the line before the path."""
        self._last = x

    def feed(self, x: np.ndarray, y: np.ndarray) -> None:
        if not len(x):
            return
        if self._breaks:
            back = np.flatnonzero(x < np.append(self._last, x[:-1]))
            self._last = float(x[-1])
            x, y = np.insert(x, back, x[back]), np.insert(y, back, np.nan, axis=0)
        for curve, tree in enumerate(self._trees):
            points = np.concatenate([self._tails[curve], np.column_stack([x, y[:, curve]])])
            whole = len(points) // GROUP * GROUP
            tree.add(points[:whole].reshape(-1, GROUP, 2))
            self._tails[curve] = points[whole:]

    def curves(self) -> list[CurvePoints]:
        joined = (np.concatenate([tree.points(), tail]) for tree, tail in zip(self._trees, self._tails, strict=True))
        return [CurvePoints(points[:, 0], points[:, 1]) for points in joined]


class _GroupTree:
    """Groups of points `(n, GROUP, 2)`, each of equally many samples except the last ones."""

    def __init__(self) -> None:
        self._groups = np.empty((0, GROUP, 2))
        self._waiting: list[np.ndarray] = []  # by number of halvings: groups without a partner, 0 or 1

    def add(self, groups: np.ndarray) -> None:
        """Adds groups of samples, in pieces that do not depend on their division into calls."""
        for start in range(0, len(groups), GROUPS):
            piece = groups[start : start + GROUPS]
            for level, waiting in enumerate(self._waiting):
                piece, self._waiting[level] = _halved(np.concatenate([waiting, piece]))
            self._groups = np.concatenate([self._groups, piece])
            while len(self._groups) > GROUPS:
                self._groups, waiting = _halved(self._groups)
                self._waiting.append(waiting)

    def points(self) -> np.ndarray:
        """Returns all points `(n, 2)`, in order."""
        return np.concatenate([self._groups, *reversed(self._waiting)]).reshape(-1, 2)


def _halved(groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merges pairs of groups, keeping ends, middle, extremes and a gap; returns also the group left over."""
    count = len(groups) // 2
    pairs = groups[: 2 * count].reshape(count, 2 * GROUP, 2)
    gap = np.isnan(pairs)
    low, high = np.where(gap, np.inf, pairs).argmin(axis=1), np.where(gap, -np.inf, pairs).argmax(axis=1)
    always = np.tile([0, GROUP, 2 * GROUP - 1], (count, 1))
    indices = np.sort(np.concatenate([always, low, high, gap[:, :, 1].argmax(axis=1)[:, None]], axis=1), axis=1)
    return np.take_along_axis(pairs, indices[:, :, None], axis=1), groups[2 * count :]


def _without_repetition(points: CurvePoints) -> CurvePoints:
    """Removes points that repeat the previous one, and reduces each gap to one NaN."""
    gap = np.isnan(points.y)
    same = np.zeros(len(points.x), bool)
    same[1:] = (points.x[1:] == points.x[:-1]) & (points.y[1:] == points.y[:-1])
    same |= gap & np.concatenate([[True], gap[:-1]])
    return CurvePoints(points.x[~same], points.y[~same])


@dataclass(frozen=True)
class AxisScale:
    """The range of an axis, and whether it is logarithmic or has texts.

    Attributes:
      name: name of the parameter, metric or curves.
      categories: texts, placed at 0, 1, 2, …; empty for numbers.
      whole: whether all values are whole numbers, as seeds and counts are.
    """

    name: str
    low: float
    high: float
    log: bool = False
    categories: Sequence[str] = ()
    whole: bool = False

    def shares(self, values: np.ndarray) -> np.ndarray:
        """Returns the positions of values between the ends of the axis, from 0 to 1."""
        if self.log:
            return np.log(values / self.low) / np.log(self.high / self.low)
        return (values - self.low) / (self.high - self.low)


def scale(
    name: str, values: np.ndarray, *, log: bool = False, categories: Sequence[str] = (), edge: float
) -> AxisScale:
    """Returns the axis with a margin for all finite `values`.

    Equal values are centred, except that all 0 and all 1, which shares often are, have an axis from 0 to 1.
    """
    if categories:
        return AxisScale(name, -0.5, len(categories) - 0.5, categories=categories)
    finite = values[np.isfinite(values) & ((values > 0) | (not log))]
    if not len(finite):
        return AxisScale(name, *((0.1, 10.0, True) if log else (-1.0, 1.0, False)))
    low, high, whole = float(finite.min()), float(finite.max()), are_whole(finite)
    if log:
        return AxisScale(name, *_log_ends(low, high, edge), True, whole=whole)
    largest = max(abs(low), abs(high))
    is_constant = high - low <= FLAT * largest
    if is_constant and low in (0, 1):
        low, high, is_constant = 0.0, 1.0, False
    pad = 0.1 * largest if is_constant else edge * (high - low)
    return AxisScale(name, low - pad, high + pad, whole=whole)


def _log_ends(low: float, high: float, edge: float) -> Range:
    """Returns the ends of a logarithmic axis with a margin, as far as floats reach."""
    ratio = 2.0
    if high > low * (1 + FLAT):
        ratio = (high / low) ** edge
        ratio = ratio if math.isfinite(ratio) else high**edge / low**edge
    return low / ratio or low, min(high * ratio, sys.float_info.max)


def are_whole(values: np.ndarray) -> bool:
    """Returns whether all values that are not NaN are whole numbers."""
    return bool(((values % 1 == 0) | np.isnan(values)).all())


@dataclass(frozen=True)
class DrawnCurve:
    """A curve.

    Attributes:
      name: name in the legend.
      colour: index in the palette.
      variant: variant of the line's pattern, 0 if the colour suffices.
      turn: place among the curves that coincide, and their number: their dashes alternate along one line.
    """

    name: str
    points: CurvePoints
    colour: int
    variant: int = 0
    turn: tuple[int, int] = (0, 1)


def in_turn(curves: Sequence[DrawnCurve]) -> list[DrawnCurve]:
    """Returns curves with their place among those that are identical to them."""
    drawn = list[DrawnCurve]()
    for number, curve in enumerate(curves):
        same = [index for index, other in enumerate(curves) if other.points.is_same(curve.points)]
        drawn.append(replace(curve, turn=(same.index(number), len(same))) if same else curve)
    return drawn


@dataclass(frozen=True)
class DrawnPanel:
    """A panel: the label of its y axis, its curves, whether y is logarithmic, and its horizontal marks.

    Attributes:
      limits: the ends of the y axis; None for all values.
      axis_label: the label beside the y axis, in addition to that above the panel.
    """

    label: str
    curves: Sequence[DrawnCurve]
    log: bool
    marks: Sequence[ReferenceLine]
    limits: Range | None = None
    axis_label: str = ""

    @property
    def coinciding(self) -> list[str]:
        """The names of curves that coincide with others."""
        return [curve.name for curve in self.curves if curve.turn[1] > 1]

    @property
    def y(self) -> AxisScale:
        """The y axis, with a margin for curves and marks."""
        if self.limits:
            return AxisScale(self.label, *self.limits, self.log)
        values = [end for curve in self.curves for end in _ends(curve.points.y)]
        values += [mark.value for mark in self.marks]
        axis = scale(self.label, np.array(values), log=self.log, edge=MARGIN)
        return replace(axis, whole=all(are_whole(curve.points.y) for curve in self.curves))


@dataclass(frozen=True)
class DrawnFigure:
    """A figure: its panels over one x axis, and the vertical marks of all panels.

    Attributes:
      x_margin: margin beside curves, as a share of their range; none over time, which extends from edge to edge.
      x_limits: the ends of the x axis; None for all values.
      legend_title: title of the legends.
    """

    title: str
    x_label: str
    log_x: bool
    panels: Sequence[DrawnPanel]
    marks: Sequence[ReferenceLine]
    x_margin: float = 0.0
    x_limits: Range | None = None
    legend_title: str = ""

    @property
    def x(self) -> AxisScale:
        """The x axis of all curves, with the margin."""
        if self.x_limits:
            return AxisScale(self.x_label, *self.x_limits, self.log_x)
        values = [curve.points.x for panel in self.panels for curve in panel.curves]
        ends = [end for each in values for end in _ends(each)]
        if not ends:
            return AxisScale(self.x_label, *((0.1, 1.0) if self.log_x else (0.0, 1.0)), self.log_x)
        low, high, whole = min(ends), max(ends), all(map(are_whole, values))
        if self.log_x:
            return AxisScale(self.x_label, *_log_ends(low, high, self.x_margin), True, whole=whole)
        pad = self.x_margin * (high - low) if high - low > 1e-15 * max(abs(low), abs(high)) else 0.5
        return AxisScale(self.x_label, low - pad, high + pad, whole=whole)


def _ends(values: np.ndarray) -> list[float]:
    """Returns the lowest and the highest finite value, if any."""
    finite = values[np.isfinite(values)]
    return [float(finite.min()), float(finite.max())] if len(finite) else []


WIDTHS = (1280, 1600, 1920)  # default width of a figure, by panels side by side [pixels]
PAGE_WIDTH, PAGE_FONT = 640, 8.6  # width [pixels] and letters [pt] of a figure that a phone shows whole
LEAST_WIDTH, LEAST_HEIGHT = 140, 56  # minimum size of a panel with everything around it [pixels]
LEAST_BELOW = 40  # minimum height for the x axis [pixels]
MOST_SIDE, MOST_PIXELS = 2**16 - 1, 10**8  # limits of drawing in about 400 MB
DPI = 96  # pixels per inch, as in CSS, so that an svg has the requested size
POINT = 72 / DPI  # [points per pixel]
ABOVE, BELOW = 2.6, 5.0  # room above the panels if there is a title, and below them [em]


@dataclass(frozen=True)
class PanelGrid:
    """Panels in rows, from left to right.

    Attributes:
      size: width and height of the figure [pixels].
      columns, rows: numbers of columns and rows.
      em: size of letters [pixels].
    """

    size: tuple[int, int]
    columns: int
    rows: int
    em: float


def panel_grid(
    panels: int,
    names: int,
    titled: bool,
    size: tuple[int, int] | None,
    columns: int | None,
    font_size: float | None = None,
    *,
    in_page: bool = False,
) -> PanelGrid:
    """Returns the grid of these panels, in `size` pixels, `columns` and letters of `font_size` points if set.

    Args:
      names: number of names in the largest legend.
      titled: whether there is a title.
      in_page: whether a page shows the figure, below others and also on phones.

    Raises:
      BadValueError: the panels do not fit, or the figure has too many pixels.
    """
    side = min(panels, columns or _columns(panels, size[0] if size else None))
    rows = -(-panels // side)
    width = size[0] if size else WIDTHS[min(side, len(WIDTHS)) - 1]
    if in_page and not size:
        width, font_size = PAGE_WIDTH, font_size or PAGE_FONT
    em = 6 + width / (150 + 30 * (side > 1)) if font_size is None else font_size / POINT
    if size is None:
        panel = min(max(12.5, 3.5 + 1.02 * names), 16.5)  # [em], so that a legend has room
        height = max(0.5625 * width, (rows * panel + BELOW + ABOVE * titled) * em)
        size = width, 2 * round(height / 2)
    least = LEAST_WIDTH * side, LEAST_HEIGHT * rows + LEAST_BELOW
    if size[0] < least[0] or size[1] < least[1]:
        expected = f"at least {least[0]}x{least[1]} for {counted(panels, 'panel')}"
        raise BadValueError(option("size"), f"{size[0]}x{size[1]}", expected)
    if max(size) > MOST_SIDE or size[0] * size[1] > MOST_PIXELS:
        most = f"at most {MOST_SIDE} a side and {MOST_PIXELS // 10**6} megapixels"
        raise BadValueError(option("size"), f"{size[0]}x{size[1]}", most)
    if font_size is None:
        em = min(em, max(8.0, (size[1] - 20) / rows / 7))
    return PanelGrid(size, side, rows, em)


def _columns(panels: int, width: int | None) -> int:
    """Returns the number of panels side by side: one if they are few, as many as fit if they are many."""
    if panels <= 4 or (width is not None and width < 700):
        return 1
    return 3 if panels > 15 and (width is None or width >= 1500) else 2
