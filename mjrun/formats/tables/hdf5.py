"""HDF5: one dataset for each column, in groups by its name, as in `f["qpos/knee"]`; float64 `(rows,)`.

Datasets have the attribute `unit`; text columns are UTF-8 strings, empty for no text. The file has the attributes
`columns`, names in order, and `manifest`, which is JSON. A name that HDF5 cannot have as a path, or that is the group
of another, stands in the attribute `name` of the dataset.

When reading a file that mjrun did not write, every dataset is a column under its path, or several, `path/0`, `path/1`,
if it has two dimensions. Links to other files are not followed.

Columns are written whole, so rows wait in an unnamed file beside the table until the last one is there.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.errors import FileError, clean
from mjrun.formats.table_format import ColumnFilter, TableContents, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import h5py
    import numpy as np

PIECE = 2**17  # values in a block that is read
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
        # From version 1.8 of the format on, attributes may be long; the libraries of today read all of them.
        with (
            self._path.open("r+b") as file,
            h5py.File(file, "w", libver=("v108", "v108"), track_order=True) as archive,
        ):
            for index, (path, column) in enumerate(zip(paths(names), self._columns, strict=True)):
                dataset = _create(archive, path, column, self._spill.rows, self._spill.column(index))
                dataset.attrs["unit"] = column.unit
                if path != column.name:
                    dataset.attrs["name"] = clean(column.name)
            archive.attrs["columns"] = json.dumps(list(map(clean, names)), ensure_ascii=False)
            archive.attrs["manifest"] = manifest

    def close(self) -> None:
        self._spill.close()


def _create(archive: h5py.File, path: str, column: Column, rows: int, pieces: Iterable[np.ndarray]) -> h5py.Dataset:
    import h5py
    import numpy as np

    texts = np.array([*column.labels, ""], object)  # the last is for −1
    dataset = archive.create_dataset(path, (rows,), h5py.string_dtype() if column.labels else "<f8")
    start = 0
    for piece in pieces:
        dataset[start : start + len(piece)] = texts[piece.astype(int)] if column.labels else piece
        start += len(piece)
    return dataset


def paths(names: Sequence[str]) -> list[str]:
    """Where each column stands: under its name, or else a number."""
    groups = {"/".join(parts[:end]) for parts in (name.split("/") for name in names) for end in range(1, len(parts))}
    taken = set(names)
    found: list[str] = []
    for index, name in enumerate(names):
        path = name
        if name in groups or clean(name) != name or not all(part.strip(".") for part in name.split("/")):
            path = f"column_{index}"
            while path in taken:
                path += "_"
        found.append(path)
        taken.add(path)
    return found


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, gaps: bool) -> TableContents:
    """The columns that the filter accepts."""
    import h5py

    from mjrun.formats.column_checks import column_names, require_equal_lengths, select, unreadable
    from mjrun.formats.input_file import decoded, decoding
    from mjrun.formats.manifest import parse_manifest

    with decoding(path, unreadable(path)):
        archive = h5py.File(file, "r")
        found = _in_order(archive, dict(_datasets(archive)))
        columns = [
            (column, dataset, part)
            for name, dataset in found.items()
            for part, column in enumerate(column_names(name, dataset.shape or ()))
        ]
        manifest = parse_manifest(_text(archive.attrs.get("manifest")))
    chosen = [columns[at] for at in select(path, [column for column, _, _ in columns], wanted).values()]

    with decoding(path, unreadable(path)):
        units = {column: _text(dataset.attrs.get("unit")) for column, dataset, _ in chosen}
        for column, dataset, _ in chosen:
            _require_numbers(path, column, dataset)
    require_equal_lengths(path, {column: len(dataset) for column, dataset, _ in chosen})
    blocks = decoded(path, unreadable(path), _blocks([(dataset, part) for _, dataset, part in chosen]))
    return TableContents([column for column, _, _ in chosen], blocks, units, manifest)


def _datasets(group: h5py.Group, prefix: str = "", depth: int = 0) -> Iterator[tuple[str, h5py.Dataset]]:
    """Every dataset below a group with its name, in the order of the file, but for those in other files."""
    import h5py

    for key in group:
        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            continue
        item = group.get(key)
        if isinstance(item, h5py.Dataset):
            yield _text(item.attrs.get("name")) or f"{prefix}{key}", item
        elif isinstance(item, h5py.Group) and depth < DEEPEST:
            yield from _datasets(item, f"{prefix}{key}/", depth + 1)


def _in_order(archive: h5py.File, datasets: dict[str, h5py.Dataset]) -> dict[str, h5py.Dataset]:
    """The datasets in the order of the columns, if mjrun wrote them."""
    try:
        order = json.loads(_text(archive.attrs.get("columns")) or "[]")
    except ValueError:
        return datasets
    first = [name for name in order if isinstance(name, str) and name in datasets] if isinstance(order, list) else []
    return {name: datasets[name] for name in dict.fromkeys([*first, *datasets])}


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


def _blocks(columns: Sequence[tuple[h5py.Dataset, int]]) -> Iterator[np.ndarray]:
    """The datasets side by side, of each the columns that are asked for."""
    import numpy as np

    rows = len(columns[0][0]) if columns else 0
    size = max(1, PIECE // max(1, len(columns)))
    for start in range(0, rows, size):
        block = np.empty((len(columns), min(size, rows - start)))
        for dataset, group in groupby(enumerate(columns), key=lambda column: column[1][0]):
            part = dataset[start : start + size].reshape(block.shape[1], -1)
            for index, (_, column) in group:
                block[index] = part[:, column]
        yield block.T


def _text(value: Any) -> str:
    """An attribute that is a text; empty for anything else."""
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return text if isinstance(text, str) else ""


FORMAT = TableFormat("hdf5", (".h5", ".hdf5"), Hdf5Writer, read, library="h5py", extra="hdf5")
