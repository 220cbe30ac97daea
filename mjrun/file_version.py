"""Versions of files and folders: numbers that show whether something has changed since it was read."""

import os
import stat
from collections.abc import Callable, Sequence
from typing import IO

COARSEST_TIME = 2 * 10**9  # [ns] between the times that a file system distinguishes, as FAT


def file_version(place: str) -> list[int] | None:
    """Returns numbers that differ once a regular file is replaced, or written after it was settled; None without it."""
    return _version_at(place, stat.S_ISREG)


def folder_version(place: str) -> list[int] | None:
    """Returns numbers that differ once a file in a settled folder has come, gone or been renamed; None without it."""
    return _version_at(place, stat.S_ISDIR)


def content_version(file: IO[bytes]) -> tuple[int, int] | None:
    """Returns numbers that differ once an open regular file is written to, but not if it is replaced or renamed.

    None if it is not a regular file.
    """
    try:
        status = os.fstat(file.fileno())
    except OSError:  # a stream without a descriptor
        return None
    return (status.st_size, status.st_mtime_ns) if stat.S_ISREG(status.st_mode) else None


def version_of(status: os.stat_result) -> list[int]:
    """Returns the version of a file or folder with this status."""
    return [status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns]


def is_settled(version: Sequence[int], since: int) -> bool:
    """Returns whether a file or folder changed so long before `since` [ns] that each later change has another time.

    The time of a change cannot be set back; Windows does not record it.
    """
    return os.name == "posix" and max(version[-2:]) < since - COARSEST_TIME


def _version_at(place: str, is_kind: Callable[[int], bool]) -> list[int] | None:
    try:
        status = os.stat(place)  # noqa: PTH116 – of thousands; pathlib takes longer
    except (OSError, ValueError):
        return None
    return version_of(status) if is_kind(status.st_mode) else None
