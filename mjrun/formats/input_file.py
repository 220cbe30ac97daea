"""Files that somebody else made: looked at before they are opened, and decoded with care."""

import contextlib
import errno
import os
import stat
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from mjrun.errors import FileError, MjrunError, clean, suggestion

SHOWN = 80  # characters of a foreign text that are shown


def cut(text: str) -> str:
    """`text` as far as it is shown."""
    return text if len(text) <= SHOWN else text[: SHOWN - 1] + "…"


def require_file(path: Path, what: str, suffixes: Collection[str], hint: str = "") -> None:
    """Sees that there is a regular file.

    Args:
      what: is expected, `table`.
      suffixes: of files that may be meant, if there is none.
      hint: what else to do then.

    Raises:
      FileError: there is not.
    """
    with _refused(path, suffixes, hint):
        _check(path, path.stat().st_mode, what, hint)


@contextlib.contextmanager
def opened(path: Path, what: str, suffixes: Collection[str], hint: str = "") -> Iterator[BinaryIO]:
    """The regular file at `path`, to be read. It is looked at once it is open, so that nobody can change it in between.

    Raises:
      FileError: as of `require_file`.
    """
    with _refused(path, suffixes, hint):
        # A pipe without a writer would block.
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            _check(path, os.fstat(number).st_mode, what, hint)
            with os.fdopen(number, "rb", closefd=False) as file:
                yield file
        finally:
            os.close(number)


@contextlib.contextmanager
def _refused(path: Path, suffixes: Collection[str], hint: str) -> Iterator[None]:
    """Tells of what the system refuses."""
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
def decoding(path: Path, fault: str, hint: str = "") -> Iterator[None]:
    """Tells of a file that cannot be decoded. What a library raises then is written nowhere: it may be anything.

    Args:
      fault: what is wrong with such a file, `cannot be read as .npz`.
      hint: what to do then.

    Raises:
      FileError: it cannot be decoded.
      OSError: of the system, not of the content.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (MjrunError, MemoryError):
        raise
    except Exception as error:
        # EINVAL says to look before the beginning of the file, which is of its content.
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            raise
        reason = (str(error) or "it ends early").splitlines()[0]  # StopIteration and EOFError say nothing
        raise FileError(path, f"{fault}: {clean(cut(reason))}", hint) from error


def _siblings(folder: Path, suffixes: Collection[str]) -> list[str]:
    try:
        return sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in suffixes)
    except OSError:
        return []
