"""Hidden files and folders in which outputs are written, and their move to the places of older outputs.

Each is locked by the process that writes it. The system releases the lock when the process ends: files and folders
without a lock are leftovers.

A move is safe against failures and kills. Frames wait in the folder `new` of a temporary folder. A folder of frames is
exchanged for the older one in one step, or in two that can be undone. Frames with individual names need a rename each:
the folder is called `moving` meanwhile, and the next process that sees it finishes.

Missing folders of outputs are created. All outputs of a process share these: the last one that is cleaned up removes
the empty ones; if the process is killed, the process that monitors it removes them.
"""

import ctypes
import errno
import os
import re
import stat
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from mjrun.errors import FileError, PartlyDoneError, clean
from mjrun.formats.input_file import exists
from mjrun.platform import system
from mjrun.shared_status import note_folder, note_made_folder, uninterrupted

NAME = re.compile(r"\..+\.mjrun-([0-9a-f]{8})[0-9a-f]{8}\.part(\.\w+)?")
NO_LOCKS = (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # a file system without locks
NAME_MAX = 255  # bytes of a name
LONGEST = 200  # bytes of a name that can still be extended
OTHER_FOLDER = "set TMPDIR to another folder"
WEEK = 7 * 24 * 3600  # [s]


TRIES = 100  # attempts while other processes remove folders that they had created
NEW, OLD, MOVING = "new", "old", "moving"
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # constants of Linux: paths relative to the working folder; swap both names

_lock = threading.RLock()
_users: dict[Path, int] = {}  # number of outputs that use each folder that this process has created

FramePath = Callable[[int], Path]  # returns the path of a frame, given its number

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


@contextmanager
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


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Creates a folder for temporary files for the duration of the `with` block.

    A folder that a killed process left behind is removed by the process that monitors it, or by the next process that
    creates one. An error of a file in it states how to choose another place.

    Raises:
      FileError: it cannot be created.
    """
    with ExitStack() as stack:
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


@contextmanager
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


@contextmanager
def left_behind(folder: Path, target: Path | None = None) -> Iterator[list[Path]]:
    """Lists the files and folders that ended processes have left in a folder; for outputs to `target` if it is given.

    They are locked during the `with` block. Not every file system reports the locks of other machines: without a
    target, what these have left counts only after a week.
    """
    prefix = "." if target is None else _prefix(target)
    with ExitStack() as stack:
        matches: list[re.Match[str]] = []
        leftovers: list[Path] = []
        with suppress(OSError):  # it may be writable, but not readable
            matches = [match for path in folder.iterdir() if (match := NAME.fullmatch(path.name))]
        for match in matches:
            path = folder / match[0]
            with suppress(OSError):
                is_ours = target is not None or match[1] == _machine() or time.time() - path.stat().st_mtime > WEEK
                if is_ours and match[0].startswith(prefix) and (lock := system.locked(path, wait=False)) is not None:
                    stack.callback(os.close, lock)
                    leftovers.append(path)
        yield leftovers


def remove(path: Path) -> None:
    """Removes a file or a folder, as far as possible."""
    with suppress(OSError):
        if stat.S_ISDIR(path.lstat().st_mode):
            system.remove_folder(path)
        else:
            path.unlink()


@contextmanager
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
    with suppress(OSError):
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


class ParentFolders:
    """The folder of an output and those above it, which exist until `release`.

    Args:
      shown: path of the output in messages, as the user specified it.
      folder: folder of the output, with its links resolved.

    Raises:
      FileError: the folder is missing and cannot be created, is not a folder, or is not writable.
    """

    def __init__(self, shown: Path, folder: Path) -> None:
        require_short(shown, folder / shown.name)
        self._shown = shown
        self._folder = folder
        self._used: list[Path] = []
        self.make()

    def make(self) -> None:
        """Creates the missing folders, again if another process has removed them.

        Raises:
          FileError: as the constructor.
        """
        with _lock, uninterrupted():
            self.release()
            try:
                if not exists(self._folder):
                    require_no_dangling_link(self._shown, self._folder)
                    self._make_missing()
                if exists(self._folder):  # another process may have removed it again
                    self._require_writable()
            except BaseException:
                self._use()
                self.release()
                raise
            self._use()

    @contextmanager
    def opening(self) -> Generator[None]:
        """Wraps the rest of an output's constructor: a failure releases the folders."""
        try:
            yield
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Removes the folders that this process has created, if they are empty and no other output uses them."""
        with _lock, uninterrupted():
            for folder in self._used:
                _users[folder] -= 1
                if not _users[folder]:
                    del _users[folder]
                    with suppress(OSError):
                        folder.rmdir()
            self._used = []

    def _use(self) -> None:
        self._used = [folder for folder in (self._folder, *self._folder.parents) if folder in _users]
        for folder in self._used:
            _users[folder] += 1

    def _make_missing(self) -> None:
        folder = self._folder
        for attempt in range(TRIES):
            folders = (self._folder, *self._folder.parents)
            try:
                for folder in reversed([each for each in folders if not exists(each)]):
                    _make(folder)
                return
            except NotADirectoryError:
                raise FileError(self._shown, f"{clean(str(folder.parent))} is not a folder") from None
            except OSError as error:
                is_removed = isinstance(error, FileNotFoundError)  # the folder above it, by another process
                if not is_removed or attempt == TRIES - 1:
                    reason = f"the folder {clean(str(folder))} cannot be created: {error.strerror}"
                    raise FileError(self._shown, reason) from None

    def _require_writable(self) -> None:
        fault = ""
        if not self._folder.is_dir():
            fault = f"{clean(str(self._folder))} is not a folder"
        elif not os.access(self._folder, os.W_OK | os.X_OK):
            fault = f"the folder {clean(str(self._folder))} is not writable"
        if fault and exists(self._folder):  # another process may just have removed it
            raise FileError(self._shown, fault)


def require_short(path: Path, target: Path) -> None:
    """Raises FileError if the system allows no path as long as `target`, where `path` leads, or no such name in it."""
    if any(len(os.fsencode(name)) > NAME_MAX for name in target.parts):
        raise FileError(path, f"cannot be written: a name in it is longer than {NAME_MAX} bytes")
    if len(os.fsencode(unused_name(target))) > system.PATH_MAX:
        raise FileError(path, f"cannot be written: its path is too long; the system allows {system.PATH_MAX:,} bytes")


def require_no_dangling_link(path: Path, folder: Path) -> None:
    """Raises FileError if `path`, or a folder above it, is a link, and `folder`, where it leads, is missing."""
    for link in (path, *path.parents):
        if os.path.islink(link) and not exists(link):  # noqa: PTH114 – also of names that are too long
            raise FileError(path, f"the link {clean(str(link))} leads to a missing folder, {clean(str(folder))}")


def _make(folder: Path) -> None:
    with suppress(FileExistsError):  # another process was faster
        folder.mkdir()
        note_made_folder(folder)
        _users.setdefault(folder, 0)


def replace_file(new: Path, target: Path) -> Path | None:
    """Replaces `target` by a file, and returns the path of the older file; None if it is missing or cannot be kept.

    Raises:
      OSError: the replacement failed, and `target` is unchanged.
    """
    if not os.path.lexists(target):
        new.rename(target)
        return None
    if exchange(new, target):
        return new
    _require_replaceable(target)
    older = unused_name(target)
    try:
        system.hard_link(target, older)
    except OSError:
        new.replace(target)
        return None
    try:
        new.replace(target)
    except BaseException:
        remove(older)
        raise
    return older


def _require_replaceable(target: Path) -> None:
    """Checks that a file may be replaced: in a sticky folder, such as /tmp, a file of another user may not.

    A second link to it, which keeps it, could not be removed either.

    Raises:
      PermissionError: it may not be replaced.
    """
    folder, user = target.parent.stat(), system.effective_user()
    is_sticky = bool(folder.st_mode & stat.S_ISVTX)
    if is_sticky and user not in (0, folder.st_uid, target.lstat().st_uid):
        raise PermissionError(errno.EPERM, "another user's file; users can replace only their own here")


def replace_folder(temporary: Path, target: Path) -> None:
    """Replaces the folder `target` by the new frames, and moves its older frames to the temporary folder.

    Raises:
      OSError: the replacement failed, and `target` is unchanged.
    """
    new, old = temporary / NEW, temporary / OLD
    if not target.exists():
        new.rename(target)
    elif not exchange(new, target):
        try:
            target.rename(old)
            new.rename(target)
        except BaseException:
            restore_folder(temporary, target)
            raise


def restore_folder(temporary: Path, target: Path) -> None:
    """Restores the older frames if `target` is missing: the process was stopped between two renames."""
    if (temporary / OLD).exists() and not target.exists():
        (temporary / OLD).rename(target)


def take_back_folder(temporary: Path, target: Path) -> None:
    """Undoes `replace_folder`.

    Raises:
      OSError: the operation failed.
    """
    new = temporary / NEW
    if new.exists():  # it holds the older frames
        replace_folder(temporary, target)
    else:
        target.rename(new)
        restore_folder(temporary, target)


def move_frames(temporary: Path, place: FramePath) -> None:
    """Moves every frame to its place.

    Raises:
      OSError: the replacement failed. Everything is unchanged, or, if undoing failed too, the folder `moving` exists.
    """
    new, moving = temporary / NEW, temporary / MOVING
    names = [frame.name for frame in new.iterdir()]
    (temporary / OLD).mkdir()
    new.rename(moving)
    try:
        finish_frames(temporary, place)
    except BaseException:
        with suppress(OSError):
            take_back_frames(temporary, names, place)
        raise


def finish_frames(temporary: Path, place: FramePath) -> None:
    """Moves the frames that are not yet in their places.

    Raises:
      OSError: the operation failed.
    """
    moving, old = temporary / MOVING, temporary / OLD
    for frame in sorted(moving.iterdir(), key=frame_number):
        target, older = place(frame_number(frame)), old / frame.name
        if os.path.lexists(target) and not os.path.lexists(older):
            if target.is_dir() and not target.is_symlink():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
            try:
                system.hard_link(target, older)
            except OSError:  # a file system without links
                target.rename(older)
        frame.replace(target)
    moving.rmdir()


def take_back_frames(temporary: Path, names: Sequence[str], place: FramePath) -> None:
    """Undoes `move_frames` of frames with these `names`; after every step, it could still be finished instead.

    Raises:
      OSError: the operation failed.
    """
    moving = temporary / MOVING
    moving.mkdir(exist_ok=True)
    for name in names:
        frame, older = moving / name, temporary / OLD / name
        target = place(frame_number(frame))
        if not frame.exists():
            target.rename(frame)
        if os.path.lexists(older):
            older.replace(target)
    moving.rename(temporary / NEW)


def frame_number(path: Path) -> int:
    """Returns the number of a frame, which is the stem of its name."""
    return int(path.stem)


def exchange(one: Path, other: Path) -> bool:
    """Exchanges two names in one step, and returns whether that worked: only some file systems of Linux support it."""
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except (AttributeError, TypeError):  # not Linux
        return False
    return renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0
