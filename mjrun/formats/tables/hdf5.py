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
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.errors import FileError, clean
from mjrun.formats.table_format import Cells, ColumnFilter, TableContents, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import h5py
    import numpy as np

PIECE = 2**17  # values in a block that is read
LONGEST = 2**14  # characters in an attribute, of at most 4 bytes each: HDF5 takes 64 KiB
DEEPEST = 32  # groups within each other that are looked into


class Hdf5Writer:
    """Writes the datasets once all rows are there."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import h5py  # noqa: F401  (a broken installation shows before the first step)

        from mjrun.formats.row_groups import ColumnSpill

        self._path, self._columns = Path(file.name), columns
        self._spill = ColumnSpill(self._path.parent, len(columns))

    def write(self, block: np.ndarray) -> None:
        self._spill.write(block)

    def finish(self, manifest: str) -> None:
        import h5py

        self._spill.end()
        names = [column.name for column in self._columns]
        with self._path.open("r+b") as file, h5py.File(file, "w") as archive:
            for index, (path, column) in enumerate(zip(paths(names), self._columns, strict=True)):
                number = "<i8" if column.integer and self._spill.is_complete(index) else "<f8"
                dataset = _create(archive, path, column, number, self._spill.rows, self._spill.column(index))
                dataset.attrs["index"] = index
                texts = {"unit": column.unit, "name": column.name if path != column.name else ""}
                for key, text in texts.items():
                    _write_text(dataset, key, text)
            for start in range(0, len(manifest), LONGEST):
                _write_text(archive, _part(start // LONGEST), manifest[start : start + LONGEST])

    def close(self) -> None:
        self._spill.close()


def _write_text(item: h5py.File | h5py.Dataset, key: str, text: str) -> None:
    """An attribute that is a text; none if it is empty, which HDF5 does not have."""
    import numpy as np

    if text:
        item.attrs[key] = np.bytes_(text.encode())


def _part(number: int) -> str:
    """The attribute with this part of the manifest."""
    return f"manifest_{number}" if number else "manifest"


def _create(
    archive: h5py.File, path: str, column: Column, number: str, rows: int, pieces: Iterable[np.ndarray]
) -> h5py.Dataset:
    import h5py
    import numpy as np

    texts = np.array([*column.labels, ""], object)  # the last is for −1
    dataset = archive.create_dataset(path, (rows,), h5py.string_dtype() if column.labels else number)
    start = 0
    for piece in pieces:
        dataset[start : start + len(piece)] = texts[piece.astype(int)] if column.labels else piece
        start += len(piece)
    return dataset


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

    from mjrun.expansion import require_expandable
    from mjrun.formats.column_checks import (
        column_names,
        require_equal_lengths,
        require_plausible_size,
        select,
        unreadable,
    )
    from mjrun.formats.input_file import decoded, decoding
    from mjrun.formats.manifest import parse_manifest

    with decoding(path, unreadable(path)):
        archive = h5py.File(file, "r")
        datasets = dict(sorted(_datasets(archive), key=lambda item: _index(item[1])))
        columns = [
            (column, dataset, part)
            for name, dataset in datasets.items()
            for part, column in enumerate(column_names(name, dataset.shape or ()))
        ]
        manifest = parse_manifest("".join(_manifest(archive)))
    chosen = [columns[at] for at in select(path, [column for column, _, _ in columns], wanted).values()]

    with decoding(path, unreadable(path)):
        units = {column: _text(dataset, "unit") for column, dataset, _ in chosen}
        for column, dataset, _ in chosen:
            _require_numbers(path, column, dataset)
            if dataset.chunks:  # whole in memory, though one row of it is asked for
                require_expandable(path, math.prod(dataset.chunks) * dataset.dtype.itemsize)
    require_equal_lengths(path, {column: len(dataset) for column, dataset, _ in chosen})
    require_plausible_size(path, len(chosen[0][1]) if chosen else 0, len(chosen))
    blocks = decoded(path, unreadable(path), _blocks([(dataset, part) for _, dataset, part in chosen], cells))
    return TableContents([column for column, _, _ in chosen], blocks, units, manifest)


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
    from mjrun.formats import npy_header
    from mjrun.formats.column_checks import column_names, shown

    if dataset.dtype.kind not in npy_header.NUMERIC:
        content = "text" if dataset.dtype.kind == "O" else npy_header.content_name(dataset.dtype)
        raise FileError(path, f"column {shown(name)} holds {content}, not numbers")
    shape = dataset.shape or ()
    if not shape or (shape[1:] not in ((), (1,)) and len(column_names("", shape)) == 1):
        raise FileError(path, f"column {shown(name)} has the shape {shape}, not (n,) or (n, k)")
    if dataset.is_virtual or dataset.external:
        raise FileError(path, f"column {shown(name)} is in another file, which is not read")


def _blocks(columns: Sequence[tuple[h5py.Dataset, int]], cells: Cells) -> Iterator[np.ndarray]:
    """The datasets side by side, of each the columns that are asked for."""
    from mjrun.formats.column_checks import number_cells, side_by_side

    rows = len(columns[0][0]) if columns else 0
    widths = {dataset: math.prod((dataset.shape or ())[1:]) for dataset, _ in columns}
    size = max(1, PIECE // max(1, sum(widths.values())))
    for start in range(0, rows, size):
        count = min(size, rows - start)
        values: list[np.ndarray] = []
        for dataset, group in groupby(columns, key=lambda column: column[0]):
            part = dataset[start : start + size].reshape(count, -1)
            values += [number_cells(part[:, column], cells) for _, column in group]
        yield side_by_side(values, count)


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
