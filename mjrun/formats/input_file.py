"""Input files: checked before they are read, and decoded without trusting them."""

import contextlib
import errno
import os
import stat
import warnings
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from mjrun.confinement.confinement import OUTSIDE, advice, is_readable
from mjrun.errors import FileError, MjrunError, clean, shortened, suggestion
from mjrun.platform import system

T = TypeVar("T")


def is_file(path: str | Path) -> bool:
    """Returns whether `path` is a file. Unlike `Path.is_file`, this accepts names of any length."""
    return os.path.isfile(path)  # noqa: PTH113


def is_folder(path: str | Path) -> bool:
    """Returns whether `path` is a folder; accepts names of any length."""
    return os.path.isdir(path)  # noqa: PTH112


def exists(path: str | Path) -> bool:
    """Returns whether `path` exists; accepts names of any length."""
    return os.path.exists(path)  # noqa: PTH110


def in_any_case(path: Path) -> Iterator[Path]:
    """Yields the files and folders with this path but for the case of the letters in it, at every level."""
    found = [Path(path.anchor)]
    for part in path.relative_to(path.anchor).parts:
        found = [folder / name for folder in found for name in _names_like(folder, part)]
    yield from found


def _names_like(folder: Path, part: str) -> list[str]:
    if part == "..":
        return [part]
    try:
        return [entry.name for entry in folder.iterdir() if entry.name.casefold() == part.casefold()]
    except OSError:
        return []


def files_below(folder: Path, unreadable: Callable[[OSError], object] = lambda error: None) -> Iterator[Path]:
    """Yields the files below a folder, sorted, those of each folder first; skips hidden and linked folders.

    Args:
      unreadable: a function called with the error of each folder that cannot be read.
    """
    for parent, folders, files in os.walk(folder, onerror=unreadable):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(parent) / name for name in sorted(files))


def require_file(path: Path, what: str, suffixes: Collection[str], hint: str = "") -> None:
    """Checks that `path` is a regular file.

    Args:
      what: kind of file in messages, as in `table`.
      suffixes: suffixes of files to suggest if the file is missing.
      hint: further advice for that case.

    Raises:
      FileError: the file is missing or cannot be read.
    """
    with _readable(path, suffixes, hint):
        _check(path, path.stat().st_mode, what, hint)
        if not os.access(path, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


@contextlib.contextmanager
def opened(path: Path, what: str, suffixes: Collection[str], hint: str = "") -> Iterator[BinaryIO]:
    """Opens the regular file at `path` for reading. It is checked once it is open, so that it cannot be exchanged.

    Raises:
      FileError: as `require_file`.
    """
    with _readable(path, suffixes, hint):
        # A pipe without a writer would block.
        number = os.open(path, system.READ_FLAGS)
        try:
            _check(path, os.fstat(number).st_mode, what, hint)
            with os.fdopen(number, "rb", closefd=False) as file:
                yield file
        finally:
            os.close(number)


@contextlib.contextmanager
def _readable(path: Path, suffixes: Collection[str], hint: str) -> Iterator[None]:
    """Turns errors of the operating system into a FileError."""
    if not is_readable(path):
        raise FileError(path, OUTSIDE, advice())
    try:
        yield
    except (FileNotFoundError, NotADirectoryError):
        near = suggestion(path.name, _siblings(path.parent, suffixes))
        raise FileError(path, f"no such file{near}", hint) from None
    except (OSError, ValueError) as error:  # a null byte in the path is a ValueError
        raise FileError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}", hint) from None


def _check(path: Path, mode: int, what: str, hint: str) -> None:
    if not stat.S_ISREG(mode):
        raise FileError(path, f"is a folder, not a {what}" if stat.S_ISDIR(mode) else "is not a regular file", hint)


@contextlib.contextmanager
def decoding(path: Path, fault: str = "", hint: str = "") -> Iterator[None]:
    """Turns the exceptions of a library on a file that it cannot decode, which are undocumented, into a FileError.

    Args:
      fault: description of such a file; `cannot be read as .npz` by default, with its suffix.
      hint: advice for the user.

    Raises:
      FileError: it cannot be decoded, or the operating system failed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (MjrunError, MemoryError):
        raise
    except Exception as error:
        # EINVAL comes from an offset in the content that points before the beginning of the file.
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            raise FileError(path, f"cannot be read: {error.strerror or error}") from None
        reason = (str(error) or "it ends early").splitlines()[0]  # StopIteration and EOFError say nothing
        fault = fault or f"cannot be read as {path.suffix.lower()}"
        raise FileError(path, f"{fault}: {clean(shortened(reason))}", hint) from error


def decoded(path: Path, items: Iterator[T]) -> Iterator[T]:
    """Yields the items that a library decodes one after another, each within `decoding`."""
    end = object()
    while True:
        with decoding(path):
            item = next(items, end)
        if item is end:
            return
        yield item  # type: ignore[misc]


def parse_manifest(text: str | bytes | None) -> dict[str, Any] | None:
    """Returns the manifest in a file; None if `text` is anything else, as the file is untrusted."""
    import json

    try:
        manifest = json.loads(text or "null")
    except (ValueError, RecursionError):
        return None
    return manifest if isinstance(manifest, dict) else None


def _siblings(folder: Path, suffixes: Collection[str]) -> list[str]:
    try:
        return sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in suffixes)
    except OSError:
        return []
