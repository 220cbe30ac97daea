"""Limits on the expansion of compressed files: a small file that would fill the memory is refused before it is
decoded.
"""

import os
from pathlib import Path
from typing import BinaryIO

from mjrun.errors import FileError

FREE = 2**30  # bytes that any file may expand to
RATIO = 100  # bytes in memory for each byte of a larger file; deflate makes a thousand of one
HINT = "if you trust it, write it again without compression"


def largest_expansion(size: int) -> int:
    """Returns the number of bytes that the content of a file of `size` bytes may take in memory."""
    return max(FREE, RATIO * size)


def excess(path: Path, size: int, file: BinaryIO | None = None) -> str:
    """Returns what is wrong with a file that takes `size` bytes in memory; empty if nothing is.

    Args:
      file: the open file, where its path does not lead to it.
    """
    own = own_size(path, file)
    if size <= largest_expansion(own):
        return ""
    return f"would expand to {size / 1e9:,.3g} GB in memory, {size / max(1, own):,.0f} times its size"


def own_size(path: Path, file: BinaryIO | None = None) -> int:
    """Returns the size of a file [bytes]; of the open file, where its path does not lead to it."""
    return (os.fstat(file.fileno()) if file else path.stat()).st_size


def require_expandable(path: Path, size: int, file: BinaryIO | None = None) -> None:
    """Checks that a file which takes `size` bytes in memory does not fill it out of proportion to its own size.

    Args:
      file: the open file, where its path does not lead to it.

    Raises:
      FileError: it does.
    """
    if fault := excess(path, size, file):
        raise FileError(path, fault, HINT)
