"""Limits on the content of HDF5 datasets, checked before they are read."""

import math
from pathlib import Path
from typing import BinaryIO

import h5py

from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError


def require_own_content(path: Path, what: str, dataset: h5py.Dataset, file: BinaryIO | None = None) -> None:
    """Checks that the content of a dataset is in its file, and does not expand out of proportion.

    Args:
      what: the dataset in messages.
      file: the open file, where its path does not lead to it.

    Raises:
      FileError: it is in another file, or one chunk of it, which is read whole, is too large.
    """
    if dataset.is_virtual or dataset.external:
        raise FileError(path, f"{what} is in another file, which is not read")
    require_expandable(path, math.prod(dataset.chunks or (1,)) * dataset.dtype.itemsize, file)
