"""Tables that are being read: their names, and their rows in blocks of bounded size.

The formats share these functions. Text from a file is untrusted, and cleaned before a message shows it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from enum import IntEnum
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO, Protocol, TypeVar

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.decompression_limits import own_size
from mjrun.errors import CellError, FileError, quoted, shortened
from mjrun.formats.input_file import decoded, decoding
from mjrun.formats.text_lines import WholeLinePieces

ColumnFilter = Callable[[str], bool]
Stored = TypeVar("Stored")  # an array as its format stores it

EXACT = 2**53  # up to which float64 holds every integer
ENDLESS, PACKED = 2**32, 1100  # bytes of numbers that any file may expand to; and for each byte of the file
WIDEST = 4096  # columns of an array; a wider one is no table
PIECE = 2**17  # values in a block


class AcceptedCells(IntEnum):
    """The cells that a table may have.

    Attributes:
      NUMBERS: numbers, finite or not.
      GAPS: also missing ones, which become NaN.
      ANY: also texts, and integers beyond those of float64; a block with such a cell has the type object, and its
        cells are float, int and str.
    """

    NUMBERS = 0
    GAPS = 1
    ANY = 2


@dataclass(frozen=True, eq=False)
class TableReadStream:
    """A table that is being read: its names, and its rows in blocks.

    The function `read` of a format makes it from the path, for messages; the open file, which stays open until the last
    block is read; a filter for the columns; and the cells that they may have. It returns before the rows are read.

    Attributes:
      names: names of the accepted columns, in the order of the file.
      blocks: their rows, float64 or object `(n, columns)` (see `AcceptedCells`), n ≥ 1, each of bounded size; read on
        demand. Raises FileError if the file is not such a table.
      units: units by name, as far as the file states them.
      manifest: how mjrun made the file; None if the file does not state it.
      lines: the lines that the blocks are made from, where the format has a row on each; else None.
    """

    names: Sequence[str]
    blocks: Iterator[np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    manifest: dict[str, Any] | None = None
    lines: WholeLinePieces | None = None


class ArrayInFile(Protocol):
    """An array of a file, open for reading.

    Attributes:
      rows: number of rows.
      width: number of 8-byte values that a row takes.
    """

    rows: int
    width: int

    def read(self, start: int, count: int) -> np.ndarray:
        """Returns the rows from `start` on, numbers or texts `(count, columns)`; called in order."""
        ...


def array_contents(
    path: Path,
    columns: Mapping[str, tuple[Stored, int]],
    cells: AcceptedCells,
    opened: Callable[[str, Stored], ArrayInFile],
    units: Mapping[str, str],
    manifest: dict[str, Any] | None,
) -> TableReadStream:
    """Returns the table of columns that are parts of arrays.

    Args:
      columns: as `select_parts` returns them.
      opened: opens an array, given the name of its first column.

    Raises:
      FileError: an array holds something other than numbers, or arrays differ in length.
    """
    parts: list[tuple[ArrayInFile, list[int]]] = []
    lengths: dict[str, int] = {}
    for array, group in groupby(columns.items(), key=lambda column: column[1][0]):
        selected = list(group)
        first = selected[0][0]
        with decoding(path):
            parts.append((opened(first, array), [part for _, (_, part) in selected]))
        lengths[first] = parts[-1][0].rows
    require_equal_lengths(path, lengths)

    def read_rows(start: int, count: int) -> Iterator[np.ndarray]:
        for reader, indices in parts:
            rows = reader.read(start, count)
            for index in indices:
                column = rows[:, index]
                yield text_cells(column.tolist()) if column.dtype.kind in "OU" else number_cells(column, cells)

    width = sum(reader.width for reader, _ in parts)
    blocks = row_blocks(next(iter(lengths.values()), 0), width, read_rows)
    return TableReadStream(list(columns), decoded(path, blocks), units, manifest)


def select(path: Path, names: Sequence[str], wanted: ColumnFilter) -> dict[str, int]:
    """Returns the names that the filter accepts, each with its index.

    Raises:
      FileError: two of them are alike.
    """
    indices: dict[str, int] = {}
    for index, name in enumerate(names):
        if wanted(name):
            if name in indices:
                raise FileError(path, f"two columns are called {shown(name)}")
            indices[name] = index
    return indices


def select_parts(
    path: Path, arrays: Iterable[tuple[str, Sequence[int], Stored]], wanted: ColumnFilter
) -> dict[str, tuple[Stored, int]]:
    """Returns the columns that the filter accepts, each with its array and its index therein.

    Args:
      arrays: the shapes of arrays by name; a matrix gives several columns, `name/0`, `name/1`, …

    Raises:
      FileError: two of them are alike.
    """
    columns = [
        (column, array, part)
        for name, shape, array in arrays
        for part, column in enumerate([f"{name}/{index}" for index in range(shape[1])] if _is_wide(shape) else [name])
    ]
    return {column: columns[at][1:] for column, at in select(path, [name for name, _, _ in columns], wanted).items()}


def require_vector(path: Path, name: str, shape: Sequence[int], *, row_vectors: bool = False) -> None:
    """Raises FileError if an array with this shape is neither a column nor several; `row_vectors` are `(1, n)`."""
    if not shape or not (
        _is_wide(shape) or tuple(shape[1:]) in ((), (1,)) or (row_vectors and len(shape) == 2 and 1 in shape)
    ):
        expected = "(n, 1), (1, n) or (n, k)" if row_vectors else "(n,) or (n, k)"
        raise FileError(path, f"column {shown(name)} has the shape {tuple(shape)}, not {expected}")


def not_numbers(path: Path, name: str, content: str) -> CellError:
    """Returns the error of a column that holds something other than numbers."""
    return CellError(path, f"column {shown(name)} holds {content}, not numbers")


def row_blocks(rows: int, width: int, read: Callable[[int, int], Iterable[np.ndarray]]) -> Iterator[np.ndarray]:
    """Yields the blocks of a table, of bounded size.

    Args:
      width: values in a row, whether or not they are read.
      read: returns the columns `(count,)` of the rows from `start` on, given `start` and `count`; called in order.
    """
    size = max(1, PIECE // max(1, width))
    for start in range(0, rows, size):
        count = min(size, rows - start)
        yield side_by_side(list(read(start, count)), count)


def number_cells(values: np.ndarray, cells: AcceptedCells) -> np.ndarray:
    """Returns numbers of any type as float64, or as objects if some are integers that float64 cannot represent."""
    is_whole = cells is AcceptedCells.ANY and values.dtype.kind in "iu" and values.size
    if is_whole and (int(values.max()) > EXACT or int(values.min()) < -EXACT):
        return values.astype(object)
    return values.astype(np.float64)


def text_cells(texts: Sequence[str | None]) -> np.ndarray:
    """Returns a column of texts; empty ones become NaN, as some formats cannot hold a missing text otherwise."""
    column = np.empty(len(texts), object)
    column[:] = [text or np.nan for text in texts]
    return column


def side_by_side(columns: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """Returns the block of columns `(rows,)`, each float64 or object: of type object if one of them is."""
    kind = object if any(column.dtype == object for column in columns) else np.float64
    block = np.empty((len(columns), rows), kind)
    for target, column in zip(block, columns, strict=True):
        target[:] = column
    return block.T


def require_equal_lengths(path: Path, lengths: Mapping[str, int]) -> None:
    """Raises FileError if columns differ in length; lengths are given by name."""
    names = {length: name for name, length in lengths.items()}
    if len(names) > 1:
        examples = " and ".join(f"{shown(name)} {length}" for length, name in list(names.items())[:2])
        raise FileError(path, f"columns differ in rows: {examples}")


def require_plausible_size(path: Path, rows: int, columns: int, file: BinaryIO | None = None) -> None:
    """Raises FileError if a file is too small for the number of values that its header promises.

    Common compression makes a thousandth of equal numbers, at best.

    Args:
      file: the open file, where its path does not lead to it.
    """
    if 8 * rows * columns > max(ENDLESS, PACKED * own_size(path, file)):
        raise FileError(path, f"is too small for the {rows:,} rows that its header declares")


def shown(text: str) -> str:
    """Returns text from a file as messages show it."""
    return quoted(shortened(text))


def _is_wide(shape: Sequence[int]) -> bool:
    """Returns whether an array has several columns."""
    return len(shape) == 2 and 1 < shape[1] <= WIDEST
