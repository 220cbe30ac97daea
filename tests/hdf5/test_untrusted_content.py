"""Strings in HDF5 files, compared with what h5py reads."""

import contextlib
import struct
from io import BytesIO
from typing import Any

import h5py
import numpy as np
import pytest

from mjrun.hdf5.untrusted_content import content_at, text_attributes

LONG = "<mujoco>" + "é" * 70_000 + "</mujoco>"


def written(**settings: Any) -> BytesIO:
    """Returns a file with a group that has attributes of many kinds."""
    content, track_order = BytesIO(), settings.pop("track_order", False)
    with h5py.File(content, "w", **settings) as file:
        group = file.create_group("data/demo", track_order=track_order)
        group.attrs["model_file"] = LONG
        group.attrs["empty"] = ""
        group.attrs["fixed"] = np.bytes_("fixed")
        group.attrs["number"] = 3
        group.attrs["several"] = ["a", "b"]
        group.attrs["größe"] = "ü"
        group.attrs["null"] = h5py.Empty("S3")
    return content


@pytest.mark.parametrize("track_order", [False, True])
@pytest.mark.parametrize("version", ["earliest", "latest"])
@pytest.mark.parametrize("block", [0, 512])
def test_attributes_that_are_one_text_are_those_that_h5py_reads(version: str, block: int, track_order: bool) -> None:
    content = written(libver=version, userblock_size=block, track_order=track_order)
    with h5py.File(content, "r") as file:
        expected = {name: value for name, value in file["data/demo"].attrs.items() if isinstance(value, str)}
        assert text_attributes(content, file["data/demo"]) == expected | {"fixed": "fixed"}
        assert expected["model_file"] == LONG
        assert text_attributes(content, file["data"]) == {}


def test_many_attributes_are_in_several_blocks_of_a_header() -> None:
    content = BytesIO()
    with h5py.File(content, "w") as file:
        for index in range(60):
            file.attrs[f"a{index}"] = f"{index}" * 20
    with h5py.File(content, "r") as file:
        assert text_attributes(content, file["/"]) == dict(file.attrs)


def test_attributes_in_dense_storage_are_refused() -> None:
    content = BytesIO()
    with h5py.File(content, "w", libver="latest") as file:
        for index in range(20):
            file.attrs[f"a{index}"] = "text"
    with h5py.File(content, "r") as file, pytest.raises(ValueError, match="dense storage; write it again with libver"):
        text_attributes(content, file["/"])


@pytest.mark.parametrize("seed", range(60))
def test_damaged_headers_and_heaps_are_read_or_refused_and_never_hang(seed: int) -> None:
    content = written().getvalue()
    damaged, random = bytearray(content), np.random.default_rng(seed)
    heap, header = content.index(b"GCOL"), content.index(b"model_file")
    start = heap if seed % 2 else header - 40
    for at in random.integers(start, start + 120, 3):
        damaged[at] = random.integers(256)
    with h5py.File(BytesIO(content), "r") as file, contextlib.suppress(ValueError, IndexError, struct.error):
        assert isinstance(text_attributes(BytesIO(damaged), file["data/demo"]), dict)


@pytest.mark.parametrize(("place", "count"), [(3, 2), (0, 5), (0, -1)])
def test_content_beyond_the_end_is_refused(place: int, count: int) -> None:
    assert content_at(BytesIO(b"abcd"), 1, 3) == b"bcd"
    with pytest.raises(ValueError, match="it ends early"):
        content_at(BytesIO(b"abcd"), place, count)
