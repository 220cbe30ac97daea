"""The header of NumPy's .npy, read without unpickling anything."""

from typing import IO

import numpy as np

NUMERIC = "biuf"  # the kinds of types that hold numbers: booleans, integers, floats
_CONTENTS = {"U": "text", "S": "text", "O": "objects", "c": "complex values"}
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """The shape of an array, whether it is in Fortran order, and its type; `file` is then at its first value.

    Raises:
      ValueError: this is no array, or of a version that mjrun does not know.
    """
    version = np.lib.format.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"an array is of the unknown version {version}")
    return _HEADERS[version](file)


def content_name(dtype: np.dtype) -> str:
    """What an array of this type holds, in words."""
    return _CONTENTS.get(dtype.kind, dtype.name if dtype.isnative else dtype.str)
