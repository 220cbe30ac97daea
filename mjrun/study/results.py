"""Results of a study: their table, and the reasons of failures."""

import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import POINT, ResultsTable
from mjrun.model.table_column import Column
from mjrun.reporter import Reporter
from mjrun.study.columnar_results import STATUSES, ResultColumns
from mjrun.study.spec import PointResult

FRAME = 8_000  # size of a table without rows [bytes]
TABLE_COLUMNS = ("point", "status", "steps", "exit_code", "message", "precision")  # beside parameters and metrics
MOST_REASONS = 10  # that are reported while points are simulated
FEW = 4  # values of a point in a message
_COMPARED = re.compile(r"""\bstatus\s*(==|!=)\s*(["'])(\w+)\2""")


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


def table_bytes(design: Design, metrics: int) -> int:
    """Estimates the size of the tables of a study [bytes]: 8 bytes per number in Parquet, their digits in CSV."""
    count = len(design.points)
    digits = sum(len(text) + 1 for point in design.points[:1000] for text in point) * count // max(1, min(count, 1000))
    return FRAME + count * 8 * (len(design.names) + metrics) + digits + count * (20 * metrics + 20)


@dataclass(frozen=True)
class FailureGroup:
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


def point_failures(points: Design, results: ResultColumns) -> list[FailureGroup]:
    """Groups failures by reason, the most frequent first."""
    groups = dict[tuple[str, str], tuple[int, int, str]]()
    for status, message, count, first in results.endings:
        reason = _reason(status, message)
        before, first_before, message_before = groups.get(reason, (0, first, message))
        message = message if first < first_before else message_before
        groups[reason] = before + count, min(first, first_before), message
    ordered = sorted(groups.items(), key=lambda item: (-item[1][0], item[1][1]))
    return [
        FailureGroup(status, message, count, first, points.values(first))
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
