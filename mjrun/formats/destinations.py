"""Destinations of outputs: files, folders and patterns of frames, standard output.

An output is written next to its final place under a temporary name, and renamed when it is complete; the replacement is
safe against failures and kills. Frames wait in the folder `new` of a temporary folder. A folder of frames is exchanged
for the older one in one step, or in two that can be undone. Frames with individual names need a rename each: the folder
is called `moving` meanwhile, and the next process that sees it finishes. Older files are kept until all outputs of the
pass are published.

Missing folders of outputs are created. All outputs of a process share these: the last one that is cleaned up removes
the empty ones; if the process is killed, the process that monitors it removes them.
"""

import contextlib
import ctypes
import errno
import os
import re
import stat
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from mjrun.confinement.confinement import is_writable
from mjrun.errors import FileError, clean, file_errors, option
from mjrun.formats.input_file import exists
from mjrun.formats.temporary_output import TemporaryOutput, left_behind, one_at_a_time, remove, unused_name
from mjrun.interruption import uninterrupted
from mjrun.platform import system
from mjrun.shared_status import note_folder, note_made_folder

TRIES = 100  # attempts while other processes remove folders that they had created
FRAME_NAME = "%06d.png"
NAME_MAX = 255  # bytes in the name of a file
NEW, OLD, MOVING = "new", "old", "moving"
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # constants of Linux: paths relative to the working folder; swap both names

_lock = threading.RLock()
_users: dict[Path, int] = {}  # number of outputs that use each folder that this process has created

FramePath = Callable[[int], Path]  # returns the path of a frame, given its number


class ParentFolders:
    """The folder of an output and those above it, which exist until `release`.

    Args:
      shown: path of the output in messages, as the user specified it.
      folder: folder of the output, with its links resolved.

    Raises:
      FileError: the folder is missing and cannot be created, is not a folder, or is not writable.
    """

    def __init__(self, shown: Path, folder: Path) -> None:
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
        with contextlib.suppress(OSError):
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


class Destination:
    """A place where an output is written, and from which it moves to its final place.

    It is a StagedFile, a StagedFrameFolder or StagedFramePattern of images, or StandardOutput.

    Attributes:
      path: path to write to.
      shown: path in messages, or the URL.
      folder: folder of its final place, if that is a file or a folder.
      stdout: file descriptor to write to, if this is standard output.
    """

    path: str
    shown: Path | str
    folder: Path | None = None
    stdout: int | None = None

    @property
    def remark(self) -> str:
        """A warning about the published output, or an empty string."""
        return ""

    def sync(self) -> None:
        """Syncs the output to the disk."""

    def publish(self) -> list[Path]:
        """Moves the output to its final place and returns its files. The older output is kept until `cleanup`."""
        return []

    def take_back(self) -> None:
        """Undoes `publish`.

        Raises:
          OSError: it cannot be undone.
        """
        raise NotImplementedError

    def cleanup(self) -> None:
        """Removes temporary files: the output unless it was published, and the older one that it replaced."""


class _Staged(Destination):
    """An output that is written beside its place: a file, or a folder of frames.

    Args:
      check: checks that the output can be placed there, and finishes what a killed process left unfinished.
    """

    def __init__(self, shown: Path, target: Path, check: Callable[[], None], *, is_folder: bool) -> None:
        self.shown, self.folder = shown, target.parent
        self._target, self._parents = target, _parents(shown, target)
        with self._parents.opening():
            with file_errors(shown, "written"):
                check()
            self._temporary = _temporary(target, shown, self._parents, folder=is_folder)
        self.path = str(self._temporary.path)
        if is_folder:
            self.path = f"{self.path.replace('%', '%%')}/{NEW}/{FRAME_NAME}"

    def is_between(self) -> bool:
        """Returns whether only a part of it is in its place, so that the next run with this name has to finish."""
        return False

    def cleanup(self) -> None:
        if self.is_between():
            self._temporary.release()
        else:
            self._temporary.remove()
        self._parents.release()


