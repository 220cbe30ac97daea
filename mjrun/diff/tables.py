"""Compares tables, and recordings as tables of states, in memory that does not grow with their length."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mjrun.diff.alignment import EqualRows, Pairs, Rows, RowStream, Skip, pairs_by_key, pairs_by_row
from mjrun.diff.result import CellDifference, ColumnDifference, TableDifference, UnitDifference
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import FileError


class ColumnComparison:
    """The differences of columns, b − a, gathered block by block.

    Args:
      names: of the columns.
      tolerances: of each.
    """

    def __init__(self, names: Sequence[str], tolerances: Sequence[Tolerance]) -> None:
        count = len(names)
        self._names, self._tolerances = names, tolerances
        self._rows, self._differing = 0, np.zeros(count, np.int64)
        self._squares, self._last, self._maximum = np.zeros(count), np.zeros(count), np.zeros(count)
        self._first: list[CellDifference | None] = [None] * count
        self._worst: list[CellDifference | None] = [None] * count
        self._worst_size = np.full(count, -1.0)

    def add_equal(self, rows: int) -> None:
        """Takes rows in which all bits are the same."""
        self._rows += rows
        self._last[:] = 0

    def add(self, pairs: Pairs) -> None:
        """Takes rows that belong together."""
        columns = np.flatnonzero((pairs.a.view(np.int64) != pairs.b.view(np.int64)).any(axis=0))
        self.add_equal(len(pairs.a))
        if not len(columns):
            return
        a, b = pairs.a[:, columns].T.copy(), pairs.b[:, columns].T.copy()
        with np.errstate(invalid="ignore", over="ignore"):
            difference = b - a
            if not np.isfinite(difference).all():
                difference[(a == b) | (np.isnan(a) & np.isnan(b))] = 0
                difference[np.isnan(difference)] = np.inf
            size = np.abs(difference)
            self._squares[columns] += np.einsum("ij,ij->i", size, size)
        self._maximum[columns] = np.maximum(self._maximum[columns], size.max(axis=1))
        self._last[columns] = difference[:, -1]
        for index, column in enumerate(columns.tolist()):
            beyond = np.flatnonzero(~self._tolerances[column].agree(a[index], b[index]))
            if len(beyond):
                self._add_beyond(pairs, column, beyond, size[index])

    def _add_beyond(self, pairs: Pairs, column: int, beyond: np.ndarray, size: np.ndarray) -> None:
        """Takes the rows of one column that are beyond its tolerance."""
        self._differing[column] += len(beyond)
        self._first[column] = self._first[column] or _cell(pairs, column, int(beyond[0]))
        worst = int(beyond[size[beyond].argmax()])
        if size[worst] > self._worst_size[column]:
            self._worst_size[column], self._worst[column] = size[worst], _cell(pairs, column, worst)

    def results(self, units: Mapping[str, str]) -> list[ColumnDifference]:
        """What was found in each column."""
        rms = np.sqrt(self._squares / max(1, self._rows))
        return [
            ColumnDifference(
                name=name,
                unit=units[name],
                atol=self._tolerances[i].atol,
                rtol=self._tolerances[i].rtol,
                differing=int(self._differing[i]),
                maximum=_finite(float(self._maximum[i])),
                rms=_finite(float(rms[i])),
                last=_finite(float(self._last[i])),
                first=self._first[i],
                worst=self._worst[i],
            )
            for i, name in enumerate(self._names)
        ]


def compare_rows(
    a: Rows,
    b: Rows,
    columns: Sequence[str],
    key: str | None,
    tolerances: Tolerances,
    names_a: Sequence[str],
    names_b: Sequence[str],
    skip: Skip = lambda: 0,
) -> TableDifference:
    """Compares the rows of two tables in one pass.

    Args:
      columns: those to compare, which both have.
      key: the column that tells which rows belong together, and never falls; None for rows of the same number.
      names_a, names_b: all columns that are to be compared, of each.
      skip: passes over equal rows, where that is faster than to look at them.

    Raises:
      FileError: a table has no rows, cannot be read, or its key falls.
    """
    stream_a, stream_b = RowStream(a, columns, key), RowStream(b, columns, key)
    comparison = ColumnComparison(columns, [tolerances.of(name) for name in columns])
    rows = 0
    for pairs in _pairs(stream_a, stream_b, key, tolerances, skip):
        if isinstance(pairs, EqualRows):
            rows += pairs.count
            comparison.add_equal(pairs.count)
        else:
            rows += len(pairs.a)
            comparison.add(pairs)

    for table, stream in ((a, stream_a), (b, stream_b)):
        if not stream.row:
            raise FileError(table.path, "has no rows")
    differences = comparison.results({name: a.units.get(name) or b.units.get(name) or "" for name in columns})
    return TableDifference(
        aligned=key or "row",
        rows=rows,
        rows_a=stream_a.row,
        rows_b=stream_b.row,
        only_a=stream_a.unmatched,
        only_b=stream_b.unmatched,
        columns=sorted(differences, key=_badness, reverse=True),
        columns_only_a=[name for name in names_a if name not in names_b],
        columns_only_b=[name for name in names_b if name not in names_a],
        units=_unit_differences(a, b),
    )


def _pairs(
    a: RowStream, b: RowStream, key: str | None, tolerances: Tolerances, skip: Skip
) -> Iterator[Pairs | EqualRows]:
    return pairs_by_row(a, b, skip) if key is None else pairs_by_key(a, b, tolerances.of_key(key), skip)


def _badness(column: ColumnDifference) -> tuple[bool, float, int]:
    return column.differing > 0, math.inf if column.maximum is None else column.maximum, column.differing


def _unit_differences(a: Rows, b: Rows) -> list[UnitDifference]:
    both = [name for name in a.names if a.units.get(name) and b.units.get(name)]
    return [UnitDifference(name, a.units[name], b.units[name]) for name in both if a.units[name] != b.units[name]]


def _cell(pairs: Pairs, column: int, index: int) -> CellDifference:
    return CellDifference(
        row=int(pairs.rows_a[index]),
        row_b=int(pairs.rows_b[index]),
        at=None if pairs.keys is None else float(pairs.keys[index]),
        a=repr(float(pairs.a[index, column])),
        b=repr(float(pairs.b[index, column])),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
