"""Pickles are read, and not run."""

import os
import pickle
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.policy.normalization import InertPickledObject, read_inert


class Plain:
    def __init__(self) -> None:
        self.array, self.number, self.inner = np.arange(6.0).reshape(2, 3), np.float64(2.5), OrderedDict(a=np.ones(2))


class Calling:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_are_arrays_and_objects_their_values(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"thing": Plain()}, protocol))
    root = read_inert(path)
    assert isinstance(root, dict)
    thing = root["thing"]
    if protocol < 2:  # which makes objects by calling a function: one more that does nothing
        assert isinstance(thing, InertPickledObject)
        return
    assert thing.name.endswith("test_safe_unpickler.Plain")
    array, number, inner = thing.values["array"], thing.values["number"], thing.values["inner"]
    assert isinstance(inner, InertPickledObject)
    assert np.array_equal(np.asarray(array), Plain().array)
    assert float(np.asarray(number)) == 2.5
    assert np.asarray(inner.values["a"]).tolist() == [1, 1]


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["f2", "<f4", ">f8", "i1", "u8", "?"])
@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_arrays_of_any_numbers_are_read(tmp_path: Path, order: str, kind: str, protocol: int) -> None:
    array = np.arange(6).reshape(2, 3).astype(kind, order=order)  # type: ignore[call-overload]
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(array, protocol))
    read = np.asarray(read_inert(tmp_path / "a.pkl"))
    assert np.array_equal(read, array)
    assert np.asarray(read_inert(tmp_path / "a.pkl"), np.float64).dtype == np.float64


@pytest.mark.parametrize("array", [np.array(["a"]), np.array([{}], object), np.zeros(2, "f8,i4"), np.array([1j])])
def test_arrays_of_anything_else_are_not(tmp_path: Path, array: np.ndarray) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(array))
    with pytest.raises(ValueError, match=r"its numbers have the unsupported type|does not hold numbers"):
        np.asarray(read_inert(tmp_path / "a.pkl"))


def test_no_code_runs(tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps([Calling(tmp_path / "made"), np.ones(3)]))
    inert, array = read_inert(path)  # type: ignore[misc]
    assert (inert.name, np.asarray(array).tolist()) == ("posix.mkdir", [1, 1, 1])
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    "content", [b"", b"no pickle", pickle.dumps(np.ones(9))[:-20], b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x7f"]
)
def test_what_is_damaged_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"a.pkl: is not a pickle, or is damaged"):
        read_inert(path)
