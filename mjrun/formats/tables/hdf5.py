"""HDF5: one dataset for each column, in groups by its name, as in `f["qpos/knee"]`; float64 `(rows,)`.

A column of integers is int64, unless a number is missing; text columns are UTF-8 strings, empty for no text.

Datasets have the attributes `unit` and `index`, their place in the table. The file has the attribute `manifest`, which
is JSON; if it is too long for one attribute, `manifest_1` … hold the rest. A name that HDF5 does not accept as a path,
or that is the group of another, is stored in the attribute `name`.

Attributes of variable length are ignored. Columns of variable length are read by the parser of
`mjrun.hdf5.untrusted_content`, unless they are compressed.

In a file that mjrun did not write, every dataset is a column under its path, or several, `path/0`, `path/1`, if it has
two dimensions. Links to other files are not followed: a column behind one cannot be read.

Columns are written whole, so rows wait in an unnamed file beside the table until the last one has arrived.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from mjrun.errors import FileError, clean
from mjrun.formats import table_read_stream as tables
from mjrun.formats.input_file import decoding, parse_manifest
from mjrun.formats.npy_reader import NUMERIC, content_name
from mjrun.formats.table_writer import WholeColumnWriter
from mjrun.hdf5.untrusted_content import SIZES, StringHeap, content_at, require_own_content

LONGEST = 2**14  # characters in an attribute, of at most 4 bytes each: HDF5 holds 64 KiB
DEEPEST = 32  # groups within each other that are searched
REFERENCE = np.dtype([("length", "<u4"), ("heap", "<u8"), ("index", "<u4")])  # of a text of variable length


class Hdf5Writer(WholeColumnWriter):
    """A writer of datasets, once all rows are stored."""

    def end(self, manifest: str) -> None:
        names = [column.name for column in self.columns]
        with Path(self.file.name).open("r+b") as file, h5py.File(file, "w") as archive:
            for index, (path, column) in enumerate(zip(paths(names), self.columns, strict=True)):
                dataset = self._create(archive, path, index)
                dataset.attrs["index"] = index
                _write_text(dataset, "unit", column.unit)
                _write_text(dataset, "name", column.name if path != column.name else "")
            for start in range(0, len(manifest), LONGEST):
                _write_text(archive, _manifest_part(start // LONGEST), manifest[start : start + LONGEST])

    def _create(self, archive: h5py.File, path: str, index: int) -> h5py.Dataset:
        """Creates the dataset of a column."""
        kind, pieces = self.cells(index)
        is_text = kind.kind == "U"
        dataset = archive.create_dataset(path, (self.rows,), h5py.string_dtype() if is_text else kind)
        start = 0
        for piece in pieces:
            dataset[start : start + len(piece)] = piece.astype(object) if is_text else piece
            start += len(piece)
        return dataset


def _write_text(item: h5py.File | h5py.Dataset, key: str, text: str) -> None:
    """Writes an attribute that is a text of fixed length, unless it is empty, which HDF5 does not support."""
    if text:
        item.attrs[key] = np.bytes_(text.encode())


def _manifest_part(number: int) -> str:
    """Returns the attribute with this part of the manifest."""
    return f"manifest_{number}" if number else "manifest"


def paths(names: Sequence[str]) -> list[str]:
    """Returns the path of each column: its name, or else a number."""
    groups = {"/".join(parts[:end]) for parts in (name.split("/") for name in names) for end in range(1, len(parts))}
    taken = set(names)
    places: list[str] = []
    for index, name in enumerate(names):
        path = name
        if name in groups or clean(name) != name or not all(part.strip(".") for part in name.split("/")):
            path = f"column_{index}"
            while path in taken:
                path += "_"
        places.append(path)
        taken.add(path)
    return places


def read(
    path: Path, file: BinaryIO, wanted: tables.ColumnFilter, cells: tables.AcceptedCells
) -> tables.TableReadStream:
    """Reads the accepted columns."""
    with decoding(path):
        archive = h5py.File(file, "r")
        datasets = dict(sorted(_datasets(archive), key=lambda item: _index(item[1])))
        arrays = [(name, () if dataset is None else dataset.shape or (), dataset) for name, dataset in datasets.items()]
        manifest = parse_manifest("".join(_manifest(archive)))
    columns = dict[str, tuple[h5py.Dataset, int]]()
    for column, (dataset, part) in tables.select_parts(path, arrays, wanted).items():
        if dataset is None:
            raise FileError(path, f"column {tables.shown(column)} is in another file, which is not read")
        columns[column] = dataset, part
    with decoding(path):
        units = {column: _text(dataset, "unit") for column, (dataset, _) in columns.items()}
    rows = max(((dataset.shape or (0,))[0] for dataset, _ in columns.values()), default=0)
    tables.require_plausible_size(path, rows, len(columns), file)

    def opened(name: str, dataset: h5py.Dataset) -> tables.ArrayInFile:
        content = content_name(dataset.dtype)
        text = h5py.check_string_dtype(dataset.dtype)
        if dataset.dtype.kind not in NUMERIC and not (text and cells is tables.AcceptedCells.ANY):
            raise tables.not_numbers(path, name, "text" if text else content)
        tables.require_vector(path, name, dataset.shape or ())
        require_own_content(path, f"column {tables.shown(name)}", dataset, file)
        return _TextReader(file, dataset) if text and text.length is None else _DatasetReader(dataset)

    return tables.array_contents(path, columns, cells, opened, units, manifest)


class _DatasetReader:
    """A dataset of numbers, or of texts of fixed length."""

    def __init__(self, dataset: h5py.Dataset) -> None:
        self._dataset = dataset
        self.rows = len(dataset)
        self.width = math.prod(dataset.shape[1:]) * max(1, dataset.dtype.itemsize // 8)

    def read(self, start: int, count: int) -> np.ndarray:
        values = np.asarray(self._dataset[start : start + count]).reshape(count, -1)
        return np.char.decode(values, "utf-8", "replace") if values.dtype.kind == "S" else values


@cache
def _omits_user_block() -> bool:
    """Tells if the installed HDF5 counts the places of chunks from the end of the user block, as 1.14.2 does."""
    content, memory = b"the place of a chunk", BytesIO()
    with h5py.File(memory, "w", userblock_size=512) as archive:
        dataset = archive.create_dataset("chunk", data=np.frombuffer(content, "u1"), chunks=(len(content),))
        archive.flush()
        place = dataset.id.get_chunk_info(0).byte_offset
    return memory.getvalue().find(content) != place


class _TextReader:
    """A dataset of variable-length strings, read from the file without HDF5's own library.

    The file has a reference to each text: its length, the address of a heap, and its index there.

    Raises:
      ValueError: the dataset is compressed or damaged.
    """

    width = REFERENCE.itemsize // 8

    def __init__(self, file: BinaryIO, dataset: h5py.Dataset) -> None:
        archive = dataset.file
        if archive.id.get_create_plist().get_sizes() != SIZES or math.prod(dataset.shape) != len(dataset):
            raise ValueError("variable-length strings are stored in an unsupported way")
        if dataset.id.get_create_plist().get_nfilters():
            raise ValueError("compressed variable-length strings are not supported")
        self._file = file
        self.rows = len(dataset)
        self._places: dict[int, int] = {}  # where references are in the file, by the first row of a chunk
        if dataset.chunks:
            chunks = (dataset.id.get_chunk_info(index) for index in range(dataset.id.get_num_chunks()))
            missing = archive.userblock_size if archive.userblock_size and _omits_user_block() else 0
            self._places = {chunk.chunk_offset[0]: chunk.byte_offset + missing for chunk in chunks}
        elif dataset.id.get_storage_size():
            self._places = {0: dataset.id.get_offset()}
        self._chunk = dataset.chunks[0] if dataset.chunks else max(1, self.rows)
        self._heap = StringHeap(file, archive.userblock_size)

    def read(self, start: int, count: int) -> np.ndarray:
        texts = np.full((count, 1), "", object)
        row = start
        while row < start + count:
            first = row - row % self._chunk
            end = min(first + self._chunk, start + count)
            if (place := self._places.get(first)) is not None:  # otherwise nothing was written there
                size = (end - row) * REFERENCE.itemsize
                content = content_at(self._file, place + (row - first) * REFERENCE.itemsize, size)
                for index, reference in enumerate(np.frombuffer(content, REFERENCE), row - start):
                    texts[index, 0] = self._heap.text(*reference.item())
            row = end
        return texts


def _datasets(
    group: h5py.Group, prefix: str = "", within: tuple[h5py.Group, ...] = ()
) -> Iterator[tuple[str, h5py.Dataset | None]]:
    """Yields every dataset below a group with its name; None for one in another file. Groups within themselves end."""
    if group in within or len(within) == DEEPEST:
        return
    for key in group:
        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            yield f"{prefix}{key}", None
            continue
        item = group.get(key)
        if isinstance(item, h5py.Dataset):
            yield _text(item, "name") or f"{prefix}{key}", item
        elif isinstance(item, h5py.Group):
            yield from _datasets(item, f"{prefix}{key}/", (*within, group))


def _index(dataset: h5py.Dataset | None) -> int:
    """Returns the place of a column in the table; 0 if mjrun did not write it."""
    if dataset is None or "index" not in dataset.attrs:
        return 0
    attribute = dataset.attrs.get_id("index")
    index: Any = dataset.attrs["index"]
    return int(index) if attribute.dtype.kind in "iu" and not attribute.shape else 0


def _manifest(archive: h5py.File) -> Iterator[str]:
    number = 0
    while part := _text(archive, _manifest_part(number)):
        yield part
        number += 1


def _text(item: h5py.File | h5py.Dataset, key: str) -> str:
    """Returns an attribute that is a text of fixed length; empty for any other."""
    if key not in item.attrs:
        return ""
    attribute = item.attrs.get_id(key)
    if attribute.dtype.kind != "S" or attribute.shape:
        return ""
    text: Any = item.attrs[key]
    return text.decode("utf-8", "replace")
