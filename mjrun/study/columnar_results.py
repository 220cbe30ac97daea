"""Results of many points as columns: a few bytes for each number of a point."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import get_args, overload

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.study.spec import PointResult, Status

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
