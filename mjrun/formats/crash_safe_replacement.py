"""Replacement of files and folders, safe against failures and kills.

Frames wait in the folder `new` of a temporary folder. A folder of frames is exchanged for the older one in one step, or
in two that can be undone. Frames with individual names need a rename each: the folder is called `moving` meanwhile, and
the next process that sees it finishes. Older files are kept until all outputs of the pass are published.
"""

import contextlib
import ctypes
import errno
import os
import stat
from collections.abc import Callable, Sequence
from pathlib import Path

from mjrun.formats.temporary_output import remove, unused_name
from mjrun.platform import system

NEW, OLD, MOVING = "new", "old", "moving"
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # constants of Linux: paths relative to the working folder; swap both names

Place = Callable[[int], Path]  # returns the path of a frame, given its number


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


def move_frames(temporary: Path, place: Place) -> None:
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


def finish_frames(temporary: Path, place: Place) -> None:
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


def take_back_frames(temporary: Path, names: Sequence[str], place: Place) -> None:
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
