"""Tables to write, and what reads them back."""

import csv
from pathlib import Path

import numpy as np

from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.column import Column

COLUMNS = [
    Column("time", "s", "simulated time"),
    Column("qpos/knee", "rad", "joint angle", "joint", 3),
    Column("qpos/torso/x", "m", "position", "joint", 0),
]


MANIFEST = {"mjrun": "0.1.0", "seed": 7}


ODD = [
    0.0,
    -0.0,
    5e-324,
    -2.2250738585072014e-308,
    0.1,
    1 / 3,
    1e22,
    1e23,
    123456789012345680.0,
    -1.7976931348623157e308,
]


BROKEN = [float("nan"), float("inf"), float("-inf")]


def columns(*names: str) -> list[Column]:
    return [Column(name) for name in names]


def write(path: Path, blocks: list[np.ndarray], of: list[Column] = COLUMNS) -> Path:
    """A published table, in the format that the path's suffix means."""
    with TableWriter(str(path), output_format(str(path)).name, of, MANIFEST) as out:
        for block in blocks:
            out.write(block)
        out.publish()
    return path


def read_csv(path: Path) -> dict[str, list[float]]:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file, strict=True)
    assert all(len(row) == len(head) for row in rows)
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(head)}


def bits(values: object) -> list[int]:
    """The float64 patterns of `values`, every NaN as one: text knows only one."""
    array = np.asarray(values, np.float64)
    return np.where(np.isnan(array), np.nan, array).view(np.uint64).tolist()


def names(folder: Path) -> list[str]:
    """What is in a folder, hidden files too."""
    return sorted(path.name for path in folder.iterdir())
