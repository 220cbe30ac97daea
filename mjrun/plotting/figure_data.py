"""The data of a figure: panels of curves as points, with their marks, and the ranges of their axes."""

from collections.abc import Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.envelope import Points

FLAT = 1e-9  # range of an axis, as a share of the largest value, below which curves count as constant
MARGIN = 0.06  # above and below curves, as a share of their range
Range = tuple[float, float]


@dataclass(frozen=True)
class ParameterAxis:
    """An axis for one parameter or metric.

    Attributes:
      name: name of the parameter or metric.
      categories: texts, placed at 0, 1, 2, …; empty for numbers.
    """

    name: str
    low: float
    high: float
    log: bool = False
    categories: Sequence[str] = ()

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
    low, high = float(finite.min()), float(finite.max())
    if log:
        ratio = (high / low) ** edge if high > low * (1 + FLAT) else 2.0
        return ParameterAxis(name, low / ratio, high * ratio, True)
    largest = max(abs(low), abs(high))
    pad = edge * (high - low) if high - low > FLAT * largest else 0.1 * largest or 1.0
    return ParameterAxis(name, low - pad, high + pad)


@dataclass(frozen=True)
class DrawnCurve:
    """A curve.

    Attributes:
      name: name in the legend.
      colour: index in the palette.
      variant: variant of the line's pattern, 0 if the colour suffices.
    """

    name: str
    points: Points
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
        return scale(self.label, np.array(values), log=self.log, edge=MARGIN)

    def is_whole(self) -> bool:
        """Returns whether all values are whole numbers, as counts are."""
        return all(bool(np.all((curve.points.y % 1 == 0) | np.isnan(curve.points.y))) for curve in self.curves)


@dataclass(frozen=True)
class Drawing:
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
        ends = [end for panel in self.panels for curve in panel.curves for end in _ends(curve.points.x)]
        if not ends:
            return ParameterAxis(self.x_label, *((0.1, 1.0) if self.log_x else (0.0, 1.0)), self.log_x)
        low, high = min(ends), max(ends)
        if self.log_x:
            ratio = (high / low) ** self.x_margin if high > low * (1 + FLAT) else 2.0
            return ParameterAxis(self.x_label, low / ratio, high * ratio, True)
        pad = self.x_margin * (high - low) if high - low > 1e-15 * max(abs(low), abs(high)) else 0.5
        return ParameterAxis(self.x_label, low - pad, high + pad)


def _ends(values: np.ndarray) -> list[float]:
    """Returns the lowest and the highest finite value, if any."""
    finite = values[np.isfinite(values)]
    return [float(finite.min()), float(finite.max())] if len(finite) else []
