"""Means over repeats: points of a study that differ in their seed only."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import ResultsTable
from mjrun.experiment.statistics import GroupMeans, Interval, group_means
from mjrun.model.table_column import Column

SEED = "seed"
FILES = ("repeats.parquet", "repeats.csv")
SUMMARIZED = 100  # most groups in a report


@dataclass(frozen=True)
class MeanSummary:
    """The mean of a metric over repeats.

    Attributes:
      count: number of repeats where it is finite.
      mean: mean over these; None without any.
      std: standard deviation of the population, estimated from these; None for fewer than two.
      interval: Student's t interval of the mean.
    """

    count: int
    mean: float | None
    std: float | None
    interval: Interval


@dataclass(frozen=True)
class RepeatSummary:
    """Points that differ in their seed only.

    Attributes:
      points: number of points.
      values: values of the other parameters.
      metrics: mean of each metric.
    """

    points: int
    values: Mapping[str, str]
    metrics: Mapping[str, MeanSummary]


class RepeatMeans:
    """Means of metrics over the repeats of a study.

    Args:
      metrics: values of each metric `(n,)`, by name.
      confidence: confidence of the intervals.

    Attributes:
      design: the points without their seeds; empty without metrics, or if no two points differ in their seed only.
    """

    def __init__(self, points: Design, metrics: Mapping[str, np.ndarray | Sequence[float]], confidence: float) -> None:
        others = Design(tuple(name for name in points.names if name != SEED), [])
        first, groups = _grouped(points) if metrics and SEED in points.names else (np.array([]), np.array([], int))
        if len(first) < len(groups):
            kept = [index for index, name in enumerate(points.names) if name != SEED]
            others = replace(others, points=[tuple(row[index] for index in kept) for row in points.at(first.tolist())])
        self.design = others
        self._sizes = np.bincount(groups)
        self._means = dict[str, GroupMeans]()
        if others.points:
            for name, values in metrics.items():
                self._means[name] = group_means(np.asarray(values), groups, len(first), confidence)

    def table(self, units: Mapping[str, str] = MappingProxyType({})) -> ResultsTable:
        """Returns a table with a row for each group of repeats, in the order of the points.

        Args:
          units: units of parameters and metrics, by name.
        """
        table = ResultsTable()
        table.add_parameters(self.design, units=units)
        table.add(Column("repeats", meaning="number of points", integer=True), self._sizes)
        for name, means in self._means.items():
            unit = units.get(name, "")
            finite = "number of repeats where the metric is finite"
            table.add(Column(f"{name}/count", meaning=finite, integer=True), means.count)
            table.add(Column(f"{name}/mean", unit, "mean over these repeats"), means.mean)
            table.add(Column(f"{name}/std", unit, "standard deviation over these repeats"), means.std)
            table.add(Column(f"{name}/low", unit, "low end of the interval of the mean"), means.low)
            table.add(Column(f"{name}/high", unit, "high end of the interval of the mean"), means.high)
        return table

    def summaries(self) -> list[RepeatSummary]:
        """Returns the first groups, as many as a report contains."""
        return [
            RepeatSummary(
                int(self._sizes[group]),
                self.design.values(group),
                {name: _mean(means, group) for name, means in self._means.items()},
            )
            for group in range(min(len(self.design.points), SUMMARIZED))
        ]


def _grouped(points: Design) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first point of each group of repeats, ascending, and the number of the group of each point `(n,)`."""
    keys = np.zeros(len(points.points), int)
    for index, name in enumerate(points.names):
        if name != SEED:
            column = points.column(index)
            _, keys = np.unique(keys * len(column.texts) + column.places, return_inverse=True)
    _, first, groups = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], np.argsort(order)[groups]


def _mean(means: GroupMeans, group: int) -> MeanSummary:
    mean, std, low, high = (
        float(values[group]) if np.isfinite(values[group]) else None
        for values in (means.mean, means.std, means.low, means.high)
    )
    return MeanSummary(int(means.count[group]), mean, std, Interval(low, high))
