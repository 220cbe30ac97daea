"""What is drawn: panels of curves that are points, with their marks, and the ranges of their axes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.envelope import Points

FLAT = 1e-9  # range of an axis, as a share of the largest value, below which curves count as constant
MARGIN = 0.06  # above and below curves, as a share of their range
Range = tuple[float, float]


@dataclass(frozen=True)
class DrawnCurve:
    """A curve.

    Attributes:
      name: in the legend.
      colour: its index in the palette.
      variant: of the pattern of its line, 0 where the colour says enough.
    """

    name: str
    points: Points
    colour: int
    variant: int = 0


@dataclass(frozen=True)
class DrawnPanel:
    """A panel: the label of its y axis, its curves, whether y is logarithmic, and its horizontal marks."""

    label: str
    curves: Sequence[DrawnCurve]
    log: bool
    marks: Sequence[ReferenceLine]

    def y_range(self) -> Range:
        """The range of the y axis: that of curves and marks, and a little more; what is constant is in its middle."""
        ends = [end for curve in self.curves for end in _ends(curve.points.y)]
        ends += [mark.value for mark in self.marks if mark.value > 0 or not self.log]
        if not ends:
            return (0.1, 10.0) if self.log else (-1.0, 1.0)
        low, high = min(ends), max(ends)
        if self.log:
            ratio = (high / low) ** MARGIN if high > low * (1 + FLAT) else 2.0
            return low / ratio, high * ratio
        largest = max(abs(low), abs(high))
        pad = MARGIN * (high - low) if high - low > FLAT * largest else 0.1 * largest or 1.0
        return low - pad, high + pad

    def is_whole(self) -> bool:
        """Whether all values are whole numbers, as counts are."""
        return all(bool(np.all((curve.points.y % 1 == 0) | np.isnan(curve.points.y))) for curve in self.curves)


@dataclass(frozen=True)
class Drawing:
    """A whole figure: its panels over one x axis, and the vertical marks of all.

    Attributes:
      x_margin: before and after curves, as a share of their range; none over time, which goes from edge to edge.
    """

    title: str
    x_label: str
    log_x: bool
    panels: Sequence[DrawnPanel]
    marks: Sequence[ReferenceLine]
    x_margin: float = 0.0

    def x_range(self) -> Range:
        """From the first to the last x of all curves, and the margin."""
        ends = [end for panel in self.panels for curve in panel.curves for end in _ends(curve.points.x)]
        if not ends:
            return (0.1, 1.0) if self.log_x else (0.0, 1.0)
        low, high = min(ends), max(ends)
        if self.log_x:
            ratio = (high / low) ** self.x_margin if high > low * (1 + FLAT) else 2.0
            return low / ratio, high * ratio
        pad = self.x_margin * (high - low) if high - low > 1e-15 * max(abs(low), abs(high)) else 0.5
        return low - pad, high + pad


def _ends(values: np.ndarray) -> list[float]:
    """The lowest and the highest value; none if there are none."""
    finite = values[np.isfinite(values)]
    return [float(finite.min()), float(finite.max())] if len(finite) else []
