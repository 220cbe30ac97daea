"""What is drawn of a study: its panels, as numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.plotting.figure_data import FLAT, MARGIN, Range
from mjrun.plotting.panel_grid import PanelCount, PanelGrid, panel_grid

CELLS = 8  # in a row, up to which each has its value below it
EDGE = 0.04  # before the first and after the last value of an axis, as a share of its range


@dataclass(frozen=True)
class Scale:
    """An axis for one parameter or metric.

    Attributes:
      name: what it shows.
      categories: texts, which stand at 0, 1, 2, …; none for numbers.
    """

    name: str
    low: float
    high: float
    log: bool = False
    categories: Sequence[str] = ()

    def shares(self, values: np.ndarray) -> np.ndarray:
        """Where values are between the ends of the axis: from 0 to 1."""
        if self.log:
            return np.log(values / self.low) / np.log(self.high / self.low)
        return (values - self.low) / (self.high - self.low)


def scale(name: str, values: np.ndarray, *, log: bool = False, categories: Sequence[str] = (), edge: float) -> Scale:
    """The axis on which all finite `values` are, and a little more; the middle is where they are all the same."""
    if categories:
        return Scale(name, -0.5, len(categories) - 0.5, categories=categories)
    finite = values[np.isfinite(values) & ((values > 0) | (not log))]
    if not len(finite):
        return Scale(name, *((0.1, 10.0, True) if log else (-1.0, 1.0, False)))
    low, high = float(finite.min()), float(finite.max())
    if log:
        ratio = (high / low) ** edge if high > low * (1 + FLAT) else 2.0
        return Scale(name, low / ratio, high * ratio, True)
    largest = max(abs(low), abs(high))
    pad = edge * (high - low) if high - low > FLAT * largest else 0.1 * largest or 1.0
    return Scale(name, low - pad, high + pad)


@dataclass(frozen=True)
class Band:
    """Between `low` and `high` `(n,)` are the values from one quantile to another."""

    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Series:
    """Values over x.

    Attributes:
      name: in the key; empty for one alone.
      x, y: `(n,)`; y is the median where there are bands.
      bands: from wide to narrow.
      joined: whether a line goes through them.
      dots: whether each is marked.
      colour: its index in the palette.
      opacity: of the line.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    bands: Sequence[Band] = ()
    joined: bool = True
    dots: bool = True
    colour: int = 0
    opacity: float = 1.0


@dataclass(frozen=True)
class Failures:
    """Where points ended in another way than `ok`: their x `(n,)`."""

    status: str
    x: np.ndarray


@dataclass(frozen=True)
class GraphPanel:
    """A metric over a parameter; failures are shown at the bottom."""

    x: Scale
    y: Scale
    series: Sequence[Series]
    failures: Sequence[Failures]

    @property
    def label(self) -> str:
        """What stands above it."""
        return self.y.name

    @property
    def curves(self) -> int:
        """How many curves it has."""
        return len(self.series)


@dataclass(frozen=True)
class HeatPanel:
    """A metric over two parameters: a cell for each pair of values.

    Attributes:
      name: of the metric.
      columns, rows: the axes of the parameters, of which each cell takes an equal part.
      values: `(rows, columns)`; NaN where there is none.
      failed: of these cells, those in which every point failed.
      colours: the range of colours.
    """

    name: str
    columns: Scale
    rows: Scale
    values: np.ndarray
    failed: np.ndarray
    colours: Scale

    @property
    def label(self) -> str:
        """What stands above it."""
        return self.name

    curves = 0


@dataclass(frozen=True)
class ParallelPanel:
    """Parallel coordinates: an axis for each parameter, the last for the metric that colours the lines.

    Attributes:
      scales: of the axes.
      values: `(points, axes)`, in the order in which they are drawn.
      failed: of each point, whether it has no metric.
    """

    scales: Sequence[Scale]
    values: np.ndarray
    failed: np.ndarray


