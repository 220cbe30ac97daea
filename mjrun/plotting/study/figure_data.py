"""The data of a study's figure: its panels, as numbers."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import listing
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.figure_data import AxisScale, PanelGrid, are_whole, panel_grid, scale

CLOSE = 0.004  # distance of coinciding curves, as a share of the axis
CELLS = 8  # maximum number of cells in a row that are all labelled
EDGE = 0.04  # margin at the ends of an axis, as a share of its range


@dataclass(frozen=True)
class QuantileBand:
    """A band between two quantiles of the values, from `low` to `high` `(n,)`."""

    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Series:
    """Values over x.

    Attributes:
      name: name in the key; empty for a single series.
      x, y: `(n,)`; y is the median if there are bands.
      bands: bands, from wide to narrow.
      joined: whether a line connects the values.
      dots: whether each value is marked.
      colour: index in the palette.
      opacity: opacity of the line.
      turn: place among the curves that coincide, and their number: their dashes alternate along one line.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    bands: Sequence[QuantileBand] = ()
    joined: bool = True
    dots: bool = True
    colour: int = 0
    opacity: float = 1.0
    turn: tuple[int, int] = (0, 1)


@dataclass(frozen=True)
class FailedPoints:
    """Points with a status other than `ok`: their x `(n,)`."""

    status: str
    x: np.ndarray


@dataclass(frozen=True)
class GraphPanel:
    """A metric over a parameter; failures are shown at the bottom.

    Attributes:
      marks: lines at values of either axis.
      axis_label: the label beside the y axis, in addition to that above the panel.
    """

    x: AxisScale
    y: AxisScale
    series: Sequence[Series]
    failures: Sequence[FailedPoints]
    marks: Sequence[ReferenceLine] = ()
    axis_label: str = ""

    @property
    def label(self) -> str:
        """The title above the panel."""
        return self.y.name

    @property
    def curves(self) -> int:
        """The number of curves."""
        return len(self.series)


@dataclass(frozen=True)
class HeatmapPanel:
    """A metric over two parameters: a cell for each pair of values.

    Attributes:
      label: name of the metric.
      columns, rows: axes of the parameters, divided equally among the cells.
      values: `(rows, columns)`; NaN for empty cells.
      failed: mask of the cells in which every point failed.
      colours: range of the colours.
    """

    label: str
    columns: AxisScale
    rows: AxisScale
    values: np.ndarray
    failed: np.ndarray
    colours: AxisScale

    curves = 0


@dataclass(frozen=True)
class ParallelCoordinatesPanel:
    """Parallel coordinates: an axis for each parameter, the last for the metric that colours the lines.

    Attributes:
      scales: the axes.
      values: `(points, axes)`, in drawing order.
      failed: mask of the points without the metric.
    """

    scales: Sequence[AxisScale]
    values: np.ndarray
    failed: np.ndarray


@dataclass(frozen=True)
class SensitivityPanel:
    """Strengths of the relations of parameters to a metric; all panels of a figure have the same parameters.

    Attributes:
      correlations: rank correlations, which monotone relations have; or the first of two indices of sensitivity.
      dependences: shares of dependence by mutual information, which relations of any shape have; or the second index.
      names: names of both in the key.
      axis: label of the x axis.
      ends: ends of the x axis; None for correlations, which have a sign.
      intervals: confidence intervals of both, `(2, parameters, 2)`, NaN where they are unknown; None without any.
    """

    label: str
    parameters: Sequence[str]
    correlations: np.ndarray
    dependences: np.ndarray
    names: tuple[str, str] = ("monotone (rank correlation)", "of any shape (mutual information)")
    axis: str = "strength of the relation"
    ends: tuple[float, float] | None = None
    intervals: np.ndarray | None = None

    curves = 0


StudyPanel = GraphPanel | HeatmapPanel | SensitivityPanel


@dataclass(frozen=True)
class DrawnStudyFigure:
    """A figure of a study, ready to be drawn.

    Attributes:
      panels: panels of one kind, followed by trajectories over time.
      columns: number of columns of panels; None to choose it.
      above: parallel coordinates above all panels, if any.
      legend_title: title of the key.
    """

    title: str
    panels: Sequence[StudyPanel]
    columns: int | None = None
    above: ParallelCoordinatesPanel | None = None
    legend_title: str = ""

    @property
    def description(self) -> str:
        """The titles of the panels, each once."""
        return listing([*dict.fromkeys(panel.label for panel in self.panels)])


