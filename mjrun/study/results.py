"""Results of a study: their table, the reasons of failures, and means over points that differ in their seed only."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import POINT, ResultsTable
from mjrun.experiment.statistics import GroupMeans, Interval, group_means
from mjrun.model.table_column import Column
from mjrun.reporter import Reporter
from mjrun.study.columnar_results import STATUSES, ResultColumns
from mjrun.study.spec import PointResult

FRAME = 8_000  # size of a table without rows [bytes]
TABLE_COLUMNS = ("point", "status", "steps", "exit_code", "message", "precision")  # beside parameters and metrics
MOST_REASONS = 10  # that are reported while points are simulated
FEW = 4  # values of a point in a message
_COMPARED = re.compile(r"""\bstatus\s*(==|!=)\s*(["'])(\w+)\2""")
SEED = "seed"
REPEAT_FILES = ("repeats.parquet", "repeats.csv")
SUMMARIZED = 100  # most groups in a report


def study_table(
    design: Design,
    metrics: Sequence[str],
    results: ResultColumns,
    units: Mapping[str, str] = MappingProxyType({}),
    *,
    is_single: bool = False,
) -> ResultsTable:
    """Returns the table of a study, with a row for each point in order.

    Args:
      units: units of parameters and metrics, by name.
      is_single: whether points were simulated in single precision, which a column states.
    """
    table = ResultsTable()
    table.add(POINT, results.points)
    table.add_parameters(design, units=units)
    for index, name in enumerate(metrics):
        table.add(Column(name, units.get(name, ""), "metric"), results.metrics[:, index])
    table.add_coded("status", results.status, STATUSES)
    table.add(Column("steps", meaning="steps taken", integer=True), results.steps)
    table.add(Column("exit_code", meaning="of this point alone", integer=True), results.exit_code)
    table.add_coded("message", *results.messages)
    if is_single:
        table.add_coded("precision", np.zeros(len(results), np.uint8), ("single",))
    return table


def with_flags(text: str) -> str:
    """Rewrites `status == "ok"` in an expression to `ok == 1`: each status is a column of ones and zeros.

    All characters keep their positions, so that errors point to the original text.
    """

    def flag(compared: re.Match[str]) -> str:
        operator, status = compared[1], compared[3]
        if status not in STATUSES:
            return compared[0]
        return f"{status} == {int(operator == '==')}".ljust(len(compared[0]))

    return _COMPARED.sub(flag, text)


def status_counts(statuses: Mapping[str, int]) -> str:
    """Formats the number of points of each status: `97 ok, 3 unstable`."""
    return ", ".join(f"{count:,} {status}" for status, count in statuses.items())


def table_bytes(design: Design, metrics: int) -> int:
    """Estimates the size of the tables of a study [bytes]: 8 bytes per number in Parquet, their digits in CSV."""
    count = len(design.points)
    digits = sum(len(text) + 1 for point in design.points[:1000] for text in point) * count // max(1, min(count, 1000))
    return FRAME + count * 8 * (len(design.names) + metrics) + digits + count * (20 * metrics + 20)


@dataclass(frozen=True)
class PointFailureGroup:
    """Points that failed for one reason.

    Attributes:
      status: status of the points.
      message: first line of the message of MuJoCo or mjrun.
      count: number of points.
      point: first of the points.
      values: values of that point, by parameter.
    """

    status: str
    message: str
    count: int
    point: int
    values: Mapping[str, str]


def point_failures(points: Design, results: ResultColumns) -> list[PointFailureGroup]:
    """Groups failures by reason, the most frequent first."""
    groups = dict[tuple[str, str], tuple[int, int, str]]()
    for status, message, count, first in results.endings:
        reason = _reason(status, message)
        before, first_before, message_before = groups.get(reason, (0, first, message))
        message = message if first < first_before else message_before
        groups[reason] = before + count, min(first, first_before), message
    ordered = sorted(groups.items(), key=lambda item: (-item[1][0], item[1][1]))
    return [
        PointFailureGroup(status, message, count, first, points.values(first))
        for (status, _), (count, first, message) in ordered
    ]


class FailureReporter:
    """A reporter of the first point that fails for each reason, as soon as it does.

    Args:
      points: points of the study.
      noun: the word for a point.
    """

    def __init__(self, points: Design, reporter: Reporter, noun: str = "point") -> None:
        self._points, self._reporter, self._noun = points, reporter, noun
        self._reported = set[tuple[str, str]]()

    def add(self, results: Iterable[PointResult]) -> None:
        """Adds results as they arrive; their indices are those of the points."""
        for result in results:
            if result.status == "ok" or _reason(result.status, result.message) in self._reported:
                continue
            self._reported.add(_reason(result.status, result.message))
            if len(self._reported) <= MOST_REASONS:
                values = [f"{name}={text}" for name, text in self._points.values(result.index).items()]
                shown = ", ".join([*values[:FEW], *(["…"] if len(values) > FEW else [])])
                line = result.message.partition("\n")[0]
                where = f" ({clean(shown)})" if shown else ""
                self._reporter.note(f"{self._noun} {result.index}{where}: {clean(line)}")
            elif len(self._reported) == MOST_REASONS + 1:
                self._reporter.note(f"{self._noun}s fail for more reasons; the table contains all of them")


def _reason(status: str, message: str) -> tuple[str, str]:
    """Returns the reason of a failure; all unstable simulations have the same, whatever the step."""
    return status, "" if status == "unstable" else message.partition("\n")[0]


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
