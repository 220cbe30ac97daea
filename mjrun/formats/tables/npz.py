"""NumPy's npz: an uncompressed archive with one array for each column, under its name, as in `f["qpos/knee"]`.

Arrays are float64 `(rows,)`; columns of integers are int64, unless a number is missing, and text columns are unicode
strings, empty for no text. `__manifest__` and `__units__` (by column name) are JSON texts:
`json.loads(str(f["__units__"]))`.

Columns are written whole, so rows wait in an unnamed file beside the table until the last one has arrived.
"""

import contextlib
import json
import zipfile
from pathlib import Path
from typing import IO, BinaryIO

import numpy as np

from mjrun.decompression_limits import require_expandable
from mjrun.formats import table_read_stream as tables
from mjrun.formats.input_file import decoding, parse_manifest
from mjrun.formats.npy_reader import NUMERIC, content_name, read_header
from mjrun.formats.table_writer import WholeColumnWriter

UNITS, MANIFEST = "__units__", "__manifest__"
TEXT_SIZE = 2**24  # bytes of units, and of a manifest, that are read, at most


class NpzWriter(WholeColumnWriter):
    """A writer of the archive, once all rows are stored."""

    def end(self, manifest: str) -> None:
        units = json.dumps({column.name: column.unit for column in self.columns})
        with zipfile.ZipFile(self.file, "w") as archive:
            for index, column in enumerate(self.columns):
                kind, pieces = self.cells(index)
                header = {"descr": kind.str, "fortran_order": False, "shape": (self.rows,)}
                with _member(archive, column.name) as member:
                    np.lib.format.write_array_header_1_0(member, header)
                    for piece in pieces:
                        member.write(piece.data)
            for name, text in ((UNITS, units), (MANIFEST, manifest)):
                with _member(archive, name) as member:
                    np.lib.format.write_array(member, np.array(text), allow_pickle=False)


def _member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)  # dated 1980: same table, same bytes


def read(
    path: Path, file: BinaryIO, wanted: tables.ColumnFilter, cells: tables.AcceptedCells
) -> tables.TableReadStream:
    """Reads the accepted columns; those of an array with two dimensions are `name/0`, `name/1`, …"""
    with decoding(path):
        archive = zipfile.ZipFile(file)
        infos = [(info.filename.removesuffix(".npy"), info) for info in archive.infolist()]
        infos = [(name, info) for name, info in infos if name not in (info.filename, UNITS, MANIFEST)]
        arrays = [(name, _shape(archive, info), info) for name, info in infos]
    columns = tables.select_parts(path, arrays, wanted)
    with decoding(path):
        units, manifest = _units(archive), parse_manifest(_text(archive, MANIFEST))

    def opened(name: str, info: zipfile.ZipInfo) -> tables.ArrayInFile:
        return _MemberReader(path, name, archive.open(info), cells, file)

    return tables.array_contents(path, columns, cells, opened, units, manifest)


def _shape(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[int, ...]:
    """Returns the shape of an array; empty if it cannot be read, which is reported if the array is wanted."""
    with contextlib.suppress(Exception), archive.open(info) as member:
        return read_header(member)[0]
    return ()


class _MemberReader:
    """The array in a member of the archive; one of objects, which would have to be unpickled, is refused."""

    def __init__(
        self, path: Path, name: str, member: IO[bytes], cells: tables.AcceptedCells, archive: BinaryIO
    ) -> None:
        shape, by_column, self._kind = read_header(member)
        if self._kind.kind not in NUMERIC + ("U" if cells is tables.AcceptedCells.ANY else ""):
            raise tables.not_numbers(path, name, content_name(self._kind))
        tables.require_vector(path, name, shape)
        if min(shape) < 0:
            raise ValueError("an array has a negative number of rows")
        self._file = member
        self._columns = shape[1] if len(shape) == 2 else 1
        self._whole: np.ndarray | None = None
        self.rows = shape[0]
        self.width = self._columns * max(1, self._kind.itemsize // 8)
        if by_column and self._columns > 1:  # rows are complete only once all of it is read
            require_expandable(path, self.rows * self._columns * self._kind.itemsize, archive)
            self._whole = self._rows(self._columns, self.rows).T
        if not self.rows:
            self._require_end()

    def read(self, start: int, count: int) -> np.ndarray:
        values = self._rows(count, self._columns) if self._whole is None else self._whole[start : start + count]
        if start + count == self.rows:
            self._require_end()
        return values

    def _require_end(self) -> None:
        if self._file.read(1):  # which compares the checksum of the member
            raise ValueError("an array is longer than its shape")

    def _rows(self, count: int, columns: int) -> np.ndarray:
        content = self._file.read(count * columns * self._kind.itemsize)
        return np.frombuffer(content, self._kind, count * columns).reshape(count, columns)


def _units(archive: zipfile.ZipFile) -> dict[str, str]:
    """Returns the units by column name, if mjrun wrote the archive."""
    units = json.loads(_text(archive, UNITS) or "{}")
    return {name: unit for name, unit in units.items() if isinstance(unit, str)} if isinstance(units, dict) else {}


def _text(archive: zipfile.ZipFile, name: str) -> str | None:
    """Returns the text in a member; None if it is missing or too long."""
    info = archive.NameToInfo.get(f"{name}.npy")
    if info is None or info.file_size > TEXT_SIZE:
        return None
    with archive.open(info) as member:
        shape, _, dtype = read_header(member)
        if shape or dtype.kind != "U":
            return None
        return str(np.frombuffer(member.read(dtype.itemsize), dtype)[0])