class StagedFile(_Staged):
    """One file.

    Raises:
      FileError: the folder cannot be created, or it or the target cannot be written.
    """

    def __init__(self, target: Path) -> None:
        super().__init__(target, Path(os.path.realpath(target)), self._check, is_folder=False)  # a link stays a link
        self._older: Path | None = None  # the file that was in its place

    def _check(self) -> None:
        try:
            mode = self._target.stat().st_mode
        except FileNotFoundError:
            return
        if not stat.S_ISREG(mode):
            raise FileError(self.shown, "exists and is not a regular file")
        if not os.access(self._target, os.W_OK):
            raise FileError(self.shown, "exists and is read-only")

    def sync(self) -> None:
        with self._temporary.path.open("r+b") as file:  # Windows syncs only files that are open for writing
            os.fsync(file.fileno())

    def publish(self) -> list[Path]:
        self._is_new = not os.path.lexists(self._target)
        with file_errors(self.shown, "written"):
            self._older = replace_file(self._temporary.path, self._target)
        return [Path(self.shown)]

    def take_back(self) -> None:
        if self._older:
            self._older.replace(self._target)
        elif self._is_new:
            self._target.unlink()
        else:
            raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    def cleanup(self) -> None:
        if self._older:
            remove(self._older)
        super().cleanup()


class StagedFrameFolder(_Staged):
    """A folder of numbered frames, which replaces one that holds nothing else.

    If a killed process has left the older folder under another name, it is first restored. Frames are not synced: a
    video of ten thousand would wait for the disk ten thousand times.

    Raises:
      FileError: the folder cannot be created, or holds files that are not frames.
    """

    def __init__(self, target: Path) -> None:
        super().__init__(target, Path(os.path.realpath(target)), self._check, is_folder=True)

    def _check(self) -> None:
        with left_behind(self._target.parent, self._target) as leftovers:
            for path in leftovers:
                restore_folder(path, self._target)
                remove(path)
        if self._target.exists():
            _check_only_frames(self.shown, self._target)

    def publish(self) -> list[Path]:
        try:
            replace_folder(self._temporary.path, self._target)
            return sorted(Path(self.shown).iterdir(), key=frame_number)
        except OSError as error:
            hint = "its frames are in a hidden folder beside it; the next run with this name restores them"
            raise unwritable(self.shown, error, hint if self.is_between() else "") from None

    def take_back(self) -> None:
        take_back_folder(self._temporary.path, self._target)

    def is_between(self) -> bool:
        return (self._temporary.path / OLD).exists() and not self._target.exists()


class StagedFramePattern(_Staged):
    """Frames named by a pattern such as `frame_%04d.png`. Other files with matching names are left alone.

    If a process was killed while it renamed its frames, the rest are renamed first.

    Attributes:
      others: names of matching files with numbers after the last frame, known once the frames are published.

    Raises:
      FileError: the folder cannot be created or written.
    """

    def __init__(self, pattern: Path) -> None:
        self.others: list[str] = []
        target = Path(os.path.realpath(pattern.parent)) / pattern.name
        super().__init__(pattern, target, self._check, is_folder=True)

    def _check(self) -> None:
        folder = self._target.parent
        self._before, self._width, self._after = re.split(r"%(\d*)d", self._target.name, maxsplit=1)
        with one_at_a_time(folder), left_behind(folder, self._target) as leftovers:
            for path in leftovers:
                if (path / MOVING).exists():
                    finish_frames(path, self._place)
                remove(path)

    def publish(self) -> list[Path]:
        try:
            self._frames = sorted((self._temporary.path / NEW).iterdir(), key=frame_number)
            move_frames(self._temporary.path, self._place)
            names = [path.name for path in self._target.parent.iterdir()]
        except OSError as error:
            hint = "some frames are new, some are old; the next run with this name makes all of them new"
            raise unwritable(self.shown, error, hint if self.is_between() else "") from None

        places = [self._place(frame_number(frame)) for frame in self._frames]
        numbered = re.compile(f"{re.escape(self._before)}(\\d+){re.escape(self._after)}")
        matches = [match for name in names if (match := numbered.fullmatch(name))]
        later = sorted(int(match[1]) for match in matches if match[0] == self._place(int(match[1])).name)
        self.others = [self._place(number).name for number in later if number >= len(places)]
        return [Path(self.shown).parent / place.name for place in places]

    @property
    def remark(self) -> str:
        if not self.others:
            return ""
        more = f" and {len(self.others) - 1} more" if len(self.others) > 1 else ""
        return f"{clean(self.others[0])}{more} already existed and follow the last frame: not part of this video"

    def take_back(self) -> None:
        take_back_frames(self._temporary.path, [frame.name for frame in self._frames], self._place)

    def is_between(self) -> bool:
        return (self._temporary.path / MOVING).exists()

    def _place(self, number: int) -> Path:
        return self._target.parent / f"{self._before}{number:{self._width or 1}d}{self._after}"


