"""MATLAB tables, beside scipy."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import FileError
from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import mat
from mjrun.model.column import Column
from tests.formats.table_files import COLUMNS, names, write


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
