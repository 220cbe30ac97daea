"""Files and folders that take the place of older ones, whatever fails and whenever the process is killed.

Frames wait in the folder `new` of a temporary folder. A folder of frames is exchanged for the older one in one step, or
in two that can be undone. Frames with names of their own need a rename each: the folder is `moving` meanwhile, and
whoever finds it so finishes. What was there before is kept, until all that belongs together is done.
"""

import contextlib
import ctypes
import errno
import os
import stat
from collections.abc import Callable, Sequence
from pathlib import Path

from mjrun.formats.temporary_output import remove, unused_name

NEW, OLD, MOVING = "new", "old", "moving"
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of Linux: paths relative to the working folder; swap both names

Place = Callable[[int], Path]  # of a frame, by its number


def replace_file(new: Path, target: Path) -> Path | None:
    """Puts a file in the place of `target`, and returns where the older file is, if there is one and it can be kept.

    Raises:
      OSError: it cannot be done, and `target` is as it was.
    """
    if not os.path.lexists(target):
        new.rename(target)
        return None
    if exchange(new, target):
        return new
    _require_replaceable(target)
    older = unused_name(target)
    try:
        os.link(target, older)
    except OSError:
        new.rename(target)
        return None
    try:
        new.rename(target)
    except BaseException:
        remove(older)
        raise
    return older


def _require_replaceable(target: Path) -> None:
    """Checks that a file may be replaced: in a sticky folder, such as /tmp, that of another user may not.

    A second name of it, by which it is kept, could not be removed either.

    Raises:
      PermissionError: it may not.
    """
    folder, user = target.parent.stat(), os.geteuid()
    is_sticky = bool(folder.st_mode & stat.S_ISVTX)
    if is_sticky and user not in (0, folder.st_uid, target.lstat().st_uid):
        raise PermissionError(errno.EPERM, "another user's file, in a folder where each replaces only their own")


def replace_folder(temporary: Path, target: Path) -> None:
    """Puts the frames in the place of the folder `target`, whose own are in the temporary folder then.

    Raises:
      OSError: it cannot be done, and `target` is as it was.
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
    """Puts the older frames back if `target` is missing: the process was stopped between two renames."""
    if (temporary / OLD).exists() and not target.exists():
        (temporary / OLD).rename(target)


def take_back_folder(temporary: Path, target: Path) -> None:
    """Undoes `replace_folder`.

    Raises:
      OSError: it cannot be done.
    """
    new = temporary / NEW
    if new.exists():  # it holds the older frames
        replace_folder(temporary, target)
    else:
        target.rename(new)
        restore_folder(temporary, target)


def exchange(one: Path, other: Path) -> bool:
    """Exchanges two names in one step, as only Linux and some of its file systems can; False elsewhere."""
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except AttributeError:
        return False
    return renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0


def move_frames(temporary: Path, place: Place) -> None:
    """Moves every frame to its place.

    Raises:
      OSError: it cannot be done. All is as it was, or the folder `moving` still exists, if that fails as well.
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
    """Moves what is still to be moved.

    Raises:
      OSError: it cannot be done.
    """
    moving, old = temporary / MOVING, temporary / OLD
    for frame in sorted(moving.iterdir(), key=frame_number):
        target, older = place(frame_number(frame)), old / frame.name
        if os.path.lexists(target) and not os.path.lexists(older):
            _keep(target, older)
        frame.rename(target)
    moving.rmdir()


def take_back_frames(temporary: Path, names: Sequence[str], place: Place) -> None:
    """Undoes `move_frames` of frames with these `names`. At every step, it could still be finished instead.

    Raises:
      OSError: it cannot be done.
    """
    moving = temporary / MOVING
    moving.mkdir(exist_ok=True)
    for name in names:
        frame, older = moving / name, temporary / OLD / name
        target = place(frame_number(frame))
        if not frame.exists():
            target.rename(frame)
        if os.path.lexists(older):
            older.rename(target)
    moving.rename(temporary / NEW)


def frame_number(path: Path) -> int:
    """The number of a frame that is named by it alone."""
    return int(path.stem)


def _keep(target: Path, kept: Path) -> None:
    """Gives a file that is about to be replaced a second name, or where it can have one only, another."""
    if target.is_dir() and not target.is_symlink():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    try:
        os.link(target, kept, follow_symlinks=False)
    except OSError:
        target.rename(kept)