class StandardOutput(Destination):
    """The standard output of the process, which cannot be undone.

    Args:
      terminal: whether it may be a terminal, as for text.
    """

    path = "pipe:1"
    shown = Path("-")

    def __init__(self, *, terminal: bool = False) -> None:
        if sys.stdout.isatty() and not terminal:
            raise FileError("-", "standard output is a terminal", "send it to a file or a pipe")
        sys.stdout.flush()
        self._descriptor = sys.stdout.fileno()
        self.stdout = self._descriptor
        if system.is_read_only(self._descriptor):
            raise FileError("-", "standard output is closed", "send it to a file or a pipe")

    def reader_is_gone(self) -> bool:
        """Returns whether the other end of the pipe is closed."""
        return system.reader_is_gone(self._descriptor)

    def take_back(self) -> None:
        raise OSError(errno.ESPIPE, os.strerror(errno.ESPIPE))


def remove_left_behind(folder: Path) -> None:
    """Removes files and folders that ended processes have left in a folder.

    Raises:
      OSError: the folder cannot be read.
    """
    with left_behind(folder) as leftovers:
        for path in leftovers:
            if not (path / OLD).exists():  # which the next output to that target restores
                remove(path)


def no_space(text: str) -> bool:
    """Returns whether the log of an encoder reports a full disk."""
    return os.strerror(errno.ENOSPC) in text or os.strerror(errno.EDQUOT) in text


def _parents(shown: Path, target: Path) -> ParentFolders:
    """Returns the folders of an output, after checking its name and the confinement."""
    if len(os.fsencode(shown.name)) > NAME_MAX:
        raise FileError(shown, f"cannot be written: its name is longer than {NAME_MAX} bytes")
    if not is_writable(target):
        raise FileError(shown, f"is outside the folders of the outputs, and {option('untrusted')} writes nowhere else")
    return ParentFolders(shown, target.parent)


def _temporary(target: Path, shown: Path, parents: ParentFolders, *, folder: bool) -> TemporaryOutput:
    """Creates the file or folder in which an output is written; frames are in the folder `new` of a folder."""
    temporary = None
    for attempt in range(1, TRIES + 1):
        try:
            remove_left_behind(target.parent)
            note_folder(target.parent)
            temporary = TemporaryOutput(target, folder=folder)
            if folder:
                (temporary.path / NEW).mkdir()
            return temporary
        except OSError as error:
            if temporary:
                temporary.remove()
            if not isinstance(error, FileNotFoundError) or attempt == TRIES:
                raise unwritable(shown, error) from None
        parents.make()  # another process has removed the folder that it had made
    raise AssertionError


def _check_only_frames(shown: Path | str, folder: Path) -> None:
    if not folder.is_dir():
        raise FileError(shown, "exists and is not a folder")
    others = [path.name for path in folder.iterdir() if not re.fullmatch(r"\d{6,}\.png", path.name)]
    if others:
        raise FileError(
            shown,
            f"the folder holds other files ({sorted(others)[0]!r}), and would be replaced as a whole",
            "specify a new folder, or a pattern such as frame_%04d.png",
        )


def unwritable(shown: Path | str, error: OSError, hint: str = "") -> FileError:
    """Returns the error that states why the operating system refused an output."""
    return FileError(shown, f"cannot be written: {error.strerror or error}", hint)
