"""Checks that all readers of tables share. What a file says is not trusted, and cleaned before it is shown."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mjrun.errors import FileError, quoted
from mjrun.formats.input_file import cut
from mjrun.formats.table_format import Cells, ColumnFilter

EXACT = 2**53  # up to which float64 holds every integer
ENDLESS, PACKED = 2**32, 1100  # bytes of numbers that are read of any file; and for each of its own
WIDEST = 4096  # columns of an array; a wider one is no table


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


def column_names(name: str, shape: Sequence[int]) -> list[str]:
    """The columns of an array: of one with two dimensions each is one, `name/0`, `name/1`, …"""
    if len(shape) == 2 and 1 < shape[1] <= WIDEST:
        return [f"{name}/{index}" for index in range(shape[1])]
    return [name]


def number_cells(values: np.ndarray, cells: Cells) -> np.ndarray:
    """Numbers of any type as float64; or as objects where these hold integers that float64 does not."""
    is_whole = cells is Cells.ANY and values.dtype.kind in "iu" and values.size
    if is_whole and (int(values.max()) > EXACT or int(values.min()) < -EXACT):
        return values.astype(object)
    return values.astype(np.float64)


def text_cells(texts: Sequence[str | None]) -> np.ndarray:
    """A column of texts; what is empty is NaN, as in a format that has nothing else for it."""
    column = np.empty(len(texts), object)
    column[:] = [text or np.nan for text in texts]
    return column


def side_by_side(columns: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """The block of columns `(rows,)`, each float64 or object: of type object if one of them is."""
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


def unreadable(path: Path) -> str:
    """What is wrong with a file that cannot be decoded."""
    return f"cannot be read as {path.suffix.lower()}"
