"""Frames that take the place of older ones, whatever fails and whenever the process is killed.

They wait in the folder `new` of a temporary folder. A folder of frames is exchanged for the older one in one step, or
in two that can be undone. Frames with names of their own need a rename each: the folder is `moving` meanwhile, and
whoever finds it so finishes. What was there before is kept in `old` until all is done.
"""

import contextlib
import ctypes
import errno
import os
from collections.abc import Callable
from pathlib import Path

NEW, OLD, MOVING = "new", "old", "moving"
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of Linux: paths relative to the working folder; swap both names

Place = Callable[[int], Path]  # of a frame, by its number


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


def exchange(one: Path, other: Path) -> bool:
    """Exchanges two names in one step, as only Linux and some of its file systems can; False elsewhere."""
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except AttributeError:
        return False
    return renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0


def move_frames(temporary: Path, place: Place) -> list[Path]:
    """Moves every frame to its place, and returns the places.

    Raises:
      OSError: it cannot be done. All is as it was, or the folder `moving` still exists, if that fails as well.
    """
    new, moving = temporary / NEW, temporary / MOVING
    frames = [moving / frame.name for frame in new.iterdir()]
    (temporary / OLD).mkdir()
    new.rename(moving)
    try:
        return finish_frames(temporary, place)
    except BaseException:
        with contextlib.suppress(OSError):
            _take_back(temporary, frames, place)
        raise


def finish_frames(temporary: Path, place: Place) -> list[Path]:
    """Moves what is still to be moved, and returns the places of all of that.

    Raises:
      OSError: it cannot be done.
    """
    moving, old = temporary / MOVING, temporary / OLD
    places: list[Path] = []
    for frame in sorted(moving.iterdir(), key=frame_number):
        target, kept = place(frame_number(frame)), old / frame.name
        if os.path.lexists(target) and not os.path.lexists(kept):
            _keep(target, kept)
        frame.rename(target)
        places.append(target)
    moving.rmdir()
    return places


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


def _take_back(temporary: Path, frames: list[Path], place: Place) -> None:
    """Undoes what `finish_frames` has done. At every step it could still finish."""
    for frame in frames:
        target, kept = place(frame_number(frame)), temporary / OLD / frame.name
        if not frame.exists():
            target.rename(frame)
        if os.path.lexists(kept):
            kept.rename(target)
    (temporary / MOVING).rename(temporary / NEW)
