"""The comparison of tables, and of recordings as tables of states.

Rows are aligned first, into pairs that belong together and rows that only one table has. A row has a key that never
decreases: the time, or the step of a state; memory contains a few blocks of either table. If the cells of several
columns are the key, as for the points of two studies, rows may be in any order, and are held in memory.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.diff.result import CellDifference, ColumnDifference, TableDifference, UnitDifference, UnmatchedRows
from mjrun.diff.tolerances import Tolerance, Tolerances, as_number, as_numbers, cell_text, compare_cells, finite_or_none
from mjrun.errors import FileError, clean, option

SMALLEST = -1073  # exponent of the smallest float
ENOUGH = 2**16  # the number of values to compare at a time, or a few more


class RowSource(Protocol):
    """Rows of cells, as an open table provides them."""

    @property
    def path(self) -> Path:
        """The name of the table in messages."""
        ...

    @property
    def names(self) -> Sequence[str]:
        """The names of the columns."""
        ...

    @property
    def units(self) -> Mapping[str, str]:
        """The known units of the columns by name."""
        ...

    def blocks(self) -> Iterator[np.ndarray]:
        """Yields the rows once: blocks `(n, columns)` of float64, or of objects if they contain other cells."""
        ...


@dataclass(frozen=True)
class RowPairs:
    """The pairs of rows that belong together.

    Attributes:
      a, b: float64 or object `(n, columns)`.
      rows_a, rows_b: their numbers, counted from 0, `(n,)`.
      keys: the keys of A's rows, `(n,)`, numbers or texts; None if rows have none.
    """

    a: np.ndarray
    b: np.ndarray
    rows_a: np.ndarray
    rows_b: np.ndarray
    keys: np.ndarray | None


@dataclass(frozen=True)
class IdenticalRows:
    """A run of rows skipped unparsed because their bytes are identical."""

    count: int


# Skips rows that are identical in both tables, from the current row of each, and returns their number.
Skip = Callable[[], int]


class RowStream:
    """A stream of the rows of a table, from the first one that is not merged yet.

    Args:
      columns: the columns to compare.
      key: the column with the keys; None for rows without keys.

    Attributes:
      values: the loaded rows, float64 or object `(n, columns)`.
      keys: their keys `(n,)`; empty if rows have none.
      row: the number of the first, counted from 0.
      is_ended: true if no more rows follow.
    """

    def __init__(self, table: RowSource, columns: Sequence[str], key: str | None) -> None:
        names = list(table.names)
        self._table, self._blocks = table, table.blocks()
        self._indices = [names.index(name) for name in columns]
        self._key_name = key
        self._key = None if key is None else names.index(key)
        self._last = -np.inf  # key
        self.values, self.keys = np.empty((0, len(columns))), np.empty(0)
        self.row, self.is_ended = 0, False
        self._unmatched, self._first_unmatched = 0, (None, np.nan)

    def __len__(self) -> int:
        return len(self.values)

    def fill(self) -> None:
        """Loads more blocks of rows, unless all are loaded."""
        blocks: list[np.ndarray] = []
        missing = ENOUGH
        while missing > 0 and (block := next(self._blocks, None)) is not None:
            blocks.append(block)
            missing -= block.size
        if not blocks:
            self.is_ended = True
            return
        block = np.concatenate(blocks) if len(blocks) > 1 else blocks[0]
        if self._key is not None:
            keys = self._numbers(block[:, self._key])
            self._require_ascending(keys)
            self.keys = np.concatenate([self.keys, keys])
        values = block[:, self._indices]
        self.values = np.concatenate([self.values, values]) if len(self.values) else values

    def pass_over(self, count: int) -> None:
        """Counts the next rows, which were skipped."""
        self.row += count
        self._last = -np.inf

    def drop(self, count: int) -> None:
        """Removes the first rows, which are merged."""
        self.values, self.keys = self.values[count:], self.keys[count:]
        self.row += count

    def note_unmatched(self, indices: np.ndarray) -> None:
        """Counts loaded rows that match none of the other table."""
        if len(indices) and not self._unmatched:
            first = int(indices[0])
            self._first_unmatched = (self.row + first, self.keys[first] if len(self.keys) else np.nan)
        self._unmatched += len(indices)

    @property
    def unmatched(self) -> UnmatchedRows:
        """The rows that match none of the other table."""
        row, key = self._first_unmatched
        return UnmatchedRows(self._unmatched, row, None if np.isnan(key) else float(key))

    def _numbers(self, keys: np.ndarray) -> np.ndarray:
        numbers = as_numbers(keys)
        if numbers is None:
            raise FileError(self._table.path, f"{self._key_name} contains values that are not numbers")
        return numbers

    def _require_ascending(self, keys: np.ndarray) -> None:
        before = np.concatenate([[self._last], keys[:-1]])
        falls = ~(keys >= before)  # NaN too
        if falls.any():
            at = int(falls.argmax())
            row = self.row + len(self) + at
            fault = f"is {keys[at]}, but must be a number"
            if not np.isnan(keys[at]):
                fault = f"{keys[at]:.9g} follows {before[at]:.9g}, but must not decrease"
            raise FileError(
                self._table.path,
                f"row {row}: {self._key_name} {fault}",
                f"{option('align')} row compares rows by their number",
            )
        self._last = keys[-1]


def pairs_in_order(
    a: RowStream, b: RowStream, tolerance: Tolerance | None, skip: Skip
) -> Iterator[RowPairs | IdenticalRows]:
    """Yields the rows whose keys agree, several with one key in their order; unmatched rows are counted.

    Args:
      tolerance: that of the keys; None matches rows by number.
    """
    while True:
        yield from _equal_rows(a, b, skip)
        if not _fill(a, b):
            return
        count = min(len(a), len(b))
        if not count:
            _pass_over(a, b)
        elif tolerance is None or _near(a.keys[:count], b.keys[:count], tolerance).all():
            yield _first_pairs(a, b, count)
        else:
            yield from _merged(a, b, tolerance)


def _equal_rows(a: RowStream, b: RowStream, skip: Skip) -> Iterator[IdenticalRows]:
    """Skips equal rows if no loaded rows of either wait."""
    if len(a) or len(b):
        return
    if count := skip():
        a.pass_over(count)
        b.pass_over(count)
        yield IdenticalRows(count)


def _fill(a: RowStream, b: RowStream) -> bool:
    """Loads rows of both until each has some or is at its end; returns whether either has any."""
    for stream in (a, b):
        while not len(stream) and not stream.is_ended:
            stream.fill()
    return bool(len(a) or len(b))


def _pass_over(a: RowStream, b: RowStream) -> None:
    """Counts the rows of one table as unmatched when the other is at its end."""
    for stream in (a, b):
        stream.note_unmatched(np.arange(len(stream)))
        stream.drop(len(stream))


def _first_pairs(a: RowStream, b: RowStream, count: int) -> RowPairs:
    numbers = np.arange(count)
    keys = a.keys[:count] if len(a.keys) else None
    pairs = RowPairs(a.values[:count], b.values[:count], a.row + numbers, b.row + numbers, keys)
    a.drop(count)
    b.drop(count)
    return pairs


def _merged(a: RowStream, b: RowStream, tolerance: Tolerance) -> Iterator[RowPairs]:
    """Yields the pairs among the loaded rows, up to where a row may match one that is not loaded yet."""
    in_a, in_b = _matches(a.keys, b.keys, tolerance)
    end_a, end_b = _ends(a, b, in_a, in_b, tolerance)
    if not end_a and not end_b:
        min((stream for stream in (a, b) if not stream.is_ended), key=lambda stream: stream.keys[-1]).fill()
        return

    settled = (in_a < end_a) & (in_b < end_b)
    in_a, in_b = in_a[settled], in_b[settled]
    if len(in_a):
        yield RowPairs(a.values[in_a], b.values[in_b], a.row + in_a, b.row + in_b, a.keys[in_a])
    for stream, end, matched in ((a, end_a, in_a), (b, end_b, in_b)):
        stream.note_unmatched(np.setdiff1d(np.arange(end), matched, assume_unique=True))
        stream.drop(end)


def _ends(a: RowStream, b: RowStream, in_a: np.ndarray, in_b: np.ndarray, tolerance: Tolerance) -> tuple[int, int]:
    """Returns the number of settled rows of each: no row that is still to come can match them."""
    last = [stream.keys[-1] for stream in (a, b) if not stream.is_ended]
    if not last:
        return len(a), len(b)
    limit = float(min(last))
    if math.isfinite(limit):  # a row near a settled one must have no nearer match
        limit -= 2 * (tolerance.atol + tolerance.rtol * abs(limit))
    end_a, end_b = int(np.searchsorted(a.keys, limit)), int(np.searchsorted(b.keys, limit))
    pairs_a, pairs_b = in_a[in_b < end_b], in_b[in_a < end_a]  # both rows of a pair are settled
    return max([end_a, *(pairs_a[-1:] + 1)]), max([end_b, *(pairs_b[-1:] + 1)])


def _matches(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> tuple[np.ndarray, np.ndarray]:
    """Returns the indices of keys that agree, each the nearest of the other; several with one key in their order."""
    if not len(a) or not len(b):
        return np.empty(0, int), np.empty(0, int)
    to_b, to_a = _nearest(a, b), _nearest(b, a)
    index = np.arange(len(a))
    mutual = (to_a[to_b] == index) & _near(a, b[to_b], tolerance)
    return index[mutual], to_b[mutual]


def _nearest(keys: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns the index of the nearest of `others` for each of `keys`; repeated keys get repeated ones in order."""
    after = np.minimum(np.searchsorted(others, keys), len(others) - 1)
    before = np.maximum(after - 1, 0)
    with np.errstate(invalid="ignore"):  # of two infinite ones
        nearest = np.where(np.abs(keys - others[before]) < np.abs(keys - others[after]), before, after)
    first = np.searchsorted(others, others[nearest])
    return np.minimum(first + np.arange(len(keys)) - np.searchsorted(keys, keys), len(others) - 1)