def in_turn(series: Sequence[Series], y: AxisScale) -> list[Series]:
    """Returns named lines with their place among those that coincide with them over most of their values."""
    groups = list[list[int]]()
    for index, each in enumerate(series):
        if not (each.joined and each.name):
            continue
        group = next((group for group in groups if _coincide(series[group[0]], each, y)), None)
        if group is None:
            groups.append([index])
        else:
            group.append(index)
    turns = {index: (place, len(group)) for group in groups for place, index in enumerate(group)}
    return [replace(each, turn=turns.get(index, each.turn)) for index, each in enumerate(series)]


def _coincide(a: Series, b: Series, y: AxisScale) -> bool:
    """Returns whether two lines are one to the eye at more than half of the values that they share."""
    if not (len(a.x) and len(b.x)):
        return False
    ends = max(a.x[0], b.x[0]), min(a.x[-1], b.x[-1])
    shared = (a.x >= ends[0]) & (a.x <= ends[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = np.abs(y.shares(a.y[shared]) - y.shares(np.interp(a.x[shared], b.x, b.y)))
    distances = distances[np.isfinite(distances)]
    return len(distances) > 0 and bool(2 * np.count_nonzero(distances < CLOSE) > len(distances))


def cell_scale(name: str, levels: np.ndarray, labels: Sequence[str]) -> AxisScale:
    """Returns the axis of cells with ascending values: numeric if many and evenly spaced, otherwise of texts."""
    count = len(levels)
    if count > CELLS and is_geometric(levels):
        half = float((levels[-1] / levels[0]) ** (0.5 / (count - 1)))
        return AxisScale(name, float(levels[0]) / half, float(levels[-1]) * half, True)
    steps = np.diff(levels)
    if count > CELLS and steps.max() - steps.min() < 1e-6 * steps.mean():
        half = float(steps.mean()) / 2
        return AxisScale(name, float(levels[0]) - half, float(levels[-1]) + half, whole=are_whole(levels))
    return scale(name, levels, categories=labels, edge=0.0)


def is_geometric(values: np.ndarray) -> bool:
    """Returns whether ascending values have equal ratios, are at least three, and span at least a factor of four."""
    if len(values) < 3 or values[0] <= 0 or values[-1] < 4 * values[0]:
        return False
    steps = np.diff(np.log(values))
    return bool(steps.max() - steps.min() < 1e-3 * steps.mean())


def spans_decades(values: np.ndarray) -> bool:
    """Returns whether values are all positive, and so different that a linear axis would hide the small ones."""
    finite = values[np.isfinite(values)]
    if len(finite) < 3 or finite.min() <= 0:
        return False
    low, high = np.quantile(finite, 0.05, method="lower"), np.quantile(finite, 0.95, method="higher")
    return bool(high > 100 * low)


def is_even_in_ratios(values: np.ndarray) -> bool:
    """Returns whether positive values over a factor of eight or more appear to be drawn log-uniformly."""
    low, middle, high = np.quantile(values, [0, 0.5, 1])
    if low <= 0 or high < 8 * low:
        return False
    share, ratio = (middle - low) / (high - low), np.log(middle / low) / np.log(high / low)
    return bool(abs(ratio - 0.5) < abs(share - 0.5))


def study_grid(
    drawing: DrawnStudyFigure, size: tuple[int, int] | None, font_size: float | None = None, *, in_page: bool = False
) -> PanelGrid:
    """Returns the size of a figure and the positions of its panels.

    Args:
      in_page: whether a page shows the figure.

    Raises:
      BadValueError: the panels do not fit in `size` pixels.
    """
    panels = len(drawing.panels)
    most = 2 if panels == 4 else 3  # four are two by two
    is_heat = isinstance(drawing.panels[0], HeatmapPanel)
    side = drawing.columns or (1 if panels < 3 and not is_heat else min(most, panels))
    if drawing.columns is None and size and size[0] < 900:
        side = 1
    in_page = in_page and drawing.columns is None and all(isinstance(panel, GraphPanel) for panel in drawing.panels)
    side = 1 if in_page else side
    names = max((len(p.parameters) + 2 for p in drawing.panels if isinstance(p, SensitivityPanel)), default=0)
    above = min(side, panels) if drawing.above else 0
    titled = bool(drawing.title)
    return panel_grid(panels + above, names, titled, size, min(side, panels), font_size, in_page=in_page)
