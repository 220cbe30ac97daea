"""Hidden files and folders in which outputs are written, each locked by the process that writes it.

The system releases the lock when the process ends: files and folders without a lock are leftovers.
"""

import contextlib
import errno
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

from mjrun.errors import FileError, PartlyDoneError
from mjrun.platform import system
from mjrun.shared_status import note_folder

NAME = re.compile(r"\..+\.mjrun-([0-9a-f]{8})[0-9a-f]{8}\.part(\.\w+)?")
NO_LOCKS = (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # a file system without locks
LONGEST = 200  # bytes of a name that can still be extended
OTHER_FOLDER = "set TMPDIR to another folder"
WEEK = 7 * 24 * 3600  # [s]


_thread = threading.local()  # `folders`: those whose blocks `one_at_a_time` the thread has entered


class TemporaryOutput:
    """A hidden file or folder beside `target`, locked by this process until it is removed.

    Args:
      suffix: suffix of its name, for files that are read by their suffix.

    Raises:
      OSError: it cannot be created.
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
                self._lock = system.locked(self.path)
            except OSError as error:
                if error.errno in NO_LOCKS:  # then nothing counts as left behind
                    return
                remove(self.path)
                raise
            if self._lock is not None:
                return

    def release(self) -> None:
        """Releases the lock; the file or folder then counts as left behind."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def remove(self) -> None:
        """Removes the file or folder, and releases the lock."""
        remove(self.path)
        self.release()


@contextlib.contextmanager
def temporary_file(target: Path, content: bytes, suffix: str) -> Iterator[Path]:
    """Creates a hidden file beside `target` for the duration of the `with` block.

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
    """Creates a folder for temporary files for the duration of the `with` block.

    A folder that a killed process left behind is removed by the process that monitors it, or by the next process that
    creates one. An error of a file in it states how to choose another place.

    Raises:
      FileError: it cannot be created.
    """
    with contextlib.ExitStack() as stack:
        with temporary_file_errors():
            home = _temporary_home()
            remove_left_behind(home)
            note_folder(home)
            temporary = TemporaryOutput(home / "mjrun", folder=True)
            stack.callback(temporary.remove)
            inner = temporary.path / "files"  # outputs in the outer one, which is locked, could not be published
            inner.mkdir()
        try:
            yield inner
        except (FileError, PartlyDoneError) as error:
            if str(inner) in str(error):
                error.__notes__ = [OTHER_FOLDER]  # no others, about files that are removed here
            raise


@contextlib.contextmanager
def temporary_file_errors() -> Iterator[None]:
    """Turns errors of the operating system in the `with` block into a FileError of the folder for temporary files."""
    try:
        yield
    except OSError as error:
        where = tempfile.tempdir or "no folder"
        raise FileError(where, f"cannot hold temporary files: {error.strerror or error}", OTHER_FOLDER) from None


def _temporary_home() -> Path:
    """Returns the folder of the system for temporary files.

    TMPDIR is used unchanged if it is writable: Python would test it with a file, which a kill would leave there.
    """
    named = os.environ.get("TMPDIR", "")
    if tempfile.tempdir is None and os.path.isdir(named) and os.access(named, os.W_OK | os.X_OK):  # noqa: PTH112
        tempfile.tempdir = os.path.abspath(named)  # noqa: PTH100
    return Path(tempfile.gettempdir())


def unused_name(target: Path, suffix: str = "") -> Path:
    """Returns an unused name beside `target` for a temporary file."""
    return target.parent / f"{_prefix(target)}{_machine()}{os.urandom(4).hex()}.part{suffix}"


def published_in(folder: Path) -> list[Path]:
    """Returns the files and folders in a folder, without those in which outputs are being written.

    Raises:
      OSError: the folder cannot be read.
    """
    return [path for path in folder.iterdir() if not NAME.fullmatch(path.name)]


def remove_left_behind(folder: Path) -> None:
    """Removes files and folders that ended processes have left in a folder."""
    with left_behind(folder) as leftovers:
        for path in leftovers:
            remove(path)


@contextlib.contextmanager
def left_behind(folder: Path, target: Path | None = None) -> Iterator[list[Path]]:
    """Lists the files and folders that ended processes have left in a folder; for outputs to `target` if it is given.

    They are locked during the `with` block. Not every file system reports the locks of other machines: without a
    target, what these have left counts only after a week.
    """
    prefix = "." if target is None else _prefix(target)
    with contextlib.ExitStack() as stack:
        matches: list[re.Match[str]] = []
        leftovers: list[Path] = []
        with contextlib.suppress(OSError):  # it may be writable, but not readable
            matches = [match for path in folder.iterdir() if (match := NAME.fullmatch(path.name))]
        for match in matches:
            path = folder / match[0]
            with contextlib.suppress(OSError):
                is_ours = target is not None or match[1] == _machine() or time.time() - path.stat().st_mtime > WEEK
                if is_ours and match[0].startswith(prefix) and (lock := system.locked(path, wait=False)) is not None:
                    stack.callback(os.close, lock)
                    leftovers.append(path)
        yield leftovers


def remove(path: Path) -> None:
    """Removes a file or a folder, as far as possible."""
    with contextlib.suppress(OSError):
        if stat.S_ISDIR(path.lstat().st_mode):
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Runs one `with` block of a folder at a time, among all processes, if its file system has locks.

    A block within a block of the same thread does not wait.
    """
    place = os.path.realpath(folder)
    entered: set[str] = _thread.__dict__.setdefault("folders", set())
    if place in entered:
        yield
        return
    lock: int | None = None
    with contextlib.suppress(OSError):
        lock = system.locked(folder)
    entered.add(place)
    try:
        yield
    finally:
        entered.remove(place)
        if lock is not None:
            os.close(lock)


def _prefix(target: Path) -> str:
    name = os.fsencode(target.name)
    return f".{target.name if len(name) <= LONGEST else f'{zlib.crc32(name):08x}'}.mjrun-"


def _machine() -> str:
    return f"{zlib.crc32(system.machine_name().encode()):08x}"
