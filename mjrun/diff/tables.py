"""The comparison of tables, and of recordings as tables of states, in memory that does not grow with their length."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.diff import row_alignment
from mjrun.diff.result import CellDifference, ColumnDifference, TableDifference, UnitDifference
from mjrun.diff.tolerances import Tolerance, Tolerances, as_numbers, cell_text, compare_cells, finite_or_none
from mjrun.errors import FileError


class ColumnDifferences:
    """The differences of columns, b − a, accumulated block by block.

    Args:
      names: the names of the columns.
      tolerances: the tolerance of each column.
    """

    def __init__(self, names: Sequence[str], tolerances: Sequence[Tolerance]) -> None:
        count = len(names)
        self._names, self._tolerances = names, tolerances
        self._rows, self._differing = 0, np.zeros(count, np.int64)
        self._squares, self._last, self._maximum = np.zeros(count), np.zeros(count), np.zeros(count)
        self._first: list[CellDifference | None] = [None] * count
        self._worst: list[CellDifference | None] = [None] * count
        self._worst_size = np.full(count, -1.0)
        self._text = np.zeros(count, bool)

    def add_equal(self, rows: int) -> None:
        """Adds rows in which all bits are the same."""
        self._rows += rows
        self._last[:] = 0

    def add(self, pairs: row_alignment.Pairs) -> None:
        """Adds rows that belong together."""
        self.add_equal(len(pairs.a))
        if pairs.a.dtype == pairs.b.dtype == np.float64:
            columns = np.flatnonzero((pairs.a.view(np.int64) != pairs.b.view(np.int64)).any(axis=0))
            if len(columns):
                self._add_numbers(pairs, columns, pairs.a[:, columns].T.copy(), pairs.b[:, columns].T.copy())
            return
        for column in range(len(self._names)):
            cells = pairs.a[:, column], pairs.b[:, column]
            a, b = map(as_numbers, cells)
            if a is None or b is None:
                self._add_cells(pairs, column, *cells)
            elif not np.array_equal(a.view(np.int64), b.view(np.int64)):
                self._add_numbers(pairs, np.array([column]), a[None], b[None])

    def _add_numbers(self, pairs: row_alignment.Pairs, columns: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
        """Adds the numbers of some columns, float64 `(columns, n)`."""
        with np.errstate(invalid="ignore", over="ignore"):
            difference = b - a
            if not np.isfinite(difference).all():
                difference[(a == b) | (np.isnan(a) & np.isnan(b))] = 0
                difference[np.isnan(difference)] = np.inf
        agree = [self._tolerances[column].agree(a[i], b[i]) for i, column in enumerate(map(int, columns))]
        self._add_differences(pairs, columns, np.array(agree), difference)

    def _add_cells(self, pairs: row_alignment.Pairs, column: int, a: np.ndarray, b: np.ndarray) -> None:
        """Adds the cells of a column that contains texts or large integers."""
        agree, difference = compare_cells(a, b, self._tolerances[column])
        self._text[column] |= any(isinstance(cell, str) for cell in (*a, *b))
        self._add_differences(pairs, np.array([column]), agree[None], difference[None])

    def _add_differences(
        self, pairs: row_alignment.Pairs, columns: np.ndarray, agree: np.ndarray, difference: np.ndarray
    ) -> None:
        size = np.abs(difference)
        with np.errstate(over="ignore"):
            self._squares[columns] += np.einsum("ij,ij->i", size, size)
        self._maximum[columns] = np.maximum(self._maximum[columns], size.max(axis=1))
        self._last[columns] = difference[:, -1]
        for index, column in enumerate(columns.tolist()):
            beyond = np.flatnonzero(~agree[index])
            if len(beyond):
                self._add_beyond(pairs, column, beyond, size[index])

    def _add_beyond(self, pairs: row_alignment.Pairs, column: int, beyond: np.ndarray, size: np.ndarray) -> None:
        """Adds the rows of one column that are beyond its tolerance."""
        self._differing[column] += len(beyond)
        self._first[column] = self._first[column] or _cell(pairs, column, int(beyond[0]))
        worst = int(beyond[size[beyond].argmax()])
        if size[worst] > self._worst_size[column]:
            self._worst_size[column], self._worst[column] = size[worst], _cell(pairs, column, worst)

    def results(self, units: Mapping[str, str]) -> list[ColumnDifference]:
        """Returns the differences of each column."""
        rms = np.sqrt(self._squares / max(1, self._rows))
        return [
            ColumnDifference(
                name=name,
                unit=units[name],
                atol=self._tolerances[i].atol,
                rtol=self._tolerances[i].rtol,
                differing=int(self._differing[i]),
                maximum=finite_or_none(float(self._maximum[i])),
                rms=finite_or_none(float(rms[i])),
                last=finite_or_none(float(self._last[i])),
                first=self._first[i],
                worst=self._worst[i],
                text=bool(self._text[i]),
            )
            for i, name in enumerate(self._names)
        ]


def compare_rows(
    a: row_alignment.RowSource,
    b: row_alignment.RowSource,
    columns: Sequence[str],
    key: str | Sequence[str] | None,
    tolerances: Tolerances,
    names_a: Sequence[str],
    names_b: Sequence[str],
    skip: row_alignment.Skip = lambda: 0,
) -> TableDifference:
    """Compares the rows of two tables in one pass.

    Args:
      columns: the columns to compare, which both have.
      key: the column by which rows are matched, which never decreases; None matches rows by number. Several columns may
        be in any order; then the rows of both are held in memory.
      names_a, names_b: all selected columns of each.
      skip: a function that skips equal rows, if that is faster than reading them.

    Raises:
      FileError: a table has no rows, cannot be read, or its key decreases.
    """
    if key is None or isinstance(key, str):
        stream_a, stream_b = row_alignment.RowStream(a, columns, key), row_alignment.RowStream(b, columns, key)
        tolerance = None if key is None else tolerances.of_key(key)
        all_pairs = row_alignment.pairs_in_order(stream_a, stream_b, tolerance, skip)
    else:
        stream_a, stream_b = row_alignment.KeyedRows(a, columns, key), row_alignment.KeyedRows(b, columns, key)
        all_pairs = row_alignment.pairs_by_columns(stream_a, stream_b)
        key = ", ".join(key)
    comparison = ColumnDifferences(columns, [tolerances.of(name) for name in columns])
    rows = 0
    for pairs in all_pairs:
        if isinstance(pairs, row_alignment.SkippedRows):
            rows += pairs.count
            comparison.add_equal(pairs.count)
        else:
            rows += len(pairs.a)
            comparison.add(pairs)

    for table, stream in ((a, stream_a), (b, stream_b)):
        if not stream.row:
            raise FileError(table.path, "has no rows")
    differences = comparison.results({name: a.units.get(name) or b.units.get(name) or "" for name in columns})
    units = _unit_differences(a, b)
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
        units=units,
        shared_agree=rows > 0 and not units and not any(column.differing for column in differences),
    )


def _badness(column: ColumnDifference) -> tuple[bool, float, int]:
    return column.differing > 0, math.inf if column.maximum is None else column.maximum, column.differing


def _unit_differences(a: row_alignment.RowSource, b: row_alignment.RowSource) -> list[UnitDifference]:
    both = [name for name in a.names if a.units.get(name) and b.units.get(name)]
    return [UnitDifference(name, a.units[name], b.units[name]) for name in both if a.units[name] != b.units[name]]


def _cell(pairs: row_alignment.Pairs, column: int, index: int) -> CellDifference:
    key = None if pairs.keys is None else pairs.keys[index]
    return CellDifference(
        row=int(pairs.rows_a[index]),
        row_b=int(pairs.rows_b[index]),
        at=None if key is None or isinstance(key, str) else float(key),
        a=cell_text(pairs.a.item(index, column)),
        b=cell_text(pairs.b.item(index, column)),
        key=key if isinstance(key, str) else "",
    )
