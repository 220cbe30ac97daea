"""Results of a study: columns with a few bytes for each number of a point; their table, the reasons of failures, and
means over points that differ in their seed only.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import get_args, overload

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import POINT, ResultsTable
from mjrun.experiment.statistics import GroupMeans, Interval, group_means
from mjrun.model.table_column import Column
from mjrun.reporter import Reporter
from mjrun.study.spec import PointResult, Status

FRAME = 8_000  # size of a table without rows [bytes]
TABLE_COLUMNS = ("point", "status", "steps", "exit_code", "message", "precision")  # beside parameters and metrics
MOST_REASONS = 10  # that are reported while points are simulated
FEW = 4  # values of a point in a message
_COMPARED = re.compile(r"""\bstatus\s*(==|!=)\s*(["'])(\w+)\2""")
SEED = "seed"
REPEAT_FILES = ("repeats.parquet", "repeats.csv")
SUMMARIZED = 100  # most groups in a report
STATUSES: tuple[Status, ...] = get_args(Status)
MISSING = STATUSES.index("missing")
FINAL = STATUSES[:2]  # which another attempt would not change
NUMBERS = ("status", "steps", "exit_code", "wall", "metrics")
NOT_YET = "it is not simulated yet"
_CODES = {status: code for code, status in enumerate(STATUSES)}


@dataclass(frozen=True)
class ResultRows:
    """Results of points, `(n,)` each, in any order.

    Attributes:
      status: indices of `STATUSES`.
      metrics: `(n, metrics)`.
      message, host: indices of texts.
      messages, hosts: the texts of `message` and `host`.
    """

    status: np.ndarray
    steps: np.ndarray
    exit_code: np.ndarray
    wall: np.ndarray
    metrics: np.ndarray
    message: np.ndarray
    messages: Sequence[str]
    host: np.ndarray
    hosts: Sequence[str]

    @classmethod
    def of(cls, results: Sequence[PointResult], metrics: int, host: str = "") -> "ResultRows":
        """Returns results that one host has made."""
        place = {text: number for number, text in enumerate(dict.fromkeys(each.message for each in results))}
        return cls(
            status=np.array([_CODES[each.status] for each in results], np.uint8),
            steps=np.array([each.steps for each in results], np.int64),
            exit_code=np.array([each.exit_code for each in results], np.int64),
            wall=np.array([each.wall for each in results], float),
            metrics=np.array([each.metrics for each in results], float).reshape(len(results), metrics),
            message=np.array([place[each.message] for each in results], np.int32),
            messages=[*place],
            host=np.zeros(len(results), np.int32),
            hosts=[host],
        )

    def at(self, rows: np.ndarray) -> "ResultRows":
        """Returns some of the rows."""
        columns = {name: getattr(self, name)[rows] for name in (*NUMBERS, "message", "host")}
        return replace(self, **columns)

    @property
    def is_final(self) -> np.ndarray:
        """True for results that another attempt would not change."""
        return self.status < len(FINAL)


class ResultColumns(Sequence[PointResult]):
    """The results of points, of which any may be missing; as a sequence, the result of each.

    Args:
      points: the numbers of the points, ascending.
      metrics: number of metrics.

    Attributes:
      status: indices of `STATUSES`, `(n,)`.
      steps, exit_code, wall: `(n,)`.
      metrics: `(n, metrics)`, NaN where missing.
    """

    def __init__(self, points: Sequence[int] | np.ndarray, metrics: int) -> None:
        count = len(points)
        self.points = np.asarray(points, np.int64)
        self.status = np.full(count, MISSING, np.uint8)
        self.steps = np.zeros(count, np.int64)
        self.exit_code = np.zeros(count, np.int32)
        self.wall = np.zeros(count)
        self.metrics = np.full((count, metrics), math.nan)
        self._message, self._host = np.zeros(count, np.int32), np.zeros(count, np.int32)
        self._texts, self._words = {NOT_YET: 0, "": 1}, [NOT_YET, ""]

    @classmethod
    def of(cls, results: Sequence[PointResult], metrics: int) -> "ResultColumns":
        """Returns the columns of the results of all points in order."""
        columns = cls(range(len(results)), metrics)
        columns.put(np.arange(len(results)), ResultRows.of(results, metrics))
        return columns

    def __len__(self) -> int:
        return len(self.points)

    @overload
    def __getitem__(self, index: int) -> PointResult: ...
    @overload
    def __getitem__(self, index: slice) -> list[PointResult]: ...
    def __getitem__(self, index: int | slice) -> PointResult | list[PointResult]:
        if isinstance(index, slice):
            return [self[place] for place in range(len(self))[index]]
        return PointResult(
            int(self.points[index]),
            STATUSES[self.status[index]],
            tuple(self.metrics[index].tolist()),
            int(self.steps[index]),
            int(self.exit_code[index]),
            self._words[self._message[index]],
            float(self.wall[index]),
        )

    def __iter__(self) -> Iterator[PointResult]:
        return (self[index] for index in range(len(self)))

    def has_between(self, first: int, last: int) -> bool:
        """Returns whether any of the points is in this range, whose ends are included."""
        return bool(np.searchsorted(self.points, first) < np.searchsorted(self.points, last, "right"))

    def put_points(self, points: np.ndarray, rows: ResultRows) -> None:
        """Stores the rows of points as `put`; those of other points are left out."""
        places = np.minimum(np.searchsorted(self.points, points), len(self) - 1)
        is_here = self.points[places] == points
        self.put(places[is_here], rows.at(is_here))

    def put(self, places: np.ndarray, rows: ResultRows) -> None:
        """Stores rows at these places, except over final results; the last of several for one place, or a final one."""
        order = np.flatnonzero(~self.is_final[places])
        if not rows.is_final.all():
            order = order[np.argsort(rows.is_final[order], kind="stable")]
        places, rows = places[order], rows.at(order)
        for name in NUMBERS:
            getattr(self, name)[places] = getattr(rows, name)
        self._message[places] = self._coded(rows.messages)[rows.message]
        self._host[places] = self._coded(rows.hosts)[rows.host]

    def forget(self, places: Sequence[int]) -> None:
        """Removes the results at these places, which are missing then."""
        blank = ResultColumns(self.points[list(places)], self.metrics.shape[1])
        for name in (*NUMBERS, "_message", "_host"):
            getattr(self, name)[list(places)] = getattr(blank, name)

    def rows(self, places: np.ndarray) -> ResultRows:
        """Returns the results at these places."""
        numbers = {name: getattr(self, name)[places] for name in NUMBERS}
        message, host = self._message[places], self._host[places]
        return ResultRows(**numbers, message=message, messages=self._words, host=host, hosts=self._words)

    @property
    def is_final(self) -> np.ndarray:
        """True for results that another attempt would not change, `(n,)`."""
        return self.status < len(FINAL)

    @property
    def is_missing(self) -> np.ndarray:
        """True for points without a result, `(n,)`."""
        return self.status == MISSING

    @property
    def counts(self) -> dict[str, int]:
        """Number of points by status, of those that occur."""
        counts = np.bincount(self.status, minlength=len(STATUSES)).tolist()
        return {status: count for status, count in zip(STATUSES, counts, strict=True) if count}

    @property
    def messages(self) -> tuple[np.ndarray, Sequence[str]]:
        """The message of each point, as indices `(n,)` of texts, and the texts."""
        return self._message, self._words

    @property
    def endings(self) -> list[tuple[Status, str, int, int]]:
        """Each status with each of its messages except ok: the number of points, and the first of them."""
        codes = self.status.astype(np.int64) * len(self._words) + self._message
        failed = np.flatnonzero(self.status != 0)
        found, first, counts = np.unique(codes[failed], return_index=True, return_counts=True)
        parts = [divmod(int(code), len(self._words)) for code in found]
        return [
            (STATUSES[status], self._words[message], int(count), int(failed[place]))
            for (status, message), place, count in zip(parts, first, counts, strict=True)
        ]

    def _coded(self, texts: Sequence[str]) -> np.ndarray:
        for text in texts:
            if text not in self._texts:
                self._texts[text] = len(self._words)
                self._words.append(text)
        return np.array([self._texts[text] for text in texts], np.int32)


# --- the table of a study ----------------------------------------------------------------------------


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
    if "steps" not in design.names:  # otherwise the column of the parameter has this name
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
