"""Destinations of outputs: files, folders and patterns of frames, standard output.

An output is written next to its final place under a temporary name, and renamed when it is complete.
"""

import errno
import os
import re
import stat
import sys
from pathlib import Path

from mjrun.confinement.confinement import is_writable
from mjrun.errors import FileError, file_errors, option
from mjrun.formats import crash_safe_replacement
from mjrun.formats.parent_folders import TRIES, ParentFolders
from mjrun.formats.temporary_output import TemporaryOutput, left_behind, one_at_a_time, remove
from mjrun.platform import system
from mjrun.shared_status import note_folder

FRAME_NAME = "%06d.png"
NAME_MAX = 255  # bytes in the name of a file


class Destination:
    """A place where an output is written, and from which it moves to its final place.

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

    def sync(self) -> None:
        """Syncs the output to the disk."""

    def publish(self) -> list[Path]:
        """Moves the output to its final place and returns its files. The older output is kept until `discard`."""
        return []

    def take_back(self) -> None:
        """Undoes `publish`.

        Raises:
          OSError: it cannot be undone.
        """
        raise NotImplementedError

    def discard(self) -> None:
        """Removes everything that is not published."""


class _Staged(Destination):
    """An output that is written beside its place: a file, or a folder of frames."""

    def __init__(self, shown: Path, target: Path, *, is_folder: bool) -> None:
        self.shown, self._shown, self.folder = shown, shown, target.parent
        self._target, self._parents = target, _parents(shown, target)
        with self._parents.opening():
            with file_errors(shown, "written"):
                self.prepare()
            self._temporary = _temporary(target, shown, self._parents, folder=is_folder)
        self.path = str(self._temporary.path)
        if is_folder:
            self.path = f"{self.path.replace('%', '%%')}/{crash_safe_replacement.NEW}/{FRAME_NAME}"

    def prepare(self) -> None:
        """Checks that the output can be placed there, and finishes what a killed process left unfinished.

        Raises:
          FileError: the output cannot be placed there; may be an OSError too.
        """
        raise NotImplementedError

    def is_between(self) -> bool:
        """Returns whether only a part of it is in its place, so that the next run with this name has to finish."""
        return False

    def discard(self) -> None:
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
        super().__init__(target, Path(os.path.realpath(target)), is_folder=False)  # a link stays a link
        self._older: Path | None = None  # the file that was in its place

    def prepare(self) -> None:
        try:
            mode = self._target.stat().st_mode
        except FileNotFoundError:
            return
        if not stat.S_ISREG(mode):
            raise FileError(self._shown, "exists and is not a regular file")
        if not os.access(self._target, os.W_OK):
            raise FileError(self._shown, "exists and is read-only")

    def sync(self) -> None:
        with self._temporary.path.open("r+b") as file:  # Windows syncs only files that are open for writing
            os.fsync(file.fileno())

    def publish(self) -> list[Path]:
        self._is_new = not os.path.lexists(self._target)
        with file_errors(self._shown, "written"):
            self._older = crash_safe_replacement.replace_file(self._temporary.path, self._target)
        return [self._shown]

    def take_back(self) -> None:
        if self._older:
            self._older.replace(self._target)
        elif self._is_new:
            self._target.unlink()
        else:
            raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    def discard(self) -> None:
        if self._older:
            remove(self._older)
        super().discard()


class StagedFolder(_Staged):
    """A folder of numbered frames, which replaces one that holds nothing else.

    If a killed process has left the older folder under another name, it is first restored. Frames are not synced: a
    video of ten thousand would wait for the disk ten thousand times.

    Raises:
      FileError: the folder cannot be created, or holds files that are not frames.
    """

    def __init__(self, target: Path) -> None:
        super().__init__(target, Path(os.path.realpath(target)), is_folder=True)

    def prepare(self) -> None:
        with left_behind(self._target.parent, self._target) as leftovers:
            for path in leftovers:
                crash_safe_replacement.restore_folder(path, self._target)
                remove(path)
        if self._target.exists():
            _check_only_frames(self._shown, self._target)

    def publish(self) -> list[Path]:
        try:
            crash_safe_replacement.replace_folder(self._temporary.path, self._target)
            return sorted(self._shown.iterdir(), key=crash_safe_replacement.frame_number)
        except OSError as error:
            hint = "its frames are in a hidden folder beside it; the next run with this name restores them"
            raise unwritable(self._shown, error, hint if self.is_between() else "") from None

    def take_back(self) -> None:
        crash_safe_replacement.take_back_folder(self._temporary.path, self._target)

    def is_between(self) -> bool:
        return (self._temporary.path / crash_safe_replacement.OLD).exists() and not self._target.exists()


class StagedFrames(_Staged):
    """Frames named by a pattern such as `frame_%04d.png`. Other files with matching names are left alone.

    If a process was killed while it renamed its frames, the rest are renamed first.

    Attributes:
      others: names of matching files with numbers after the last frame, known once the frames are published.

    Raises:
      FileError: the folder cannot be created or written.
    """

    def __init__(self, pattern: Path) -> None:
        self.others: list[str] = []
        super().__init__(pattern, Path(os.path.realpath(pattern.parent)) / pattern.name, is_folder=True)

    def prepare(self) -> None:
        folder = self._target.parent
        self._before, self._width, self._after = re.split(r"%(\d*)d", self._shown.name, maxsplit=1)
        with one_at_a_time(folder), left_behind(folder, self._shown) as leftovers:
            for path in leftovers:
                if (path / crash_safe_replacement.MOVING).exists():
                    crash_safe_replacement.finish_frames(path, self._place)
                remove(path)

    def publish(self) -> list[Path]:
        try:
            self._frames = sorted(
                (self._temporary.path / crash_safe_replacement.NEW).iterdir(), key=crash_safe_replacement.frame_number
            )
            crash_safe_replacement.move_frames(self._temporary.path, self._place)
            names = [path.name for path in self._target.parent.iterdir()]
        except OSError as error:
            hint = "some frames are new, some are old; the next run with this name makes all of them new"
            raise unwritable(self._shown, error, hint if self.is_between() else "") from None

        places = [self._place(crash_safe_replacement.frame_number(frame)) for frame in self._frames]
        numbered = re.compile(f"{re.escape(self._before)}(\\d+){re.escape(self._after)}")
        matches = [match for name in names if (match := numbered.fullmatch(name))]
        later = sorted(int(match[1]) for match in matches if match[0] == self._place(int(match[1])).name)
        self.others = [self._place(number).name for number in later if number >= len(places)]
        return [self._shown.parent / place.name for place in places]

    def take_back(self) -> None:
        crash_safe_replacement.take_back_frames(
            self._temporary.path, [frame.name for frame in self._frames], self._place
        )

    def is_between(self) -> bool:
        return (self._temporary.path / crash_safe_replacement.MOVING).exists()

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

    def is_full(self) -> bool:
        """Returns whether the other end of the pipe must be read before more can be written."""
        return system.is_full(self._descriptor)

    def take_back(self) -> None:
        raise OSError(errno.ESPIPE, os.strerror(errno.ESPIPE))


def remove_left_behind(folder: Path) -> None:
    """Removes files and folders that ended processes have left in a folder.

    Raises:
      OSError: the folder cannot be read.
    """
    with left_behind(folder) as leftovers:
        for path in leftovers:
            if not (path / crash_safe_replacement.OLD).exists():  # which the next output to that target restores
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
                (temporary.path / crash_safe_replacement.NEW).mkdir()
            return temporary
        except OSError as error:
            if temporary:
                temporary.remove()
            if not isinstance(error, FileNotFoundError) or attempt == TRIES:
                raise unwritable(shown, error) from None
        parents.make()  # another process has removed the folder that it had made
    raise AssertionError


def _check_only_frames(shown: Path, folder: Path) -> None:
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
