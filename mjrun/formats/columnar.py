"""Tables by column, with units and a manifest inside: Parquet and Feather, NumPy's npz and MATLAB's mat.

Rows come in by the block and lie in these formats by the column, so each sink turns them over in groups
of bounded size. Parquet and Feather take group after group; npz and mat need whole columns, so the groups
wait in an unnamed file beside the table until the last row is there.

pyarrow and scipy are imported when a sink is opened, not before.
"""

import base64
import contextlib
import errno
import json
import re
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mjrun.model.column import Column

GROUP = 2**21  # values in a group: 16 MiB
MANIFEST = "mjrun"  # the key of the manifest in a schema's metadata
MATLAB_LIMIT = 2**31  # bytes in one variable
MATLAB_CELL = 64  # bytes that a text in a cell takes besides its characters, of which each takes at most 4
MATLAB_NAME = 63  # characters in a variable's name
MATLAB_OWN = ("columns", "variables", "units", "manifest")
MATLAB_HEADER = 116  # bytes of text at the start of the file


class ParquetSink:
    """Flat float64 columns in zstd row groups; a column with labels is a dictionary of strings, null for no text.

    A field's metadata has `unit`, `meaning`, `kind` and `id`; the schema's has the manifest under `mjrun`, which is
    also in the file's own key-value metadata, where DuckDB finds it.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import pyarrow.parquet

        self._columns, self._groups = columns, Groups(len(columns))
        self._schema = _schema(columns)
        texts: Any = [column.name for column in columns if column.labels]
        self._writer = pyarrow.parquet.ParquetWriter(file, self._schema, compression="zstd", use_dictionary=texts)

    def write(self, block: np.ndarray) -> None:
        for group in self._groups.add(block):
            self._write(group)

    def finish(self, manifest: str) -> None:
        for group in self._groups.rest():
            self._write(group)
        # Arrow keeps its schema, metadata included, beside Parquet's own: both are to tell the same.
        final = base64.b64encode(self._schema.with_metadata({MANIFEST: manifest}).serialize())
        self._writer.add_key_value_metadata({MANIFEST: manifest, "ARROW:schema": final})
        self._writer.close()

    def close(self) -> None:
        with contextlib.suppress(Exception):  # it may have stopped anywhere
            self._writer.close()
        self._writer.is_open = False  # or its end would try once more

    def _write(self, group: np.ndarray) -> None:
        import pyarrow

        self._writer.write_table(pyarrow.Table.from_batches([_batch(group, self._columns, self._schema)]))


class FeatherSink:
    """The same in an Arrow IPC file, lz4. Its schema is written first: the manifest is the one given at opening."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import pyarrow

        self._columns, self._groups = columns, Groups(len(columns))
        self._schema = _schema(columns).with_metadata({MANIFEST: manifest})
        options = pyarrow.ipc.IpcWriteOptions(compression="lz4")
        self._writer = pyarrow.ipc.new_file(file, self._schema, options=options)

    def write(self, block: np.ndarray) -> None:
        for group in self._groups.add(block):
            self._writer.write_batch(_batch(group, self._columns, self._schema))

    def finish(self, manifest: str) -> None:
        for group in self._groups.rest():
            self._writer.write_batch(_batch(group, self._columns, self._schema))
        self._writer.close()

    def close(self) -> None:
        with contextlib.suppress(Exception):  # it may have stopped anywhere
            self._writer.close()


class NpzSink:
    """An uncompressed archive: one float64 array `(rows,)` for each column, under its name, as in `f["qpos/knee"]`;
    of unicode strings, empty for no text, where it has labels.

    `__manifest__` and `__units__` (by column name) are JSON texts: `json.loads(str(f["__units__"]))`.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        self._file, self._columns = file, columns
        self._spill = Spill(Path(file.name).parent, len(columns))

    def write(self, block: np.ndarray) -> None:
        self._spill.write(block)

    def finish(self, manifest: str) -> None:
        self._spill.end()
        units = json.dumps({column.name: column.unit for column in self._columns})
        with zipfile.ZipFile(self._file, "w") as archive:
            for index, column in enumerate(self._columns):
                with _member(archive, column.name) as member:
                    _write_array(member, column.labels, self._spill.rows, self._spill.column(index))
            for name, text in (("__units__", units), ("__manifest__", manifest)):
                with _member(archive, name) as member:
                    np.lib.format.write_array(member, np.array(text), allow_pickle=False)

    def close(self) -> None:
        self._spill.close()


class MatSink:
    """A MATLAB 5 file: one column vector `(rows, 1)` for each column, a cell of texts where it has labels.

    Variables are called as MATLAB allows: `qpos/knee` is `qpos_knee`. The cells `columns`, `variables` and `units`
    hold the exact names, the variables and the units in order; the text `manifest` is JSON.
    The format holds 2 GiB per variable; more rows are refused as they come, counting every text as the longest label.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import scipy.io  # noqa: F401  (what is broken shows before the first step)

        self._file, self._columns = file, columns
        self._spill = Spill(Path(file.name).parent, len(columns))
        self._widest = max([8, *(MATLAB_CELL + 4 * len(label) for column in columns for label in column.labels)])

    def write(self, block: np.ndarray) -> None:
        if self._widest * (self._spill.rows + len(block)) >= MATLAB_LIMIT:
            raise OSError(errno.EFBIG, "a .mat file holds at most 2 GiB per column; .parquet and .npz hold more")
        self._spill.write(block)

    def finish(self, manifest: str) -> None:
        self._spill.end()
        variables = identifiers([column.name for column in self._columns])
        for index, (variable, column) in enumerate(zip(variables, self._columns, strict=True)):
            values = np.concatenate([np.empty(0), *self._spill.column(index)])[:, None]
            self._save(variable, _cells([*column.labels, ""])[values.astype(int)] if column.labels else values)
        self._save("columns", _cells(column.name for column in self._columns))
        self._save("variables", _cells(variables))
        self._save("units", _cells(column.unit for column in self._columns))
        self._save("manifest", manifest)
        self._file.seek(0)  # scipy writes the time of day there
        self._file.write(b"MATLAB 5.0 MAT-file, written by mjrun".ljust(MATLAB_HEADER))

    def close(self) -> None:
        self._spill.close()

    def _save(self, variable: str, value: Any) -> None:
        import scipy.io

        scipy.io.savemat(self._file, {variable: value}, oned_as="column")  # appends, after the first


