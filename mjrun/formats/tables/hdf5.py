"""HDF5: one dataset for each column, in groups by its name, as in `f["qpos/knee"]`; float64 `(rows,)`.

A column of integers is int64, unless a number is missing.

Datasets have the attributes `unit` and `index`, their place in the table; text columns are UTF-8 strings, empty for no
text. The file has the attribute `manifest`, which is JSON; of one that is too long for HDF5, `manifest_1` … are the
rest. A name that HDF5 cannot have as a path, or that is the group of another, stands in the attribute `name`.

Texts in attributes are UTF-8 of fixed length. Those of variable length are in a heap, on which HDF5's own library hangs
if a file is broken, and are not read.

When reading a file that mjrun did not write, every dataset is a column under its path, or several, `path/0`, `path/1`,
if it has two dimensions. Links to other files are not followed.

Columns are written whole, so rows wait in an unnamed file beside the table until the last one is there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.errors import FileError, clean
from mjrun.expansion import require_expandable
from mjrun.formats.input_file import decoded, decoding, parse_manifest
from mjrun.formats.npy_header import NUMERIC, content_name
from mjrun.formats.row_groups import ColumnWriter
from mjrun.formats.table_format import (
    Cells,
    ColumnFilter,
    TableContents,
    TableFormat,
    number_cells,
    require_equal_lengths,
    require_plausible_size,
    require_vector,
    row_blocks,
    select_parts,
    shown,
)
from mjrun.model.column import Column

if TYPE_CHECKING:
    import h5py
    import numpy as np

LONGEST = 2**14  # characters in an attribute, of at most 4 bytes each: HDF5 takes 64 KiB
DEEPEST = 32  # groups within each other that are looked into


class Hdf5Writer(ColumnWriter):
    """Writes the datasets once all rows are there."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import h5py  # noqa: F401  (a broken installation shows before the first step)

        super().__init__(file, columns, manifest)

    def save(self, manifest: str) -> None:
        import h5py

        names = [column.name for column in self.columns]
        with Path(self.file.name).open("r+b") as file, h5py.File(file, "w") as archive:
            for index, (path, column) in enumerate(zip(paths(names), self.columns, strict=True)):
                dataset = self._create(archive, path, index)
                dataset.attrs["index"] = index
                texts = {"unit": column.unit, "name": column.name if path != column.name else ""}
                for key, text in texts.items():
                    _write_text(dataset, key, text)
            for start in range(0, len(manifest), LONGEST):
                _write_text(archive, _part(start // LONGEST), manifest[start : start + LONGEST])

    def _create(self, archive: h5py.File, path: str, index: int) -> h5py.Dataset:
        """Makes the dataset of a column."""
        import h5py
        import numpy as np

        labels = self.columns[index].labels
        texts = np.array([*labels, ""], object)  # the last is for −1
        kind = h5py.string_dtype() if labels else "<i8" if self.is_whole(index) else "<f8"
        dataset, start = archive.create_dataset(path, (self.rows,), kind), 0
        for piece in self.values(index):
            dataset[start : start + len(piece)] = texts[piece.astype(int)] if labels else piece
            start += len(piece)
        return dataset


def _write_text(item: h5py.File | h5py.Dataset, key: str, text: str) -> None:
    """An attribute that is a text; none if it is empty, which HDF5 does not have."""
    import numpy as np

    if text:
        item.attrs[key] = np.bytes_(text.encode())


def _part(number: int) -> str:
    """The attribute with this part of the manifest."""
    return f"manifest_{number}" if number else "manifest"


def paths(names: Sequence[str]) -> list[str]:
    """Where each column stands: under its name, or else a number."""
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


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
    """The columns that the filter accepts."""
    import h5py

    with decoding(path):
        archive = h5py.File(file, "r")
        datasets = dict(sorted(_datasets(archive), key=lambda item: _index(item[1])))
        arrays = [(name, dataset.shape or (), dataset) for name, dataset in datasets.items()]
        manifest = parse_manifest("".join(_manifest(archive)))
    columns = select_parts(path, arrays, wanted)

    with decoding(path):
        units = {column: _text(dataset, "unit") for column, (dataset, _) in columns.items()}
        for column, (dataset, _) in columns.items():
            _require_numbers(path, column, dataset)
            if dataset.chunks:  # whole in memory, though one row of it is asked for
                require_expandable(path, math.prod(dataset.chunks) * dataset.dtype.itemsize)
    lengths = {column: len(dataset) for column, (dataset, _) in columns.items()}
    require_equal_lengths(path, lengths)
    rows = next(iter(lengths.values()), 0)
    require_plausible_size(path, rows, len(columns))

    def read_rows(start: int, count: int) -> list[np.ndarray]:
        values: list[np.ndarray] = []
        for dataset, group in groupby(columns.values(), key=lambda column: column[0]):
            part = dataset[start : start + count].reshape(count, -1)
            values += [number_cells(part[:, column], cells) for _, column in group]
        return values

    width = sum(math.prod(dataset.shape[1:]) for dataset in {dataset for dataset, _ in columns.values()})
    return TableContents(list(columns), decoded(path, row_blocks(rows, width, read_rows)), units, manifest)


def _datasets(
    group: h5py.Group, prefix: str = "", within: tuple[h5py.Group, ...] = ()
) -> Iterator[tuple[str, h5py.Dataset]]:
    """Every dataset below a group with its name, but for those in other files, and groups within themselves."""
    import h5py

    if group in within or len(within) == DEEPEST:
        return
    for key in group:
        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            continue
        item = group.get(key)
        if isinstance(item, h5py.Dataset):
            yield _text(item, "name") or f"{prefix}{key}", item
        elif isinstance(item, h5py.Group):
            yield from _datasets(item, f"{prefix}{key}/", (*within, group))


def _index(dataset: h5py.Dataset) -> int:
    """The place of a column in the table, if mjrun wrote it."""
    if "index" not in dataset.attrs:
        return 0
    attribute = dataset.attrs.get_id("index")
    index: Any = dataset.attrs["index"]
    return int(index) if attribute.dtype.kind in "iu" and not attribute.shape else 0


def _manifest(archive: h5py.File) -> Iterator[str]:
    number = 0
    while part := _text(archive, _part(number)):
        yield part
        number += 1


def _require_numbers(path: Path, name: str, dataset: h5py.Dataset) -> None:
    if dataset.dtype.kind not in NUMERIC:
        content = "text" if dataset.dtype.kind == "O" else content_name(dataset.dtype)
        raise FileError(path, f"column {shown(name)} holds {content}, not numbers")
    require_vector(path, name, dataset.shape or ())
    if dataset.is_virtual or dataset.external:
        raise FileError(path, f"column {shown(name)} is in another file, which is not read")


def _text(item: h5py.File | h5py.Dataset, key: str) -> str:
    """An attribute that is a text of fixed length; empty for anything else."""
    if key not in item.attrs:
        return ""
    attribute = item.attrs.get_id(key)
    if attribute.dtype.kind != "S" or attribute.shape:
        return ""
    text: Any = item.attrs[key]
    return text.decode("utf-8", "replace")


FORMAT = TableFormat("hdf5", (".h5", ".hdf5"), Hdf5Writer, read, library="h5py", extra="hdf5")
