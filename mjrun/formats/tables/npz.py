"""NumPy's npz: an uncompressed archive with one array for each column, under its name, as in `f["qpos/knee"]`.

Arrays are float64 `(rows,)`; text columns are unicode strings, empty for no text. `__manifest__` and `__units__`
(by column name) are JSON texts: `json.loads(str(f["__units__"]))`.

Columns must be whole, so rows wait in an unnamed file beside the table until the last one is there.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO

from mjrun.errors import FileError
from mjrun.formats.table_format import ColumnFilter, TableContents, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

PIECE = 2**17  # values read at a time
UNITS, MANIFEST = "__units__", "__manifest__"
TEXT_SIZE = 2**24  # bytes of units, and of a manifest, that are read, at most


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


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, gaps: bool) -> TableContents:
    """The columns that the filter accepts."""
    from mjrun.formats.column_checks import require_equal_lengths, select, unreadable
    from mjrun.formats.input_file import decoded, decoding
    from mjrun.formats.manifest import parse_manifest

    with decoding(path, unreadable(path)):
        archive = zipfile.ZipFile(file)
    arrays = [(info.filename.removesuffix(".npy"), info) for info in archive.infolist()]
    arrays = [(name, info) for name, info in arrays if name not in (info.filename, UNITS, MANIFEST)]
    members = {}
    for name, index in select(path, [name for name, _ in arrays], wanted).items():
        with decoding(path, unreadable(path)):
            members[name] = _Member(path, name, archive.open(arrays[index][1]))

    require_equal_lengths(path, {name: member.rows for name, member in members.items()})
    with decoding(path, unreadable(path)):
        units, manifest = _units(archive), parse_manifest(_text(archive, MANIFEST))
    return TableContents(
        list(members), decoded(path, unreadable(path), _blocks(list(members.values()))), units, manifest
    )


class _Member:
    """The array in a member of the archive; one of objects, which would have to be unpickled, is refused."""

    def __init__(self, path: Path, name: str, file: IO[bytes]) -> None:
        from mjrun.formats import npy_header
        from mjrun.formats.column_checks import shown

        shape, _, self._dtype = npy_header.read_header(file)
        if self._dtype.kind not in npy_header.NUMERIC:
            raise FileError(path, f"column {shown(name)} holds {npy_header.content_name(self._dtype)}, not numbers")
        if not shape or shape[1:] not in ((), (1,)):
            raise FileError(path, f"column {shown(name)} has the shape {shape}, not (n,)")
        if shape[0] < 0:
            raise ValueError("an array has less than no rows")
        self.rows, self._file = shape[0], file

    def read(self, count: int) -> np.ndarray:
        """The next values."""
        import numpy as np

        return np.frombuffer(self._file.read(count * self._dtype.itemsize), self._dtype, count)

    def end(self) -> None:
        """Checks that this was all; the checksum of a member is compared at its end."""
        if self._file.read(1):
            raise ValueError("an array is longer than its shape")


def _blocks(members: Sequence[_Member]) -> Iterator[np.ndarray]:
    """The arrays side by side."""
    import numpy as np

    rows = members[0].rows if members else 0
    size = max(1, PIECE // max(1, len(members)))
    for start in range(0, rows, size):
        pieces = [member.read(min(size, rows - start)) for member in members]
        yield np.array(pieces, np.float64).T
    for member in members:
        member.end()


def _units(archive: zipfile.ZipFile) -> dict[str, str]:
    """The units by column name, if mjrun wrote the archive."""
    units = json.loads(_text(archive, UNITS) or "{}")
    return {name: unit for name, unit in units.items() if isinstance(unit, str)} if isinstance(units, dict) else {}


def _text(archive: zipfile.ZipFile, name: str) -> str | None:
    """The text in a member, if there is one and it is not too long."""
    import numpy as np

    from mjrun.formats import npy_header

    info = archive.NameToInfo.get(f"{name}.npy")
    if info is None or info.file_size > TEXT_SIZE:
        return None
    with archive.open(info) as member:
        shape, _, dtype = npy_header.read_header(member)
        if shape or dtype.kind != "U":
            return None
        return str(np.frombuffer(member.read(dtype.itemsize), dtype)[0])


FORMAT = TableFormat("npz", (".npz",), NpzWriter, read)
