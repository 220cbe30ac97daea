"""Reads tables in any format, whatever program wrote them, whole or in blocks.

Tables that mjrun wrote read back as the same bits, except that .csv holds cleaned names, and .jsonl null for numbers
that are not finite. Files are read in blocks of bounded size, except .mat. A table that is read whole needs the memory
of its columns and of one more. A table is untrusted: nothing in it is executed, and messages clean what they quote.
"""

import contextlib
import html
import io
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import field
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, Literal, Self

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, UnknownNameError, UsageError, clean, counted, file_errors, shortened
from mjrun.file_version import content_version
from mjrun.formats.input_file import require_file
from mjrun.formats.local_and_remote_folders import open_url
from mjrun.formats.table_read_stream import AcceptedCells, ColumnFilter
from mjrun.formats.tables import TableFormat, input_format, piped_format, suffixes
from mjrun.model.table_column import with_unit
from mjrun.packages import require
from mjrun.suffixes import is_url

SHOWN_COLUMNS, SHOWN_ROWS = 20, 5  # in a notebook; the rows at either end
STDIN = "-"
STDIN_LABEL = Path("<stdin>")
Missing = Literal["error", "nan"]


@dataclass(frozen=True, eq=False)
class NumericTable:
    """Columns of numbers, each with a unit: `table["qpos/knee"]`, `table.units["qpos/knee"]`.

    Iterating yields the names of the columns, in the order of the file.

    Attributes:
      columns: columns float64 `(n,)`, by name.
      units: units by name, as in `m/s`; empty for pure numbers, and where a file states no units.
    """

    columns: dict[str, np.ndarray]
    units: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", {name: self.units.get(name, "") for name in self.columns})

    @property
    def names(self) -> list[str]:
        """The names of the columns, in the order of the file."""
        return list(self.columns)

    def __getitem__(self, name: str) -> np.ndarray:
        """Returns the column `name`.

        Raises:
          UnknownNameError: it is missing; the message lists the columns.
        """
        if name not in self.columns:
            raise UnknownNameError("column", name, self.names)
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        """Returns the number of columns."""
        return len(self.columns)

    @property
    def rows(self) -> int:
        """The number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def to_dict(self) -> dict[str, list[float]]:
        """Returns the columns as lists of numbers."""
        return {name: column.tolist() for name, column in self.columns.items()}

    def to_pandas(self) -> Any:
        """Returns a pandas.DataFrame; its `attrs` contain the units.

        Raises:
          MissingExtraError: pandas is not installed.
        """
        frame = _library("pandas").DataFrame(self.columns)
        frame.attrs["units"] = dict(self.units)
        return frame

    def to_polars(self) -> Any:
        """Returns a polars.DataFrame.

        Raises:
          MissingExtraError: polars is not installed.
        """
        return _library("polars").DataFrame(self.columns)

    def __repr__(self) -> str:
        names = [clean(with_unit(name, unit)) for name, unit in self.units.items()]
        width = max((len(name) for name in names[:SHOWN_COLUMNS]), default=0)
        lines = [f"Table of {counted(self.rows, 'row')} and {counted(len(self), 'column')}"]
        for name, column in zip(names[:SHOWN_COLUMNS], self.columns.values(), strict=False):
            span = f"{np.nanmin(column):.6g} to {np.nanmax(column):.6g}" if np.isfinite(column).any() else "no numbers"
            lines.append(f"  {name:{width}}  {span}")
        hidden = len(self) - SHOWN_COLUMNS
        return "\n".join([*lines, *([f"  … and {counted(hidden, 'column')} more"] if hidden > 0 else [])])

    def to_html(self) -> str:
        """Returns the first and last rows as an HTML table, which notebooks show."""
        shown = list(self.columns)[:SHOWN_COLUMNS]
        rows = range(self.rows)
        texts = [(html.escape(name), html.escape(self.units[name])) for name in shown]
        heads = "".join(f"<th>{name}<br/><small>{unit}</small></th>" for name, unit in texts)
        lines = [self._html_row(row, shown) for row in rows[:SHOWN_ROWS]]
        if self.rows > 2 * SHOWN_ROWS:
            lines.append(f"<tr>{'<td>…</td>' * len(shown)}</tr>")
        lines += [self._html_row(row, shown) for row in rows[max(SHOWN_ROWS, self.rows - SHOWN_ROWS) :]]
        hidden = f", of which {len(shown)} are shown" if len(shown) < len(self) else ""
        size = f"{counted(self.rows, 'row')}, {counted(len(self), 'column')}{hidden}"
        return f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(lines)}</tbody></table><p>{size}</p>"

    def _repr_html_(self) -> str:
        return self.to_html()

    def _html_row(self, row: int, names: Sequence[str]) -> str:
        return f"<tr>{''.join(f'<td>{self.columns[name][row]:.6g}</td>' for name in names)}</tr>"


def _library(name: str) -> Any:
    """Imports a library that mjrun does not require."""
    require(f"Table.to_{name}", "", name)
    return import_module(name)


class OpenTable:
    """An open table: `with open_table(path) as table`. Leaving the block closes the file.

    Attributes:
      path: path of the table in messages.
      file: the open file.
      names: names of its columns, in the order of the file.
      units: units by name; empty for pure numbers, and where a file states no units.
      manifest: how mjrun made the file; None in .csv, .jsonl and in files of other programs.
    """

    def __init__(
        self,
        path: Path,
        form: TableFormat,
        file: BinaryIO,
        columns: Collection[str] | ColumnFilter | None,
        cells: AcceptedCells,
    ) -> None:
        self.path = path
        self.file = file
        self._written = content_version(file)  # before anything is read
        self._all_names: dict[str, None] = {}
        named = [columns] if isinstance(columns, str) else [] if columns is None or callable(columns) else [*columns]

        def wanted(name: str) -> bool:
            self._all_names[name] = None
            return columns is None or (columns(name) if callable(columns) else name in named)

        with self._failing():
            contents = form.module.read(path, file, wanted, cells)
        self.names = tuple(contents.names)
        self.units = {name: clean(shortened(contents.units.get(name, ""))) for name in self.names}
        self.manifest: dict[str, Any] | None = contents.manifest
        self._blocks: Iterator[np.ndarray] = contents.blocks
        self._lines = contents.lines
        self._has_begun = False
        for name in named:
            if name not in self.names:
                raise UnknownNameError("column", name, list(self._all_names), where=str(path))

    def blocks(self) -> Iterator[np.ndarray]:
        """Yields the rows, once, in the order of the file.

        Returns:
          Blocks `(n, len(names))`, n ≥ 1, of float64; or of objects, if the table was opened as exact and a cell is a
          text or an integer beyond those of float64. The caller may keep and change them.

        Raises:
          FileError: the file is incomplete, columns differ in length, or a cell is not a number; the message names
            the line, counted from 1, or the row, counted from 0.
        """
        while True:
            with self._failing():
                block = next(self._blocks, None)
            if block is None:
                return
            self._has_begun = True
            yield block

    def skip_equal_rows(self, other: "OpenTable") -> int:
        """Skips rows whose lines have the same bytes in both files, without parsing them.

        Starts at the current row of each, after the first block of both was read.

        Returns:
          The number of rows; 0 unless both are CSV with the same columns in the same order, and seekable.
        """
        if self._lines is None or other._lines is None or not (self._has_begun and other._has_begun):
            return 0
        with self._failing():
            return self._lines.skip_equal(other._lines)

    def require_unchanged(self) -> None:
        """Requires that nothing was written to the file since it was opened. A file that is replaced is read on.

        Raises:
          FileError: something was written; rows may be those of two tables.
        """
        if content_version(self.file) != self._written:
            raise FileError(self.path, "has changed while it was read")

    def close(self) -> None:
        """Closes the file."""
        self.file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            with file_errors(self.path):
                yield
        except FileError:
            self.require_unchanged()  # or else the file is not at fault
            raise
        except MemoryError:
            raise FileError(self.path, "its columns do not fit in memory") from None


def open_table(
    path: str | Path,
    columns: Collection[str] | ColumnFilter | None = None,
    *,
    missing: Missing = "error",
    exact: bool = False,
) -> OpenTable:
    """Opens a table to read its columns of numbers in blocks, in memory that does not grow with its length.

    Integers and booleans are numbers, and so are `nan` and `inf` in text; a number in quotes in JSON is not. Columns
    that are not selected may hold anything. Rows are read on demand, and faults in them are reported then.

    Args:
      path: a .csv, .jsonl, .parquet, .feather, .arrow, .npz, .mat or .h5 file, or its URL; or `-`
        for CSV or JSON Lines on standard input, which are distinguished by their first character.
      columns: name of one or of several columns, or a function that accepts or rejects a name; all by default.
      missing: meaning of an empty cell, a null, and a missing key in JSON: an error, or NaN.
      exact: whether cells may also be texts, and integers of any size; missing cells are NaN then.

    Raises:
      FileError: the file does not exist, cannot be decoded, or two of the columns have the same name.
      UnknownNameError: no format has this suffix, or a named column is missing.
      UsageError: standard input is a terminal.
      MissingExtraError: the library of the format is not installed.
    """
    cells = AcceptedCells.ANY if exact else AcceptedCells.GAPS if missing == "nan" else AcceptedCells.NUMBERS
    if str(path) == STDIN:
        file = _standard_input()
        form = piped_format(file.peek(1))  # which consumes nothing
        return OpenTable(STDIN_LABEL, form, file, columns, cells)

    shown = Path(path)
    if not is_url(path):
        require_file(shown, "table", suffixes())
    form = input_format(shown)
    with file_errors(path):
        file = open_url(str(path)) if is_url(path) else shown.open("rb")
    try:
        return OpenTable(shown, form, file, columns, cells)
    except BaseException:
        file.close()
        raise


def read_table(
    path: str | Path, columns: Collection[str] | ColumnFilter | None = None, *, missing: Missing = "error"
) -> NumericTable:
    """Reads columns of numbers from a table.

    Args:
      path, columns, missing: as in `open_table`.

    Returns:
      The columns as float64 `(n,)`, in the order of the file, with their units where the format holds them.

    Raises:
      FileError: the file does not exist or is incomplete, two of the columns have the same name or differ in length,
        or a cell is not a number; the message names the line, counted from 1, or the row, counted from 0.
      UnknownNameError: no format has this suffix, or a named column is missing.
      MissingExtraError: the library of the format is not installed.
    """
    with open_table(path, columns, missing=missing) as table:
        try:
            parts, size = {name: [np.empty(0)] for name in table.names}, 0
            for block in table.blocks():
                size += block.nbytes
                if table.path != STDIN_LABEL:
                    require_expandable(table.path, size, table.file)
                for name, column in zip(table.names, block.T, strict=True):
                    parts[name].append(column.copy())
            return NumericTable({name: np.concatenate(parts.pop(name)) for name in table.names}, table.units)
        except MemoryError:
            raise FileError(table.path, "its columns do not fit in memory") from None


def _standard_input() -> io.BufferedReader:
    """Returns standard input; closing what is returned leaves it open.

    Raises:
      UsageError: it is a terminal, or closed.
    """
    if sys.stdin is None or sys.stdin.closed or sys.stdin.isatty():
        state = "is a terminal" if sys.stdin and not sys.stdin.closed else "is closed"
        raise UsageError(
            f"the table - is read from standard input, which {state}\n"
            "pipe CSV or JSON Lines into it, as in `mjrun trace model.xml --csv | mjrun plot - -o plot.png`"
        )
    return io.BufferedReader(_Unclosed(sys.stdin.buffer))


class _Unclosed(io.RawIOBase):
    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        content = self._file.read(len(buffer))
        buffer[: len(content)] = content
        return len(content)
