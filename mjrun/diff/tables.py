"""Compares tables, and recordings as tables of states, in memory that does not grow with their length."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from mjrun.diff.alignment import Pairs, Rows, RowStream, pairs_by_key, pairs_by_row
from mjrun.diff.result import CellDifference, ColumnDifference, TableDifference, UnitDifference
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import FileError


class ColumnComparison:
    """The differences of one column, b − a, gathered block by block."""

    def __init__(self, name: str, unit: str, tolerance: Tolerance) -> None:
        self._name, self._unit, self._tolerance = name, unit, tolerance
        self._differing, self._squares, self._last = 0, 0.0, 0.0
        self._maximum, self._worst_size = 0.0, -1.0
        self._first: CellDifference | None = None
        self._worst: CellDifference | None = None

    def add_equal(self) -> None:
        """Takes rows in which all bits are the same."""
        self._last = 0.0

    def add(self, pairs: Pairs, index: int) -> None:
        """Takes the column `index` of `pairs`."""
        a, b = pairs.a[:, index], pairs.b[:, index]
        with np.errstate(invalid="ignore", over="ignore"):
            difference = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, b - a)
            self._squares += float(difference @ difference)
        size = np.where(np.isnan(difference), np.inf, np.abs(difference))
        self._maximum = max(self._maximum, float(size.max()))
        self._last = float(difference[-1])

        beyond = np.flatnonzero(~self._tolerance.agree(a, b))
        if not len(beyond):
            return
        self._differing += len(beyond)
        self._first = self._first or _cell(pairs, index, int(beyond[0]))
        worst = int(beyond[size[beyond].argmax()])
        if size[worst] > self._worst_size:
            self._worst_size, self._worst = float(size[worst]), _cell(pairs, index, worst)

    def result(self, rows: int) -> ColumnDifference:
        """What was found in so many rows."""
        return ColumnDifference(
            name=self._name,
            unit=self._unit,
            atol=self._tolerance.atol,
            rtol=self._tolerance.rtol,
            differing=self._differing,
            maximum=_finite(self._maximum),
            rms=_finite(math.sqrt(self._squares / rows)) if rows else 0.0,
            last=_finite(self._last),
            first=self._first,
            worst=self._worst,
        )


def compare_rows(
    a: Rows,
    b: Rows,
    columns: Sequence[str],
    key: str | None,
    tolerances: Tolerances,
    names_a: Sequence[str],
    names_b: Sequence[str],
) -> TableDifference:
    """Compares the rows of two tables in one pass.

    Args:
      columns: those to compare, which both have.
      key: the column that tells which rows belong together, and never falls; None for rows of the same number.
      names_a, names_b: all columns that are to be compared, of each.

    Raises:
      FileError: a table has no rows, cannot be read, or its key falls.
    """
    stream_a, stream_b = RowStream(a, columns, key), RowStream(b, columns, key)
    comparisons = [
        ColumnComparison(name, a.units.get(name) or b.units.get(name) or "", tolerances.of(name)) for name in columns
    ]
    rows = 0
    for pairs in _pairs(stream_a, stream_b, key, tolerances):
        rows += len(pairs.a)
        differs = (pairs.a.view(np.int64) != pairs.b.view(np.int64)).any(axis=0)
        for index, comparison in enumerate(comparisons):
            if differs[index]:
                comparison.add(pairs, index)
            else:
                comparison.add_equal()

    for table, stream in ((a, stream_a), (b, stream_b)):
        if not stream.row:
            raise FileError(table.path, "has no rows")
    found = [comparison.result(rows) for comparison in comparisons]
    return TableDifference(
        aligned=key or "row",
        rows=rows,
        rows_a=stream_a.row,
        rows_b=stream_b.row,
        only_a=stream_a.unmatched,
        only_b=stream_b.unmatched,
        columns=sorted(found, key=_badness, reverse=True),
        columns_only_a=[name for name in names_a if name not in names_b],
        columns_only_b=[name for name in names_b if name not in names_a],
        units=_unit_differences(a, b),
    )


def _pairs(a: RowStream, b: RowStream, key: str | None, tolerances: Tolerances) -> Iterator[Pairs]:
    return pairs_by_row(a, b) if key is None else pairs_by_key(a, b, tolerances.of_key(key))


def _badness(column: ColumnDifference) -> tuple[bool, float, int]:
    return column.differing > 0, math.inf if column.maximum is None else column.maximum, column.differing


def _unit_differences(a: Rows, b: Rows) -> list[UnitDifference]:
    both = [name for name in a.names if a.units.get(name) and b.units.get(name)]
    return [UnitDifference(name, a.units[name], b.units[name]) for name in both if a.units[name] != b.units[name]]


def _cell(pairs: Pairs, column: int, index: int) -> CellDifference:
    return CellDifference(
        row=int(pairs.rows_a[index]) + 1,
        row_b=int(pairs.rows_b[index]) + 1,
        at=None if pairs.keys is None else float(pairs.keys[index]),
        a=repr(float(pairs.a[index, column])),
        b=repr(float(pairs.b[index, column])),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