class Groups:
    """Rows in, groups of columns out: `(columns, rows)`, at most `GROUP` values, valid until the next is asked for."""

    def __init__(self, columns: int) -> None:
        self._group = np.empty((columns, max(1, GROUP // columns)))
        self._filled = 0

    def add(self, block: np.ndarray) -> Iterator[np.ndarray]:
        """Takes the rows of `block` `(n, columns)` and yields every group they fill."""
        size = self._group.shape[1]
        while len(block):
            taken, block = np.split(block, [size - self._filled])
            self._group[:, self._filled : self._filled + len(taken)] = taken.T
            self._filled += len(taken)
            if self._filled == size:
                self._filled = 0
                yield self._group

    def rest(self) -> Iterator[np.ndarray]:
        """The rows that fill no group, if there are any."""
        if self._filled:
            yield self._group[:, : self._filled]
            self._filled = 0


class Spill:
    """A table on disk, written by row and read by column, in a file without a name, which no failure leaves behind.

    Args:
      folder: where the file is, so that it is the table's own disk that must have the space.
    """

    def __init__(self, folder: Path, columns: int) -> None:
        self.rows = 0
        self._groups = Groups(columns)
        self._sizes: list[int] = []  # rows in each group
        self._columns = columns
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (closed by close)

    def write(self, block: np.ndarray) -> None:
        self.rows += len(block)
        self._keep(self._groups.add(block))

    def end(self) -> None:
        """No more rows come."""
        self._keep(self._groups.rest())

    def column(self, index: int) -> Iterator[np.ndarray]:
        """The values of one column, in pieces."""
        before = 0
        for size in self._sizes:
            self._file.seek(8 * (self._columns * before + index * size))
            yield np.frombuffer(self._file.read(8 * size))
            before += size

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._file.close()

    def _keep(self, groups: Iterable[np.ndarray]) -> None:
        for group in groups:
            self._file.write(np.ascontiguousarray(group).data)
            self._sizes.append(group.shape[1])


def identifiers(names: Sequence[str]) -> list[str]:
    """A MATLAB variable for each name, no two alike, none of those that a table has besides."""
    taken: dict[str, None] = dict.fromkeys(MATLAB_OWN)
    for name in names:
        base = re.sub(r"\W", "_", name, flags=re.ASCII)
        base = base if base[:1].isalpha() else f"x{base}"
        found, count = base[:MATLAB_NAME], 1
        while found in taken:
            count += 1
            found = f"{base[: MATLAB_NAME - len(str(count)) - 1]}_{count}"
        taken[found] = None
    return list(taken)[len(MATLAB_OWN) :]


def _schema(columns: Sequence[Column]) -> Any:
    import pyarrow

    number, text = pyarrow.float64(), pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
    return pyarrow.schema([pyarrow.field(c.name, text if c.labels else number, metadata=_facts(c)) for c in columns])


def _facts(column: Column) -> dict[str, str]:
    return {"unit": column.unit, "meaning": column.meaning, "kind": column.kind, "id": str(column.id)}


def _batch(group: np.ndarray, columns: Sequence[Column], schema: Any) -> Any:
    import pyarrow

    return pyarrow.record_batch([_array(*pair) for pair in zip(group, columns, strict=True)], schema=schema)


def _array(values: np.ndarray, column: Column) -> Any:
    import pyarrow

    if not column.labels:
        return pyarrow.array(values, from_pandas=False)
    numbers = pyarrow.array(values.astype(np.int32), mask=values < 0)
    return pyarrow.DictionaryArray.from_arrays(numbers, pyarrow.array(column.labels, pyarrow.string()))


def _member(archive: zipfile.ZipFile, name: str) -> Any:
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)  # dated 1980: same table, same bytes


def _write_array(file: Any, labels: Sequence[str], rows: int, pieces: Iterable[np.ndarray]) -> None:
    texts = np.array([*labels, ""])  # the last is for −1
    descr = texts.dtype.str if labels else "<f8"
    np.lib.format.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": (rows,)})
    for piece in pieces:
        file.write(texts[piece.astype(int)].data if labels else piece.data)


def _cells(texts: Iterable[str]) -> np.ndarray:
    return np.array(list(texts), object)
