"""NumPy archives, beside numpy and zipfile."""

import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats import table_read_stream
from mjrun.formats.table_reader import read_table
from tests.formats.table_files import everything, lists, write


def test_npz_is_an_archive_that_any_unzip_takes(tmp_path: Path) -> None:
    with zipfile.ZipFile(write(tmp_path / "t.npz", [np.zeros((4, 3))])) as archive:
        assert archive.testzip() is None
        assert archive.namelist()[:2] == ["time.npy", "qpos/knee.npy"]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_of_numpy_is_read(tmp_path: Path, save: Callable[..., None]) -> None:
    arrays = {
        "time": np.arange(7) / 7,
        "int": np.arange(7, dtype=np.int16),
        "big": np.arange(7, dtype=">f4") / 3,
        "tall": np.arange(7.0)[:, None],
        "fortran": np.asfortranarray(np.arange(7.0)[:, None]),
        "bool": np.arange(7) % 2 == 0,
        "strided": np.arange(14.0)[::2],
    }
    save(tmp_path / "t.npz", **arrays, note=np.array(["x"] * 3), matrix=np.zeros((2, 2)))
    assert lists(tmp_path / "t.npz", *arrays) == {name: array.ravel().tolist() for name, array in arrays.items()}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("order", ["C", "F"])
def test_an_array_of_several_columns_is_read_as_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, save: Callable[..., None], order: Any
) -> None:
    monkeypatch.setattr(table_read_stream, "PIECE", 8)
    qpos, frames = np.random.default_rng(1).random((11, 3)), np.zeros((11, 4, 4))
    save(tmp_path / "t.npz", time=np.arange(11.0), qpos=np.asarray(qpos, order=order), frames=frames, after=np.ones(11))
    names: list[str] = []
    read_table(tmp_path / "t.npz", lambda name: bool(names.append(name)))
    assert names == ["time", "qpos/0", "qpos/1", "qpos/2", "frames", "after"]
    table = read_table(tmp_path / "t.npz", ["qpos/2", "qpos/0", "after"])
    assert table.names == ["qpos/0", "qpos/2", "after"]
    assert np.array_equal(np.column_stack(list(table.columns.values())), np.c_[qpos[:, [0, 2]], np.ones(11)])
    with pytest.raises(FileError, match=r"column 'frames' has the shape \(11, 4, 4\), not \(n,\) or \(n, k\)$"):
        read_table(tmp_path / "t.npz", "frames")


def test_what_is_pickled_stays_so(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(tmp_path / "sprung"),)

    path = tmp_path / "t.npz"
    np.savez(path, time=np.array([Trap()]))
    for wanted in (everything, "x".__eq__):
        try:
            read_table(path, wanted)
        except FileError as error:
            assert str(error) == f"{path}: column 'time' holds objects, not numbers"  # noqa: PT017
    assert not (tmp_path / "sprung").exists()


def test_units_that_are_of_no_use_are_left_out(tmp_path: Path) -> None:
    for units in (np.zeros(3), np.array("[1]"), np.array('{"time": 3}'), np.array(["s"])):
        np.savez(tmp_path / "t.npz", time=np.arange(2.0), __units__=units)
        assert read_table(tmp_path / "t.npz").units == {"time": ""}
    np.savez(tmp_path / "t.npz", time=np.arange(2.0), __units__=np.array('{"time": "s", "other": "m"}'))
    assert read_table(tmp_path / "t.npz").units == {"time": "s"}
