"""MATLAB tables, beside scipy."""

import re
import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import FileError
from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import mat
from mjrun.model.table_column import Column
from tests.formats.table_files import COLUMNS, everything, lists, names, put, write


def test_a_mat_cell_of_texts_too_large_for_the_format_is_refused_as_its_rows_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = "🚗" * 15
    rows = np.zeros((100, 1))
    written = write(tmp_path / "all.mat", [rows], [Column("geom1", labels=(long,))]).stat().st_size
    monkeypatch.setattr(mat, "LIMIT", written)
    with TableWriter(str(tmp_path / "t.mat"), "mat", [Column("geom1", labels=(long,))]) as out:
        out.write(rows[:50])
        with pytest.raises(FileError, match=r"t.mat: cannot be written: a .mat file holds at most 2 GiB per column"):
            out.write(rows)


@given(st.lists(st.text(max_size=80) | st.sampled_from(["a/b", "a_b", "a.b", "units", "x" * 90]), unique=True))
def test_matlab_variables_are_valid_and_unlike(named: list[str]) -> None:
    variables = mat.identifiers(named)
    assert len({*variables, *mat.RESERVED}) == len(named) + len(mat.RESERVED)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", variable) for variable in variables)


def test_a_matlab_variable_is_called_like_its_column() -> None:
    named = ["time", "qpos/knee", "qpos/torso/x", "joint:3", "a/b", "a:b", "3d"]
    assert mat.identifiers(named) == ["time", "qpos_knee", "qpos_torso_x", "joint_3", "a_b", "a_b_2", "x3d"]


def test_a_mat_variable_too_large_for_the_format_is_refused_as_its_rows_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mat, "LIMIT", 8 * 100)
    with TableWriter(str(tmp_path / "t.mat"), "mat", COLUMNS) as out:
        out.write(np.zeros((99, 3)))
        with pytest.raises(FileError, match=r"t.mat: cannot be written: a .mat file holds at most 2 GiB per column"):
            out.write(np.zeros((1, 3)))
    assert names(tmp_path) == []


@pytest.mark.parametrize("compress", [False, True])
def test_a_matrix_of_several_columns_is_read_as_each(tmp_path: Path, compress: bool) -> None:
    qpos = np.random.default_rng(1).random((7, 3))
    variables = {
        "time": np.arange(7.0)[:, None],
        "lying": np.arange(7.0)[None],
        "qpos": qpos,
        "cube": np.zeros((7, 2, 2)),
    }
    scipy.io.savemat(tmp_path / "t.mat", variables, do_compression=compress)
    names: list[str] = []
    read_table(tmp_path / "t.mat", lambda name: bool(names.append(name)))
    assert names == ["time", "lying", "qpos/0", "qpos/1", "qpos/2", "cube"]
    table = read_table(tmp_path / "t.mat", ["lying", "qpos/2", "qpos/0"])
    assert np.array_equal(np.column_stack(list(table.columns.values())), np.c_[np.arange(7), qpos[:, [0, 2]]])


MATLAB = Path(scipy.io.__file__).parent / "matlab/tests/data"  # files that MATLAB wrote, which scipy brings along


VECTORS = [path for kind in ("bool", "double", "minus", "multi") for path in MATLAB.glob(f"test{kind}_[5-8]*.mat")]


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
