"""Hidden files and folders in which outputs are written, each locked by the process that writes it.

The system ends the lock with the process, however that ends: what is not locked was left behind.
"""

import contextlib
import errno
import fcntl
import os
import re
import shutil
import stat
import tempfile
import threading
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

from mjrun.errors import FileError

NAME = re.compile(r"\..+\.mjrun-([0-9a-f]{8})[0-9a-f]{8}\.part(\.\w+)?")
NO_LOCKS = (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # of a file system
LONGEST = 200  # bytes of a name that others can be added to
WEEK = 7 * 24 * 3600  # [s]


class _Entered(threading.local):
    """The folders whose blocks `one_at_a_time` this thread is in."""

    def __init__(self) -> None:
        self.folders = set[str]()


_entered = _Entered()


class TemporaryOutput:
    """A hidden file or folder beside `target`, of this process until it is removed.

    Args:
      suffix: of its name, for what is read by its suffix.

    Raises:
      OSError: it cannot be made.
    """

    def __init__(self, target: Path, *, folder: bool = False, suffix: str = "") -> None:
        self._lock: int | None = None
        while True:
            self.path = unused_name(target, suffix)
            if folder:
                self.path.mkdir()
            else:
                os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            try:
                self._lock = _locked(self.path)
            except OSError as error:
                if error.errno in NO_LOCKS:  # then nothing is ever taken for left behind
                    return
                remove(self.path)
                raise
            if self._lock is not None:
                return

    def release(self) -> None:
        """Gives up the lock; what is still there may be taken for left behind."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def remove(self) -> None:
        """Removes what is there."""
        remove(self.path)
        self.release()


@contextlib.contextmanager
def temporary_file(target: Path, content: bytes, suffix: str) -> Iterator[Path]:
    """A hidden file beside `target`, for as long as the `with` block lasts.

    Raises:
      OSError: it cannot be written.
    """
    temporary = TemporaryOutput(target, suffix=suffix)
    try:
        temporary.path.write_bytes(content)
        yield temporary.path
    finally:
        temporary.remove()


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder for files that nobody else needs, where the system has such, for as long as the `with` block lasts.

    That of a process that was killed is removed by the next that makes one.

    Raises:
      FileError: it cannot be made.
    """
    try:
        home = _temporary_home()
        remove_left_behind(home)
        temporary = TemporaryOutput(home / "mjrun", folder=True)
    except OSError as error:
        where = tempfile.tempdir or "no folder"
        reason = f"cannot hold temporary files: {error.strerror or error}"
        raise FileError(where, reason, "TMPDIR names another folder for them") from None
    try:
        inner = temporary.path / "files"  # as the outer one is locked, where outputs would wait to be published
        inner.mkdir()
        yield inner
    finally:
        temporary.remove()


def _temporary_home() -> Path:
    """Where the system has temporary files.

    TMPDIR is taken as it is, if it can be written to: Python proves that by a file, which a kill would leave there.
    """
    named = os.environ.get("TMPDIR", "")
    if tempfile.tempdir is None and os.path.isdir(named) and os.access(named, os.W_OK | os.X_OK):  # noqa: PTH112
        tempfile.tempdir = os.path.abspath(named)  # noqa: PTH100
    return Path(tempfile.gettempdir())


def unused_name(target: Path, suffix: str = "") -> Path:
    """A name beside `target` for what is soon removed."""
    return target.parent / f"{_prefix(target)}{_machine()}{os.urandom(4).hex()}.part{suffix}"


def remove_left_behind(folder: Path) -> None:
    """Removes what processes that are gone have left in a folder."""
    with left_behind(folder) as leftovers:
        for path in leftovers:
            remove(path)


@contextlib.contextmanager
def left_behind(folder: Path, target: Path | None = None) -> Iterator[list[Path]]:
    """What processes that are gone have left in a folder, of outputs to `target` alone if that is given.

    It is locked within the `with` block. Not every file system tells of the locks of other machines: in general, what
    they have left counts after a week.
    """
    prefix = "." if target is None else _prefix(target)
    with contextlib.ExitStack() as stack:
        matches, leftovers = list[re.Match[str]](), list[Path]()
        with contextlib.suppress(OSError):  # it may be written to, but not listed
            matches = [match for path in folder.iterdir() if (match := NAME.fullmatch(path.name))]
        for match in matches:
            path = folder / match[0]
            with contextlib.suppress(OSError):
                is_ours = target is not None or match[1] == _machine() or time.time() - path.stat().st_mtime > WEEK
                if is_ours and match[0].startswith(prefix) and (lock := _locked(path, wait=False)) is not None:
                    stack.callback(os.close, lock)
                    leftovers.append(path)
        yield leftovers


def remove(path: Path) -> None:
    """Removes a file or a folder, as far as it can be."""
    with contextlib.suppress(OSError):
        if stat.S_ISDIR(path.lstat().st_mode):
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Waits until nobody else is in such a block of the same folder, where its file system has locks.

    A block within a block of the same thread waits for nothing.
    """
    place = os.path.realpath(folder)
    if place in _entered.folders:
        yield
        return
    lock: int | None = None
    with contextlib.suppress(OSError):
        lock = _locked(folder)
    _entered.folders.add(place)
    try:
        yield
    finally:
        _entered.folders.remove(place)
        if lock is not None:
            os.close(lock)


def _prefix(target: Path) -> str:
    name = os.fsencode(target.name)
    return f".{target.name if len(name) <= LONGEST else f'{zlib.crc32(name):08x}'}.mjrun-"


def _machine() -> str:
    return f"{zlib.crc32(os.uname().nodename.encode()):08x}"


def _locked(path: Path, *, wait: bool = True) -> int | None:
    """A descriptor that holds the lock of a file or folder; None if somebody has removed it meanwhile.

    Raises:
      OSError: another process holds the lock and is not to be waited for, or there are no locks.
    """
    is_folder = path.is_dir()
    try:
        descriptor = os.open(path, (os.O_RDONLY if is_folder else os.O_RDWR) | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        if os.path.samestat(os.fstat(descriptor), path.lstat()):
            return descriptor
    except FileNotFoundError:
        pass
    except BaseException:
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None
