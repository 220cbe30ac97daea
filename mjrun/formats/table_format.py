"""What a table format is: its suffixes, its writer, its reader, and the library it needs; and checks of all readers.

What a file says is not trusted, and cleaned before it is shown. numpy is imported inside functions, as help, which
lists the formats, does not load it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar

from mjrun.errors import FileError, quoted
from mjrun.formats.input_file import cut
from mjrun.model.column import Column
from mjrun.packages import require

if TYPE_CHECKING:
    import numpy as np

    from mjrun.formats.text_columns import LinePieces

ColumnFilter = Callable[[str], bool]
Array = TypeVar("Array")  # what a format calls an array, of which columns are parts

EXACT = 2**53  # up to which float64 holds every integer
ENDLESS, PACKED = 2**32, 1100  # bytes of numbers that are read of any file; and for each of its own
WIDEST = 4096  # columns of an array; a wider one is no table
PIECE = 2**17  # values in a block that is read


class Cells(IntEnum):
    """What the cells of a table may be.

    Attributes:
      NUMBERS: numbers, finite or not.
      GAPS: also empty, which is NaN.
      ANY: also texts, and integers that float64 does not hold; a block with such a cell has the type object, and its
        cells are float, int and str.
    """

    NUMBERS = 0
    GAPS = 1
    ANY = 2


class RowWriter:
    """Writes rows in one format. Its methods raise OSError when the file cannot be written."""

    def write(self, block: np.ndarray) -> None:
        """Adds the rows of `block`, float64 `(n, columns)`, n ≥ 1."""
        raise NotImplementedError

    def finish(self, manifest: str) -> None:
        """Completes the file; `manifest` is JSON, for a format that writes it last."""

    def close(self) -> None:
        """Frees resources, after `finish` or instead of it."""


@dataclass(frozen=True, eq=False)
class TableContents:
    """An open table.

    Attributes:
      names: of the columns that were asked for, in the order of the file.
      blocks: their rows, float64 or object `(n, columns)` (see `Cells`), n ≥ 1, each of bounded size; read as they are
        asked for.
      units: by name, as far as the file says.
      manifest: what mjrun wrote into the file about how it was made; None if there is nothing.
      lines: of the file, from which the blocks are made, where the format has a row on each; else None.
    """

    names: Sequence[str]
    blocks: Iterator[np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    manifest: dict[str, Any] | None = None
    lines: LinePieces | None = None


class ContentsReader(Protocol):
    """Begins to read a table from an open file."""

    def __call__(self, path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
        """Reads the names, and returns before the rows are read.

        Args:
          path: what the table is called in messages.
          file: stays open until the last block is read.
          wanted: the columns to read.
          cells: what they may be.

        Raises:
          FileError: it is no such table; so may be raised with every block.
        """
        ...


@dataclass(frozen=True)
class TableFormat:
    """A table format; each module in `mjrun.formats.tables` has one, called `FORMAT`.

    Attributes:
      name: as in the option format.
      suffixes: those of its files, the usual one first.
      writer: makes one, given an open file, the columns, and the manifest as JSON.
      reader: reads the columns that a filter accepts.
      pipe: whether it can be written to standard output, and read from standard input.
      holds_manifest: whether its files can hold the manifest.
      library, extra: the library it needs, and the extra of mjrun that installs it.
      reads_alone: whether only writing needs the library.
    """

    name: str
    suffixes: Sequence[str]
    writer: Callable[[BinaryIO, Sequence[Column], str], RowWriter]
    reader: ContentsReader
    pipe: bool = False
    holds_manifest: bool = True
    library: str = ""
    extra: str = ""
    reads_alone: bool = False

    def require_library(self, purpose: str) -> None:
        """Raises MissingExtraError or WrongVersionError if its library is unusable; `purpose`: `writing .parquet`."""
        if self.library:
            require(purpose, self.extra, self.library)


def select(path: Path, names: Sequence[str], wanted: ColumnFilter) -> dict[str, int]:
    """The names that the filter accepts, each with its index.

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
    path: Path, arrays: Iterable[tuple[str, Sequence[int], Array]], wanted: ColumnFilter
) -> dict[str, tuple[Array, int]]:
    """The columns that the filter accepts, each with its array and its index therein.

    Args:
      arrays: by name and shape; of one with two dimensions each column is one, `name/0`, `name/1`, …

    Raises:
      FileError: two of them are alike.
    """
    columns = [
        (column, array, part)
        for name, shape, array in arrays
        for part, column in enumerate([f"{name}/{index}" for index in range(shape[1])] if _is_wide(shape) else [name])
    ]
    return {column: columns[at][1:] for column, at in select(path, [name for name, _, _ in columns], wanted).items()}


