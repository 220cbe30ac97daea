"""Headers of .npy, beside numpy's own writer."""

import io

import numpy as np
import pytest

from mjrun.formats.npy_header import content_name, read_header


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