def _near(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> np.ndarray:
    """Returns where keys agree; 0 agrees with −0, and an infinite key only with itself."""
    with np.errstate(invalid="ignore"):
        near = np.abs(a - b) <= tolerance.atol + tolerance.rtol * np.abs(b)
    return (a == b) | (near & np.isfinite(a) & np.isfinite(b))


class KeyedRows:
    """All rows of a table, by their keys.

    Args:
      columns: the columns to compare.
      key: the columns whose cells are the key.

    Attributes:
      values: the cells to compare, `(n, columns)`.
      texts: the keys, as messages show them.
      row: the number of rows.
      unmatched: the rows that match none of the other table.
    """

    def __init__(self, table: RowSource, columns: Sequence[str], key: Sequence[str]) -> None:
        names, blocks = list(table.names), list(table.blocks())
        rows = np.concatenate(blocks) if blocks else np.empty((0, len(names)))
        self.values = rows[:, [names.index(name) for name in columns]]
        cells = rows[:, [names.index(name) for name in key]].tolist()
        self.texts = [", ".join(f"{clean(n)} = {_text(c)}" for n, c in zip(key, row, strict=True)) for row in cells]
        self.row = len(rows)
        self.unmatched = UnmatchedRows(0, None, None)
        self._places: dict[tuple[str, int], int] = {}
        counts: dict[str, int] = {}
        for index, text in enumerate(self.texts):
            number = counts[text] = counts.get(text, -1) + 1
            self._places[text, number] = index

    def matches(self, other: "KeyedRows") -> tuple[np.ndarray, np.ndarray]:
        """Returns indices of rows with the same key in both, repeated keys in order; unmatched rows are counted."""
        both = [(index, other._places[key]) for key, index in self._places.items() if key in other._places]
        pairs = np.array(sorted(both), int).reshape(-1, 2)
        for rows, matched in ((self, pairs[:, 0]), (other, pairs[:, 1])):
            unmatched = np.setdiff1d(np.arange(rows.row), matched)
            if len(unmatched):
                first = int(unmatched[0])
                rows.unmatched = UnmatchedRows(len(unmatched), first, None, rows.texts[first])
        return pairs[:, 0], pairs[:, 1]


def pairs_by_columns(a: KeyedRows, b: KeyedRows) -> Iterator[RowPairs]:
    """Yields the rows with the same key."""
    rows_a, rows_b = a.matches(b)
    if len(rows_a):
        keys = np.array(a.texts, object)[rows_a]
        yield RowPairs(a.values[rows_a], b.values[rows_b], rows_a, rows_b, keys)


def _text(cell: float | int | str) -> str:
    """Formats a cell of a key: the same for 3, 3.0 and the text 3, for 0 and −0, for an empty and a missing text."""
    try:
        cell = as_number(cell)
    except ValueError:
        return clean(str(cell))
    if cell != cell:
        return ""
    whole = cell == int(cell) if abs(cell) < np.inf else False
    return str(int(cell)) if whole else cell_text(cell)


class _ColumnDifferenceAccumulator:
    """The differences of columns, b − a, accumulated block by block.

    Args:
      names: the names of the columns.
      tolerances: the tolerance of each column.
    """

    def __init__(self, names: Sequence[str], tolerances: Sequence[Tolerance]) -> None:
        count = len(names)
        self._names, self._tolerances = names, tolerances
        self._rows, self._differing = 0, np.zeros(count, np.int64)
        self._last, self._maximum = np.zeros(count), np.zeros(count)
        self._squares = np.zeros(count)  # the sums of the squares, in units of 4 to the power of these exponents
        self._exponents = np.full(count, SMALLEST)
        self._first: list[CellDifference | None] = [None] * count
        self._worst: list[CellDifference | None] = [None] * count
        self._worst_size = np.full(count, -1.0)
        self._text = np.zeros(count, bool)

    def add_equal(self, rows: int) -> None:
        """Adds rows in which all bits are the same."""
        self._rows += rows
        self._last[:] = 0

    def add(self, pairs: RowPairs) -> None:
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

    def _add_numbers(self, pairs: RowPairs, columns: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
        """Adds the numbers of some columns, float64 `(columns, n)`."""
        with np.errstate(invalid="ignore", over="ignore"):
            difference = b - a
            if not np.isfinite(difference).all():
                difference[(a == b) | (np.isnan(a) & np.isnan(b))] = 0
                difference[np.isnan(difference)] = np.inf
        agree = [self._tolerances[column].agree(a[i], b[i]) for i, column in enumerate(map(int, columns))]
        self._add_differences(pairs, columns, np.array(agree), difference)

    def _add_cells(self, pairs: RowPairs, column: int, a: np.ndarray, b: np.ndarray) -> None:
        """Adds the cells of a column that contains texts or large integers."""
        agree, difference = compare_cells(a, b, self._tolerances[column])
        self._text[column] |= any(isinstance(cell, str) for cell in (*a, *b))
        self._add_differences(pairs, np.array([column]), agree[None], difference[None])

    def _add_differences(self, pairs: RowPairs, columns: np.ndarray, agree: np.ndarray, difference: np.ndarray) -> None:
        size = np.abs(difference)
        self._add_squares(columns, size)
        self._maximum[columns] = np.maximum(self._maximum[columns], size.max(axis=1))
        self._last[columns] = difference[:, -1]
        for index, column in enumerate(columns.tolist()):
            beyond = np.flatnonzero(~agree[index])
            if len(beyond):
                self._add_beyond(pairs, column, beyond, size[index])

    def _add_squares(self, columns: np.ndarray, size: np.ndarray) -> None:
        """Adds the squares of differences, scaled so that they neither overflow nor vanish."""
        largest, before = np.where(np.isfinite(size), size, 0).max(axis=1), self._exponents[columns]
        exponents = np.maximum(np.where(largest > 0, np.frexp(largest)[1], SMALLEST), before)
        scaled = np.ldexp(size, -exponents[:, None])
        self._squares[columns] = np.ldexp(self._squares[columns], 2 * (before - exponents))
        self._squares[columns] += np.einsum("ij,ij->i", scaled, scaled)
        self._exponents[columns] = exponents

    def _add_beyond(self, pairs: RowPairs, column: int, beyond: np.ndarray, size: np.ndarray) -> None:
        """Adds the rows of one column that are beyond its tolerance."""
        self._differing[column] += len(beyond)
        self._first[column] = self._first[column] or _cell(pairs, column, int(beyond[0]))
        worst = int(beyond[size[beyond].argmax()])
        if size[worst] > self._worst_size[column]:
            self._worst_size[column], self._worst[column] = size[worst], _cell(pairs, column, worst)

    def results(self, units: Mapping[str, str]) -> list[ColumnDifference]:
        """Returns the differences of each column."""
        rms = np.ldexp(np.sqrt(self._squares / max(1, self._rows)), self._exponents)
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
    a: RowSource,
    b: RowSource,
    columns: Sequence[str],
    key: str | Sequence[str] | None,
    tolerances: Tolerances,
    names_a: Sequence[str],
    names_b: Sequence[str],
    skip: Skip = lambda: 0,
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
        stream_a, stream_b = RowStream(a, columns, key), RowStream(b, columns, key)
        tolerance = None if key is None else tolerances.of_key(key)
        all_pairs = pairs_in_order(stream_a, stream_b, tolerance, skip)
    else:
        stream_a, stream_b = KeyedRows(a, columns, key), KeyedRows(b, columns, key)
        all_pairs = pairs_by_columns(stream_a, stream_b)
        key = ", ".join(key)
    comparison = _ColumnDifferenceAccumulator(columns, [tolerances.of(name) for name in columns])
    rows = 0
    for pairs in all_pairs:
        if isinstance(pairs, IdenticalRows):
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


def _unit_differences(a: RowSource, b: RowSource) -> list[UnitDifference]:
    both = [name for name in a.names if a.units.get(name) and b.units.get(name)]
    return [UnitDifference(name, a.units[name], b.units[name]) for name in both if a.units[name] != b.units[name]]


def _cell(pairs: RowPairs, column: int, index: int) -> CellDifference:
    key = None if pairs.keys is None else pairs.keys[index]
    return CellDifference(
        row=int(pairs.rows_a[index]),
        row_b=int(pairs.rows_b[index]),
        at=None if key is None or isinstance(key, str) else float(key),
        a=cell_text(pairs.a.item(index, column)),
        b=cell_text(pairs.b.item(index, column)),
        key=key if isinstance(key, str) else "",
    )
