"""Reads tables in any format, whatever program wrote them.

What mjrun wrote reads back as the same bits, except that .csv holds cleaned names, and .jsonl null for what is not
finite. Files are read in pieces: besides the wanted columns, at most one of them is in memory once more.
A table is not trusted: nothing in it is run, and what messages quote from it is cleaned.
"""

from collections.abc import Collection
from pathlib import Path

from mjrun.errors import FileError, UnknownNameError
from mjrun.formats.input_file import require_file
from mjrun.formats.table import Table
from mjrun.formats.table_format import ColumnFilter
from mjrun.formats.tables import input_format, readable_suffixes


def read_table(path: str | Path, columns: Collection[str] | ColumnFilter | None = None) -> Table:
    """Reads columns of numbers from a table.

    Integers and booleans are numbers, and so are `nan` and `inf` in text; an empty cell, a null, and a number in
    quotes in JSON are not. Columns that are not asked for may hold anything.

    Args:
      path: a .csv, .jsonl, .parquet, .feather, .arrow, .npz or .mat file.
      columns: the name of one or of several columns, or a function that accepts a name or not; all by default.

    Returns:
      The columns as float64 `(n,)`, in the order of the file, with their units where the format holds them.

    Raises:
      FileError: there is no such file, it is not complete, two of the columns have the same name or differ in
        length, or a cell is not a number; the message says at which line or row, counted from 1.
      UnknownNameError: no format has this suffix, or a column that is named is missing.
      UsageError: the format can be written, but not read.
      MissingExtraError: the library of the format is not installed.
    """
    path = Path(path)
    require_file(path, "table", readable_suffixes())
    reader = input_format(path).reader
    assert reader  # input_format has checked it
    names = dict[str, None]()
    accept = _filter(columns)

    def wanted(name: str) -> bool:
        names[name] = None
        return accept(name)

    try:
        table = reader(path, wanted)
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise FileError(path, "its columns do not fit in memory") from None
    if isinstance(columns, Collection):
        for name in [columns] if isinstance(columns, str) else columns:
            if name not in table:
                raise UnknownNameError("column", name, list(names), where=str(path))
    return table


def _filter(columns: Collection[str] | ColumnFilter | None) -> ColumnFilter:
    if columns is None:
        return lambda name: True
    if isinstance(columns, str):
        return columns.__eq__
    return columns.__contains__ if isinstance(columns, Collection) else columns
