"""Which points of a study files are kept of: by a condition, and by the lowest and highest values of a metric."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.options.keep import KeepOptions
from mjrun.probe.row_expression import Condition, parse_condition
from mjrun.probe.scanner import Vocabulary
from mjrun.study.design import ParameterNames
from mjrun.study.results import STATUSES, with_flags

_RANKED = re.compile(r"\s*([1-9]\d*)\s*:(.+)", re.DOTALL)


class PointChoice:
    """The points that options choose, checked before there are any results.

    Args:
      parameters: the names of what varies.
      metrics: their names.

    Raises:
      UsageError: a condition that is not well formed, or a metric that is not there.
    """

    def __init__(self, options: KeepOptions, parameters: Sequence[str], metrics: Sequence[str]) -> None:
        names = PointNames(parameters, metrics)
        self._conditions = [self._condition(i, text, names) for i, text in enumerate(options.keep_where)]
        ranked = (("keep_lowest", options.keep_lowest, 1), ("keep_highest", options.keep_highest, -1))
        self._ranked = [
            (*_ranked(name, index, text, metrics), sign)
            for name, texts, sign in ranked
            for index, text in enumerate(texts)
        ]
        given = bool(self._conditions or self._ranked)
        if given and not options.keep and options.contact_sheet is None:
            raise UsageError(f"nothing is kept of the points that are chosen; see {option('keep')}")

    def points(self, columns: Mapping[str, np.ndarray], status: Sequence[str], able: np.ndarray) -> list[int]:
        """The numbers of the points, ascending: all that are able, if nothing chooses.

        Args:
          columns: what varies and metrics, `(n,)` each.
          status: of each point.
          able: which points can be simulated once more `(n,)`.

        Raises:
          UsageError: a condition reads what is not a number.
        """
        states = np.array(status)
        chosen = able.copy()
        table = {**columns, **{name: (states == name).astype(float) for name in STATUSES}}
        for text, condition in self._conditions:
            if texts := [name for name in condition.columns if name not in table]:
                raise UsageError(f"{option('keep_where')} {text}: {clean(texts[0])} has values that are not numbers")
            chosen &= np.broadcast_to(condition.holds(table), len(states))
        if not self._ranked:
            return np.flatnonzero(chosen).tolist()
        ranked = set[int]()
        for count, metric, sign in self._ranked:
            usable = np.flatnonzero(chosen & np.isfinite(columns[metric]))
            order = np.argsort(sign * columns[metric][usable], kind="stable")
            ranked.update(usable[order[:count]].tolist())
        return sorted(ranked)

    def _condition(self, index: int, text: str, names: "PointNames") -> tuple[str, Condition]:
        with concerning("keep_where", index):
            return text, parse_condition(with_flags(text), names, option("keep_where"))


class PointNames(Vocabulary):
    """What varies, as conditions on points name it; metrics; and each status as what holds or does not."""

    def __init__(self, parameters: Sequence[str], metrics: Sequence[str]) -> None:
        known = ParameterNames(parameters)
        short = {name: path for name in known.names if (path := known.column(name))}
        super().__init__({**short, **{name: name for name in (*metrics, *STATUSES)}})

    def is_count(self, column: str) -> bool:
        return column in STATUSES


def _ranked(name: str, index: int, text: str, metrics: Sequence[str]) -> tuple[int, str]:
    """The count and the metric of `4:drift`."""
    with concerning(name, index):
        found = _RANKED.fullmatch(text)
        if not found:
            raise BadValueError(option(name), text, "a number of points and a metric, 4:drift")
        metric = found[2].strip()
        if metric not in metrics:
            raise UnknownNameError("metric", metric, metrics, where=option(name))
        return int(found[1]), metric
