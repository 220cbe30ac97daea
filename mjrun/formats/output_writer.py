"""Outputs that appear whole, or not: their destinations and their writers.

After any failure, kill or full disk the target is the old output or the new one, never a mixture. An output is written
next to its final place under a temporary name, and renamed when it is complete. Older files are kept until all files
of one `PublishingTransaction` are in place.
"""

import contextlib
import errno
import os
import re
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeVar

from mjrun.confinement.confinement import is_writable
from mjrun.errors import ClosedPipeError, FileError, MjrunError, PartlyDoneError, clean, file_errors, option
from mjrun.formats.input_file import is_file
from mjrun.formats.temporary_output import (
    MOVING,
    NEW,
    OLD,
    TRIES,
    ParentFolders,
    TemporaryOutput,
    finish_frames,
    frame_number,
    left_behind,
    move_frames,
    one_at_a_time,
    remove,
    replace_file,
    replace_folder,
    restore_folder,
    take_back_folder,
    take_back_frames,
)
from mjrun.platform import system
from mjrun.shared_status import completing, note_folder, uninterrupted

FRAME_NAME = "%06d.png"
NUMBER = r"%(\d*)d"  # of a frame, in a pattern


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


def frame_name(pattern: str, number: int) -> str:
    """Returns the file name of a frame: the first `%d` or `%04d` of `pattern`, if any, becomes its number."""
    return re.sub(NUMBER, lambda match: f"{number:{match[1] or 1}d}", pattern, count=1)


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
        self._before, _, self._after = re.split(NUMBER, self._target.name, maxsplit=1)
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
        numbered = re.compile(f"{re.escape(self._before)}( *\\d+){re.escape(self._after)}")  # `%4d` pads with spaces
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
        return self._target.parent / frame_name(self._target.name, number)


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
    """Returns the folders of an output, after checking the confinement."""
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


T = TypeVar("T", bound=Any)


class OutputWriter:
    """Base of all writers: a context manager that leaves nothing behind unless the output was published.

    Creating the destination checks that the output can be written.

    Attributes:
      resources: open files and processes, closed with the writer, last opened first; then the destination cleans up.
    """

    def __init__(self, destination: Destination) -> None:
        self.destination = destination
        self.resources = contextlib.ExitStack()
        self.resources.callback(destination.cleanup)

    def finish(self) -> None:
        """Syncs the output, which then only has to be moved; called once. Writers first write its end and verify it.

        All outputs of a pass are finished before any of them is published.

        Raises:
          FileError: the output cannot be written.
          EncoderError: the encoder failed, or frames are missing.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        with file_errors(self.destination.shown, "written"):
            self.destination.sync()

    def publish(self) -> list[Path]:
        """Finishes the output, moves it to its final place, and returns its files.

        Raises:
          MjrunError: as `finish`, or the output cannot be moved.
        """
        return publish_together([self])

    @property
    def together(self) -> Sequence["OutputWriter"]:
        """The writers of all files that are finished and published with this one."""
        return [self]

    def close(self) -> None:
        """Closes open resources, and removes output that was not published."""
        self.resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextlib.contextmanager
    def opening(self) -> Iterator[None]:
        """Wraps the rest of a constructor: a failure closes and removes everything."""
        try:
            with self.writing():
                yield
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Turns errors of the operating system into those of mjrun."""
        try:
            with file_errors(self.destination.shown, "written", unless=BrokenPipeError):
                yield
        except BrokenPipeError:
            raise ClosedPipeError from None

    def open_file(self) -> BinaryIO:
        """Opens the file to write to, which is closed with the writer.

        Raises:
          FileError: it cannot be opened.
        """
        stdout = self.destination.stdout
        with self.writing():
            file = open(self.destination.path if stdout is None else stdout, "wb", closefd=stdout is None)  # noqa: SIM115
        self.resources.enter_context(closing_quietly(file))
        return file

    def write_file(self, content: bytes) -> None:
        """Writes the whole output at once."""
        with self.writing(), self.open_file() as file:
            file.write(content)


def require_own(path: Path, mark: str, kind: str) -> None:
    """Refuses to replace a file of another kind, which was named by mistake.

    Args:
      mark: text that every file of this kind contains.
      kind: the kind in messages: "a baseline of mjrun check".

    Raises:
      FileError: the file has content, and not the mark.
    """
    with contextlib.suppress(OSError):  # which writing it reports
        if is_file(path) and (content := path.read_bytes()) and mark.encode() not in content:
            raise FileError(path, f"is not {kind}, and is not replaced", "choose another name, or remove the file")


def publish_together(writers: Sequence[OutputWriter]) -> list[Path]:
    """Finishes outputs, moves them to their places, and returns their files.

    Raises:
      MjrunError: as `OutputWriter.finish` and `PublishingTransaction`.
    """
    for writer in writers:
        writer.finish()
    with publishing(writers), PublishingTransaction() as together:
        return [file for writer in writers for file in together.move(writer)]


@contextlib.contextmanager
def publishing(writers: Sequence[OutputWriter]) -> Iterator[None]:
    """Moves finished outputs to their places in the `with` block.

    Signals wait for its end, and other processes do not publish in the folders of these outputs meanwhile.
    """
    folders = {part.destination.folder for writer in writers for part in writer.together}
    with contextlib.ExitStack() as locks:
        for folder in sorted(filter(None, folders)):  # in one order, for all processes
            locks.enter_context(one_at_a_time(folder))
        with uninterrupted(), completing():
            yield


class PublishingTransaction:
    """A context manager in which outputs move to their places, all of them or none; used in `publishing`.

    Raises:
      PartlyDoneError: the `with` block fails, and an output that was moved cannot be replaced by the older one.
    """

    def __init__(self) -> None:
        self._moved: list[Destination] = []
        self._last = Path()

    def __enter__(self) -> Self:
        return self

    def move(self, writer: OutputWriter) -> list[Path]:
        """Moves a finished output to its place, and returns its files.

        Raises:
          MjrunError: the output cannot be moved.
        """
        files: list[Path] = []
        for part in writer.together:
            self._last = part.destination.shown
            files += part.destination.publish()
            self._moved.append(part.destination)
        return files

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if error is None:
            for destination in self._moved:
                destination.cleanup()  # removes the older output
            return
        remaining = [str(each.shown) for each in reversed(self._moved) if not _is_taken_back(each)]
        if remaining and isinstance(error, MjrunError):
            raise PartlyDoneError(remaining, [(str(self._last), error)]) from None


def _is_taken_back(destination: Destination) -> bool:
    try:
        destination.take_back()
    except OSError:
        return False
    return True


@contextlib.contextmanager
def closing_quietly(file: T) -> Iterator[T]:
    """Closes a file at the end, even if the rest of its buffer cannot be written."""
    try:
        yield file
    finally:
        with contextlib.suppress(OSError, ValueError):
            file.close()
