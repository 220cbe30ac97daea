"""Headers of .npy, beside numpy's own writer."""

import io
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats.npy_reader import content_name, read_arrays, read_header


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_a_header_is_what_numpy_wrote(version: tuple[int, int]) -> None:
    file = io.BytesIO()
    array = np.asfortranarray(np.arange(6, dtype=">i4").reshape(2, 3))
    np.lib.format.write_array(file, array, version)
    file.seek(0)
    assert read_header(file) == ((2, 3), True, np.dtype(">i4"))
    assert np.array_equal(np.frombuffer(file.read(), ">i4").reshape(2, 3, order="F"), array)


def test_an_unknown_version_is_refused() -> None:
    with pytest.raises(ValueError, match=r"unknown version \(9, 0\)"):
        read_header(io.BytesIO(b"\x93NUMPY\x09\x00" + bytes(100)))


@pytest.mark.parametrize(
    ("dtype", "name"),
    [("U3", "text"), ("O", "objects"), ("c16", "complex values"), ("f4", "float32"), (">f8", ">f8")],
)
def test_contents_have_names(dtype: str, name: str) -> None:
    assert content_name(np.dtype(dtype)) == name


def test_no_more_of_a_header_is_read_than_one_can_have() -> None:
    file = io.BytesIO(b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**24) + bytes(2**24))
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="EOF"):
            read_header(file)
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


def test_arrays_are_read_by_name_as_numpy_reads_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    arrays = {"a": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "b": np.float32(2.5), "c": np.zeros(2**20)}
    np.savez_compressed(path, **arrays)
    with path.open("rb") as file:
        read = read_arrays(path, file, ["a", "b", "d"])
    with np.load(path) as expected:
        assert {name: values.tolist() for name, values in read.items()} == {n: expected[n].tolist() for n in ("a", "b")}
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with path.open("rb") as file, pytest.raises(FileError, match="would expand"):
        read_arrays(path, file, ["c"])