def require_vector(path: Path, name: str, shape: Sequence[int], *, lying: bool = False) -> None:
    """Raises FileError if an array with this shape is neither a column nor several; one may also be `lying`."""
    if not shape or not (
        _is_wide(shape) or tuple(shape[1:]) in ((), (1,)) or (lying and len(shape) == 2 and 1 in shape)
    ):
        expected = "(n, 1), (1, n) or (n, k)" if lying else "(n,) or (n, k)"
        raise FileError(path, f"column {shown(name)} has the shape {tuple(shape)}, not {expected}")


def row_blocks(rows: int, width: int, read: Callable[[int, int], Sequence[np.ndarray]]) -> Iterator[np.ndarray]:
    """Blocks of a table, of bounded size.

    Args:
      width: numbers in a row, whether they are read or not.
      read: makes the columns `(count,)` of the rows from `start` on, given `start` and `count`; called in order.
    """
    size = max(1, PIECE // max(1, width))
    for start in range(0, rows, size):
        count = min(size, rows - start)
        yield side_by_side(read(start, count), count)


def number_cells(values: np.ndarray, cells: Cells) -> np.ndarray:
    """Numbers of any type as float64; or as objects where these hold integers that float64 does not."""
    import numpy as np

    is_whole = cells is Cells.ANY and values.dtype.kind in "iu" and values.size
    if is_whole and (int(values.max()) > EXACT or int(values.min()) < -EXACT):
        return values.astype(object)
    return values.astype(np.float64)


def text_cells(texts: Sequence[str | None]) -> np.ndarray:
    """A column of texts; what is empty is NaN, as in a format that has nothing else for it."""
    import numpy as np

    column = np.empty(len(texts), object)
    column[:] = [text or np.nan for text in texts]
    return column


def side_by_side(columns: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """The block of columns `(rows,)`, each float64 or object: of type object if one of them is."""
    import numpy as np

    kind = object if any(column.dtype == object for column in columns) else np.float64
    block = np.empty((len(columns), rows), kind)
    for target, column in zip(block, columns, strict=True):
        target[:] = column
    return block.T


def require_equal_lengths(path: Path, lengths: Mapping[str, int]) -> None:
    """Raises FileError if columns, whose lengths are given by name, differ in length."""
    names = {length: name for name, length in lengths.items()}
    if len(names) > 1:
        examples = " and ".join(f"{shown(name)} {length}" for length, name in list(names.items())[:2])
        raise FileError(path, f"columns differ in rows: {examples}")


def require_plausible_size(path: Path, rows: int, columns: int) -> None:
    """Raises FileError if a file is too small for the numbers that its header promises, of which there is no end then.

    The most that common compression makes of numbers that are all alike is a thousandth.
    """
    promised = 8 * rows * columns
    if promised > max(ENDLESS, PACKED * path.stat().st_size):
        raise FileError(path, f"says that it has {rows:,} rows, for which it is too small")


def shown(text: str) -> str:
    """Text from a file, as messages show it."""
    return quoted(cut(text))


def _is_wide(shape: Sequence[int]) -> bool:
    """Whether an array has several columns."""
    return len(shape) == 2 and 1 < shape[1] <= WIDEST
