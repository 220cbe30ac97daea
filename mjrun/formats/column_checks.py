"""Checks that all readers of tables share. What a file says is not trusted, and cleaned before it is shown."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from mjrun.errors import FileError, quoted
from mjrun.formats.input_file import cut
from mjrun.formats.table_format import ColumnFilter

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
