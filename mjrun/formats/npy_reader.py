"""NumPy's .npy, read without unpickling: the header of an array, and arrays in an archive by their names."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO

from mjrun.decompression_limits import require_expandable

if TYPE_CHECKING:
    import numpy as np

NUMERIC = "biuf"  # kinds of types that hold numbers: booleans, integers, floats
_CONTENTS = {"U": "text", "S": "text", "O": "objects", "c": "complex values"}
_LENGTHS = {(1, 0): 2, (2, 0): 4}  # bytes of the length of a header, by version
_LONGEST = 2**16  # bytes of a header that are read; NumPy would read as many as the file states, up to 4 GiB


def read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Reads the shape of an array, whether it is in Fortran order, and its type; stops at its first value.

    Raises:
      ValueError: the file is not an array, or has an unknown version.
    """
    import numpy as np

    npy = np.lib.format
    version = npy.read_magic(file)
    if version not in _LENGTHS:
        raise ValueError(f"an array has the unknown version {version}")
    length = file.read(_LENGTHS[version])
    header = file.read(min(int.from_bytes(length, "little"), _LONGEST))
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    return read(io.BytesIO(length + header))


def read_arrays(path: Path, file: BinaryIO, names: Collection[str]) -> dict[str, np.ndarray]:
    """Reads the arrays of numbers with these names in the archive `file`; missing ones are left out.

    Args:
      path: path of the archive, for messages.

    Raises:
      FileError: together they would fill the memory.
      ValueError: an array is damaged, or holds something other than numbers.
    """
    import numpy as np

    arrays: dict[str, np.ndarray] = {}
    with zipfile.ZipFile(file) as archive:
        members = {name: archive.NameToInfo[f"{name}.npy"] for name in names if f"{name}.npy" in archive.NameToInfo}
        require_expandable(path, sum(info.file_size for info in members.values()))
        for name, info in members.items():
            with archive.open(info) as member:
                shape, by_column, dtype = read_header(member)
                if dtype.kind not in NUMERIC:
                    raise ValueError(f"{name!r} holds {content_name(dtype)}, not numbers")
                values = np.frombuffer(member.read(math.prod(shape) * dtype.itemsize), dtype)
            arrays[name] = values.reshape(shape, order="F" if by_column else "C")
    return arrays


def content_name(dtype: np.dtype) -> str:
    """Returns the kind of content of an array of this type, in words."""
    return _CONTENTS.get(dtype.kind, dtype.name if dtype.isnative else dtype.str)
