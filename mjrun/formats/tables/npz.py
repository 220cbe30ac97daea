"""NumPy's npz: an uncompressed archive with one array for each column, under its name, as in `f["qpos/knee"]`.

Arrays are float64 `(rows,)`; text columns are unicode strings, empty for no text. `__manifest__` and `__units__`
(by column name) are JSON texts: `json.loads(str(f["__units__"]))`.

Columns must be whole, so rows wait in an unnamed file beside the table until the last one is there.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO

from mjrun.errors import FileError
from mjrun.formats.table import Table
from mjrun.formats.table_format import ColumnFilter, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

PIECE = 2**16  # values read at a time
UNITS, MANIFEST = "__units__", "__manifest__"
UNITS_SIZE = 2**24  # bytes of units that are read, at most


class NpzWriter:
    """Writes the archive once all rows are there."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        from mjrun.formats.row_groups import ColumnSpill

        self._file, self._columns = file, columns
        self._spill = ColumnSpill(Path(file.name).parent, len(columns))

    def write(self, block: np.ndarray) -> None:
        self._spill.write(block)

    def finish(self, manifest: str) -> None:
        import numpy as np

        self._spill.end()
        units = json.dumps({column.name: column.unit for column in self._columns})
        with zipfile.ZipFile(self._file, "w") as archive:
            for index, column in enumerate(self._columns):
                with _member(archive, column.name) as member:
                    _write_array(member, column.labels, self._spill.rows, self._spill.column(index))
            for name, text in ((UNITS, units), (MANIFEST, manifest)):
                with _member(archive, name) as member:
                    np.lib.format.write_array(member, np.array(text), allow_pickle=False)

    def close(self) -> None:
        self._spill.close()


def _member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)  # dated 1980: same table, same bytes


def _write_array(file: IO[bytes], labels: Sequence[str], rows: int, pieces: Iterable[np.ndarray]) -> None:
    import numpy as np

    texts = np.array([*labels, ""])  # the last is for −1
    descr = texts.dtype.str if labels else "<f8"
    np.lib.format.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": (rows,)})
    for piece in pieces:
        file.write(texts[piece.astype(int)].data if labels else piece.data)


def read(path: Path, wanted: ColumnFilter) -> Table:
    """The columns that the filter accepts."""
    from mjrun.formats.column_checks import require_equal_lengths, select, unreadable
    from mjrun.formats.input_file import decoding

    with path.open("rb") as file:
        with decoding(path, unreadable(path)):
            archive = zipfile.ZipFile(file)
        arrays = [(info.filename.removesuffix(".npy"), info) for info in archive.infolist()]
        arrays = [(name, info) for name, info in arrays if name not in (info.filename, UNITS, MANIFEST)]
        columns = {}
        for name, index in select(path, [name for name, _ in arrays], wanted).items():
            with decoding(path, unreadable(path)), archive.open(arrays[index][1]) as member:
                columns[name] = _floats(path, name, member)
        require_equal_lengths(path, columns)
        with decoding(path, unreadable(path)):
            return Table(columns, _units(archive))


def _floats(path: Path, name: str, member: IO[bytes]) -> np.ndarray:
    """The array in a member of the archive; one of objects, which would have to be unpickled, is refused."""
    import numpy as np

    from mjrun.formats import npy_header
    from mjrun.formats.column_checks import shown

    shape, _, dtype = npy_header.read_header(member)
    if dtype.kind not in npy_header.NUMERIC:
        raise FileError(path, f"column {shown(name)} holds {npy_header.content_name(dtype)}, not numbers")
    if not shape or shape[1:] not in ((), (1,)):
        raise FileError(path, f"column {shown(name)} has the shape {shape}, not (n,)")

    values = np.empty(shape[0])
    for start in range(0, len(values), PIECE):
        piece = values[start : start + PIECE]
        piece[:] = np.frombuffer(member.read(piece.size * dtype.itemsize), dtype, piece.size)
    if member.read(1):  # the checksum of a member is compared at its end
        raise ValueError("an array is longer than its shape")
    return values


def _units(archive: zipfile.ZipFile) -> dict[str, str]:
    """The units by column name, if mjrun wrote the archive."""
    import numpy as np

    from mjrun.formats import npy_header

    info = archive.NameToInfo.get(f"{UNITS}.npy")
    if info is None or info.file_size > UNITS_SIZE:
        return {}
    with archive.open(info) as member:
        shape, _, dtype = npy_header.read_header(member)
        if shape or dtype.kind != "U":
            return {}
        units = json.loads(str(np.frombuffer(member.read(dtype.itemsize), dtype)[0]))
    return {name: unit for name, unit in units.items() if isinstance(unit, str)} if isinstance(units, dict) else {}


FORMAT = TableFormat("npz", (".npz",), NpzWriter, read)
