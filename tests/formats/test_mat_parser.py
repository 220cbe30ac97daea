"""The parser of MATLAB files, beside scipy and on files that MATLAB wrote."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from mjrun.errors import FileError
from mjrun.formats.table_reader import read_table

MATLAB = Path(scipy.io.__file__).parent / "matlab/tests/data"  # files that MATLAB wrote, which scipy brings along


VECTORS = [path for kind in ("bool", "double", "minus", "multi") for path in MATLAB.glob(f"test{kind}_[5-8]*.mat")]


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def everything(name: str) -> bool:
    return True


def lists(path: Path, *wanted: str) -> dict[str, list[float]]:
    """The wanted columns, or else all of them."""
    found = read_table(path, lambda name: not wanted or name in wanted).columns
    assert all(column.dtype == np.float64 and column.ndim == 1 for column in found.values())
    return {name: column.tolist() for name, column in found.items()}


@pytest.mark.parametrize("packed", [False, True])
def test_mat_of_scipy_is_read_under_its_variables_names(tmp_path: Path, packed: bool) -> None:
    numbers = {
        "time": np.arange(7)[:, None] / 7,
        "row": np.arange(7.0)[None] / 3,
        "int": np.arange(7, dtype=np.int64)[:, None] - 2**60,
        "single": np.arange(7, dtype=np.float32)[:, None] / 3,
        "bool": np.arange(7)[:, None] % 2 == 0,
    }
    others = {"note": "x", "cell": np.array([1, "a"], object), "struct": {"a": 1}, "columns": np.zeros((2, 2))}
    sparse = scipy.sparse.csc_matrix(np.eye(2))
    scipy.io.savemat(tmp_path / "t.mat", {**others, **numbers, "sparse": sparse}, do_compression=packed)
    assert lists(tmp_path / "t.mat", *numbers) == {n: a.ravel().astype(float).tolist() for n, a in numbers.items()}


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.name)
def test_mat_of_matlab_is_read_as_scipy_reads_it(path: Path) -> None:
    found = {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}
    found = {name: value for name, value in found.items() if 1 in value.shape}
    assert found
    assert lists(path, *found) == {name: value.ravel().astype(float).tolist() for name, value in found.items()}


def test_mat_of_a_machine_of_the_other_byte_order_is_read(tmp_path: Path) -> None:
    def element(kind: int, content: bytes) -> bytes:
        return struct.pack(">II", kind, len(content)) + content + bytes(-len(content) % 8)

    parts = [(6, struct.pack(">II", 6, 0)), (5, struct.pack(">ii", 3, 1)), (1, b"time")]
    values = struct.pack(">hhh", 1, -2, 300)  # MATLAB keeps whole numbers small
    matrix = element(14, b"".join(element(*part) for part in [*parts, (3, values)]))
    assert lists(put(tmp_path / "t.mat", bytes(124) + b"\1\0MI" + matrix)) == {"time": [1, -2, 300]}


def test_a_small_file_that_unpacks_to_much_more_than_it_says_is_refused(tmp_path: Path) -> None:
    bomb = zlib.compress(struct.pack("<II", 14, 64) + bytes(2**26))
    path = put(tmp_path / "t.mat", bytes(124) + b"\0\1IM" + struct.pack("<II", 15, len(bomb)) + bomb)
    tracemalloc.start()
    try:
        with pytest.raises(FileError, match=r"cannot be read as .mat: a variable is cut off"):
            read_table(path, everything)
        assert tracemalloc.get_traced_memory()[1] < 2**20  # bytes
    finally:
        tracemalloc.stop()
