"""The data of a figure: panels of curves as points, with their marks, the ranges of their axes, and their grid."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, counted, option
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.envelope import CurvePoints

FLAT = 1e-9  # range of an axis, as a share of the largest value, below which curves count as constant
MARGIN = 0.06  # above and below curves, as a share of their range
Range = tuple[float, float]


@dataclass(frozen=True)
class ParameterAxis:
    """An axis for one parameter or metric.

    Attributes:
      name: name of the parameter or metric.
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
) -> ParameterAxis:
    """Returns the axis with a margin for all finite `values`; equal values are centred."""
    if categories:
        return ParameterAxis(name, -0.5, len(categories) - 0.5, categories=categories)
    finite = values[np.isfinite(values) & ((values > 0) | (not log))]
    if not len(finite):
        return ParameterAxis(name, *((0.1, 10.0, True) if log else (-1.0, 1.0, False)))
    low, high, whole = float(finite.min()), float(finite.max()), are_whole(finite)
    if log:
        ratio = (high / low) ** edge if high > low * (1 + FLAT) else 2.0
        return ParameterAxis(name, low / ratio, high * ratio, True, whole=whole)
    largest = max(abs(low), abs(high))
    pad = edge * (high - low) if high - low > FLAT * largest else 0.1 * largest or 1.0
    return ParameterAxis(name, low - pad, high + pad, whole=whole)


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
    """

    name: str
    points: CurvePoints
    colour: int
    variant: int = 0


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
    def y(self) -> ParameterAxis:
        """The y axis, with a margin for curves and marks."""
        if self.limits:
            return ParameterAxis(self.label, *self.limits, self.log)
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
    def x(self) -> ParameterAxis:
        """The x axis of all curves, with the margin."""
        if self.x_limits:
            return ParameterAxis(self.x_label, *self.x_limits, self.log_x)
        values = [curve.points.x for panel in self.panels for curve in panel.curves]
        ends = [end for each in values for end in _ends(each)]
        if not ends:
            return ParameterAxis(self.x_label, *((0.1, 1.0) if self.log_x else (0.0, 1.0)), self.log_x)
        low, high, whole = min(ends), max(ends), all(map(are_whole, values))
        if self.log_x:
            ratio = (high / low) ** self.x_margin if high > low * (1 + FLAT) else 2.0
            return ParameterAxis(self.x_label, low / ratio, high * ratio, True, whole=whole)
        pad = self.x_margin * (high - low) if high - low > 1e-15 * max(abs(low), abs(high)) else 0.5
        return ParameterAxis(self.x_label, low - pad, high + pad, whole=whole)


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