@dataclass(frozen=True)
class RankPanel:
    """Rank correlations of parameters with a metric; those of one figure have the same parameters, in one order."""

    name: str
    parameters: Sequence[str]
    correlations: np.ndarray

    @property
    def label(self) -> str:
        """What stands above it."""
        return self.name

    curves = 0


StudyPanel = GraphPanel | HeatPanel | RankPanel


@dataclass(frozen=True)
class StudyDrawing:
    """A figure of a study.

    Attributes:
      panels: of one kind, and after them trajectories over time.
      columns: of panels; None for as many as suit.
      above: what stands above all panels, if anything does.
    """

    title: str
    panels: Sequence[StudyPanel]
    columns: int | None = None
    above: ParallelPanel | None = None


def cell_scale(name: str, levels: np.ndarray, labels: Sequence[str]) -> Scale:
    """The axis of cells with ascending values: of numbers where those are many and evenly spaced, else of texts."""
    count = len(levels)
    if count > CELLS and is_geometric(levels):
        half = float((levels[-1] / levels[0]) ** (0.5 / (count - 1)))
        return Scale(name, float(levels[0]) / half, float(levels[-1]) * half, True)
    steps = np.diff(levels)
    if count > CELLS and steps.max() - steps.min() < 1e-6 * steps.mean():
        half = float(steps.mean()) / 2
        return Scale(name, float(levels[0]) - half, float(levels[-1]) + half)
    return scale(name, levels, categories=labels, edge=0.0)


def is_geometric(values: np.ndarray) -> bool:
    """Whether ascending values are in equal ratios, and three or more over at least a factor of four."""
    if len(values) < 3 or values[0] <= 0 or values[-1] < 4 * values[0]:
        return False
    steps = np.diff(np.log(values))
    return bool(steps.max() - steps.min() < 1e-3 * steps.mean())


def spans_decades(values: np.ndarray) -> bool:
    """Whether values are all positive, and so different that a linear axis would hide the small ones."""
    finite = values[np.isfinite(values)]
    if len(finite) < 3 or finite.min() <= 0:
        return False
    low, high = np.quantile(finite, 0.05, method="lower"), np.quantile(finite, 0.95, method="higher")
    return bool(high > 100 * low)


def is_even_in_ratios(values: np.ndarray) -> bool:
    """Whether positive values over a factor of eight or more look as if they were drawn log-uniformly."""
    low, middle, high = np.quantile(values, [0, 0.5, 1])
    if low <= 0 or high < 8 * low:
        return False
    share, ratio = (middle - low) / (high - low), np.log(middle / low) / np.log(high / low)
    return bool(abs(ratio - 0.5) < abs(share - 0.5))


def y_scale(name: str, values: np.ndarray, *, log: bool) -> Scale:
    """The axis of a metric."""
    return scale(name, values, log=log, edge=MARGIN)


def colour_range(name: str, values: np.ndarray, *, log: bool) -> Range:
    """The lowest and highest value that colours show."""
    exact = scale(name, values, log=log, edge=0.0)
    return exact.low, exact.high


def study_grid(drawing: StudyDrawing, size: tuple[int, int] | None) -> PanelGrid:
    """The size of a figure, and the places of its panels.

    Raises:
      BadValueError: they have no room in `size` pixels.
    """
    panels = len(drawing.panels)
    most = 2 if panels == 4 else 3  # four are two by two
    is_heat = isinstance(drawing.panels[0], HeatPanel)
    side = drawing.columns or (1 if panels < 3 and not is_heat else min(most, panels))
    if drawing.columns is None and size and size[0] < 900:
        side = 1
    names = max((len(p.parameters) + 2 for p in drawing.panels if isinstance(p, RankPanel)), default=0)
    above = min(side, panels) if drawing.above else 0
    return panel_grid(PanelCount(panels + above, names, bool(drawing.title)), size, min(side, panels))
