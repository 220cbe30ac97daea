"""Tables to write, and independent readers of them: csv, json, pyarrow, numpy, scipy and h5py."""

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import scipy.io
from hypothesis import HealthCheck, settings

from mjrun.formats.table_reader import open_table, read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.table_column import Column
from tests.formats.outputs import names as names

COLUMNS = [
    Column("time", "s", "simulated time"),
    Column("qpos/knee", "rad", "joint angle", "joint", 3),
    Column("qpos/torso/x", "m", "position", "joint", 0),
]
MANIFEST = {"mjrun": "0.1.0", "seed": 7}
ODD = [0.0, -0.0, 5e-324, -2.2250738585072014e-308, 0.1, 1 / 3, 1e22, 1e23, 123456789012345680.0]
ODD += [-1.7976931348623157e308]
BROKEN = [float("nan"), float("inf"), float("-inf")]
hypothesis = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def columns(*names: str) -> list[Column]:
    return [Column(name) for name in names]


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def write(path: Path, blocks: list[np.ndarray], of: list[Column] = COLUMNS) -> Path:
    """A published table, in the format that the path's suffix means."""
    with TableWriter(str(path), output_format(str(path)).name, of, MANIFEST) as out:
        for block in blocks:
            out.write(block)
        out.publish()
    return path


def bits(values: object) -> list[int]:
    """The float64 patterns of `values`, every NaN as one: text has only one."""
    array = np.asarray(values, np.float64)
    return np.where(np.isnan(array), np.nan, array).view(np.uint64).tolist()


def everything(name: str) -> bool:
    return True


def lists(path: Path, *wanted: str) -> dict[str, list[float]]:
    """The wanted columns as mjrun reads them, or else all of them."""
    table = read_table(path, lambda name: not wanted or name in wanted).columns
    assert all(column.dtype == np.float64 and column.ndim == 1 for column in table.values())
    return {name: column.tolist() for name, column in table.items()}


def exact(path: Path) -> dict[str, list[Any]]:
    """All columns as mjrun reads them with texts and integers of any size."""
    with open_table(path, exact=True) as table:
        rows = [row for block in table.blocks() for row in block.tolist()]
        return {name: [row[index] for row in rows] for index, name in enumerate(table.names)}


@dataclass(frozen=True)
class Stored:
    """The content of a file as an independent reader sees it: the cells of .csv are texts."""

    columns: dict[str, list[Any]]
    units: dict[str, str] = field(default_factory=dict)
    manifest: dict[str, Any] | None = None


def _csv(path: Path) -> Stored:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file, strict=True)
    assert all(len(row) == len(head) for row in rows)
    return Stored({name: [row[index] for row in rows] for index, name in enumerate(head)})


def _jsonl(path: Path) -> Stored:
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    return Stored({name: [row[name] for row in rows] for name in rows[0]} if rows else {})


def _arrow(read: Callable[[Path], pa.Table]) -> Callable[[Path], Stored]:
    def stored_by(path: Path) -> Stored:
        table = read(path)
        table.validate(full=True)
        units = {each.name: each.metadata[b"unit"].decode() for each in table.schema}
        columns = {name: table[name].to_pylist() for name in table.column_names}
        return Stored(columns, units, json.loads(table.schema.metadata[b"mjrun"]))

    return stored_by


def _npz(path: Path) -> Stored:
    with np.load(path) as archive:
        columns = {name: archive[name].tolist() for name in archive.files if not name.startswith("__")}
        return Stored(columns, json.loads(str(archive["__units__"])), json.loads(str(archive["__manifest__"])))


def _mat(path: Path) -> Stored:
    variables = scipy.io.loadmat(path)
    names, own, units = ([str(cell[0]) if len(cell) else "" for cell in variables[key].ravel()] for key in _MAT_CELLS)
    assert all(variables[name].shape[1:] == (1,) for name in own)
    columns = [variables[name].ravel().tolist() for name in own]
    texts = [[(str(c[0]) if len(c) else "") if isinstance(c, np.ndarray) else c for c in cells] for cells in columns]
    manifest = json.loads(str(variables["manifest"][0]))
    return Stored(dict(zip(names, texts, strict=True)), dict(zip(names, units, strict=True)), manifest)


_MAT_CELLS = ("columns", "variables", "units")


def _hdf5(path: Path) -> Stored:
    datasets: list[tuple[int, str, str, list[Any]]] = []

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            values = np.asarray(item.asstr()[:] if item.dtype.kind == "O" else item[:]).tolist()
            attributes: Any = item.attrs
            texts = [attributes.get(key, other).decode() for key, other in (("name", name.encode()), ("unit", b""))]
            datasets.append((int(attributes["index"]), *texts, values))

    with h5py.File(path) as archive:
        archive.visititems(visit)
        manifest: Any = archive.attrs["manifest"]
        datasets.sort()
        units = {name: unit for _, name, unit, _ in datasets}
        return Stored({name: values for _, name, _, values in datasets}, units, json.loads(manifest))


READERS: dict[str, Callable[[Path], Stored]] = {
    ".csv": _csv,
    ".jsonl": _jsonl,
    ".parquet": _arrow(pq.read_table),
    ".feather": _arrow(pyarrow.feather.read_table),
    ".npz": _npz,
    ".mat": _mat,
    ".hdf5": _hdf5,
}


def stored(path: Path) -> Stored:
    """The content of a table that mjrun wrote."""
    return READERS[path.suffix](path)


def numbers(cells: list[Any]) -> list[float]:
    """Stored cells as numbers; null is NaN."""
    return [np.nan if cell is None else float(cell) for cell in cells]
