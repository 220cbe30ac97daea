"""The exchange of two names in one step, which only Linux supports."""

import ctypes
import os
from pathlib import Path

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # constants of Linux: paths relative to the working folder; swap both names


def exchange(one: Path, other: Path) -> bool:
    """Exchanges two names in one step, and returns whether that worked: only some file systems of Linux support it."""
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except (AttributeError, TypeError):  # not Linux
        return False
    return renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0
