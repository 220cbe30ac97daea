"""Why points fail: reasons as they come, and all of them at the end."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mjrun.errors import clean
from mjrun.reporter import Reporter
from mjrun.study.design import Design
from mjrun.study.simulate import PointResult

TOLD = 10  # reasons, as they come
FEW = 4  # values of a point that are told


@dataclass(frozen=True)
class PointFailure:
    """Why points failed.

    Attributes:
      status: how they ended.
      message: the first line that MuJoCo or mjrun has to say.
      count: how many.
      point: the first of them.
      values: its values.
    """

    status: str
    message: str
    count: int
    point: int
    values: Mapping[str, str]


def point_failures(points: Design, results: Sequence[PointResult]) -> list[PointFailure]:
    """The reasons of failures, the most frequent first."""
    groups: dict[tuple[str, str], list[int]] = {}
    for index, result in enumerate(results):
        if result.status != "ok":
            groups.setdefault(_reason(result), []).append(index)
    ordered = sorted(groups.items(), key=lambda item: -len(item[1]))
    return [
        PointFailure(status, results[failed[0]].message, len(failed), failed[0], points.values(failed[0]))
        for (status, _), failed in ordered
    ]


class FailureNotes:
    """Tells of the first point that fails for each reason, when it does.

    Args:
      points: of the study, or of a part of it.
      numbers: of these points in the study; they are all of it when None.
    """

    def __init__(self, points: Design, reporter: Reporter, numbers: Sequence[int] | None = None) -> None:
        self._points, self._reporter = points, reporter
        self._numbers = range(len(points.points)) if numbers is None else numbers
        self._told: set[tuple[str, str]] = set()

    def add(self, results: Iterable[PointResult]) -> None:
        """Takes results as they come; the index of each is that of its point in `points`."""
        for result in results:
            if result.status == "ok" or _reason(result) in self._told:
                continue
            self._told.add(_reason(result))
            if len(self._told) <= TOLD:
                values = [f"{name}={text}" for name, text in self._points.values(result.index).items()]
                shown = ", ".join([*values[:FEW], *(["…"] if len(values) > FEW else [])])
                line = result.message.partition("\n")[0]
                where = f" ({clean(shown)})" if shown else ""
                self._reporter.note(f"point {self._numbers[result.index]}{where}: {clean(line)}")
            elif len(self._told) == TOLD + 1:
                self._reporter.note("points fail for more reasons; the table has all")


def _reason(result: PointResult) -> tuple[str, str]:
    """What failures have in common that have one reason: when a simulation becomes unstable is none."""
    return result.status, "" if result.status == "unstable" else result.message.partition("\n")[0]
