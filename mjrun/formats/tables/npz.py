"""NumPy's npz: an uncompressed archive with one array for each column, under its name, as in `f["qpos/knee"]`.

Arrays are float64 `(rows,)`; columns of integers are int64, unless a number is missing, and text columns are unicode
strings, empty for no text. `__manifest__` and `__units__`
(by column name) are JSON texts: `json.loads(str(f["__units__"]))`.

Columns must be whole, so rows wait in an unnamed file beside the table until the last one is there.
"""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO

from mjrun.errors import FileError
from mjrun.expansion import require_expandable
from mjrun.formats.input_file import decoded, decoding, parse_manifest
from mjrun.formats.npy_header import NUMERIC, content_name, read_header
from mjrun.formats.row_groups import ColumnWriter
from mjrun.formats.table_format import (
    Cells,
    ColumnFilter,
    TableContents,
    TableFormat,
    number_cells,
    require_equal_lengths,
    require_vector,
    row_blocks,
    select_parts,
    shown,
    text_cells,
)
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

UNITS, MANIFEST = "__units__", "__manifest__"
TEXT_SIZE = 2**24  # bytes of units, and of a manifest, that are read, at most


class NpzWriter(ColumnWriter):
    """Writes the archive once all rows are there."""

    def save(self, manifest: str) -> None:
        import numpy as np

        units = json.dumps({column.name: column.unit for column in self.columns})
        with zipfile.ZipFile(self.file, "w") as archive:
            for index, column in enumerate(self.columns):
                with _member(archive, column.name) as member:
                    self._write_array(member, column, index)
            for name, text in ((UNITS, units), (MANIFEST, manifest)):
                with _member(archive, name) as member:
                    np.lib.format.write_array(member, np.array(text), allow_pickle=False)

    def _write_array(self, file: IO[bytes], column: Column, index: int) -> None:
        import numpy as np

        texts = np.array([*column.labels, ""])  # the last is for −1
        descr = texts.dtype.str if column.labels else "<i8" if self.is_whole(index) else "<f8"
        np.lib.format.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": (self.rows,)})
        for piece in self.values(index):
            file.write((texts[piece.astype(int)] if column.labels else piece.astype(descr)).data)


def _member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)  # dated 1980: same table, same bytes


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
    """The columns that the filter accepts; those of an array with two dimensions are `name/0`, `name/1`, …"""
    with decoding(path):
        archive = zipfile.ZipFile(file)
        infos = [(info.filename.removesuffix(".npy"), info) for info in archive.infolist()]
        infos = [(name, info) for name, info in infos if name not in (info.filename, UNITS, MANIFEST)]
        arrays = [(name, _shape(archive, info), info) for name, info in infos]
    columns = select_parts(path, arrays, wanted)

    members = []
    for info, group in groupby(columns.items(), key=lambda column: column[1][0]):
        parts = {name: part for name, (_, part) in group}
        with decoding(path):
            members.append(_Member(path, parts, archive.open(info), cells))
    require_equal_lengths(path, {next(iter(member.parts)): member.rows for member in members})
    with decoding(path):
        units, manifest = _units(archive), parse_manifest(_text(archive, MANIFEST))
    return TableContents(list(columns), decoded(path, _blocks(members)), units, manifest)


def _shape(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[int, ...]:
    """The shape of an array; none where it cannot be read, which shows if it is asked for."""
    with contextlib.suppress(Exception), archive.open(info) as member:
        return read_header(member)[0]
    return ()


class _Member:
    """The array in a member of the archive; one of objects, which would have to be unpickled, is refused.

    Attributes:
      parts: the columns of it that are read, by name.
      rows: of each.
      numbers: how many of 8 bytes a row of the array is as large as.
    """

    def __init__(self, path: Path, parts: dict[str, int], file: IO[bytes], cells: Cells) -> None:
        shape, fortran, self._dtype = read_header(file)
        first = next(iter(parts))
        self._cells = cells
        if self._dtype.kind not in NUMERIC + ("U" if cells is Cells.ANY else ""):
            raise FileError(path, f"column {shown(first)} holds {content_name(self._dtype)}, not numbers")
        require_vector(path, first, shape)
        if min(shape) < 0:
            raise ValueError("an array has less than no rows")
        self.parts, self.rows, self._file = parts, shape[0], file
        self._width = shape[1] if len(shape) == 2 else 1
        self.numbers = self._width * max(1, self._dtype.itemsize // 8)
        self._columns: np.ndarray | None = None
        if fortran and self._width > 1:  # column after column: all of it, to have rows
            require_expandable(path, self.rows * self._width * self._dtype.itemsize)
            self._columns = self._values(self.rows * self._width).reshape(self._width, self.rows).T
        self._row = 0

    def read(self, count: int) -> list[np.ndarray]:
        """The next rows of its columns, each `(count,)`."""
        if self._columns is None:
            rows = self._values(count * self._width).reshape(count, self._width)
        else:
            rows = self._columns[self._row : self._row + count]
        self._row += count
        columns = [rows[:, part] for part in self.parts.values()]
        if self._dtype.kind == "U":
            return [text_cells(column.tolist()) for column in columns]
        return [number_cells(column, self._cells) for column in columns]

    def end(self) -> None:
        """Checks that this was all; the checksum of a member is compared at its end."""
        if self._file.read(1):
            raise ValueError("an array is longer than its shape")

    def _values(self, count: int) -> np.ndarray:
        import numpy as np

        return np.frombuffer(self._file.read(count * self._dtype.itemsize), self._dtype, count)


def _blocks(members: Sequence[_Member]) -> Iterator[np.ndarray]:
    """The arrays side by side."""

    def read_rows(_: int, count: int) -> list[np.ndarray]:
        return [column for member in members for column in member.read(count)]

    yield from row_blocks(members[0].rows if members else 0, sum(member.numbers for member in members), read_rows)
    for member in members:
        member.end()


def _units(archive: zipfile.ZipFile) -> dict[str, str]:
    """The units by column name, if mjrun wrote the archive."""
    units = json.loads(_text(archive, UNITS) or "{}")
    return {name: unit for name, unit in units.items() if isinstance(unit, str)} if isinstance(units, dict) else {}


def _text(archive: zipfile.ZipFile, name: str) -> str | None:
    """The text in a member, if there is one and it is not too long."""
    import numpy as np

    info = archive.NameToInfo.get(f"{name}.npy")
    if info is None or info.file_size > TEXT_SIZE:
        return None
    with archive.open(info) as member:
        shape, _, dtype = read_header(member)
        if shape or dtype.kind != "U":
            return None
        return str(np.frombuffer(member.read(dtype.itemsize), dtype)[0])


FORMAT = TableFormat("npz", (".npz",), NpzWriter, read)
