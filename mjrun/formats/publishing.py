"""Outputs that appear whole or not at all.

A target is written beside itself under a temporary name and renamed when it is complete. After any
failure, kill or full disk the target is the old one or the new one, never a mixture.
"""

import contextlib
import errno
import os
import re
import secrets
import select
import shutil
import stat
import sys
from pathlib import Path
from typing import Protocol

from mjrun.errors import FileError

FRAME_NAME = "%06d.png"


class Target(Protocol):
    """Where an encoder writes, and what happens when it is done."""

    path: str  # what the encoder is given as its output
    shown: Path  # what the user is told

    @property
    def stdout(self) -> int | None:
        """The descriptor it writes to, when `path` means standard output."""
        ...

    def publish(self) -> list[Path]:
        """Puts what was written in its place, and says which files that is."""
        ...

    def discard(self) -> None:
        """Removes what was written; does nothing after `publish`."""
        ...


class StagedFile:
    """One file. Creating it proves that the target can be written.

    Raises:
      FileError: the folder is missing, or it or the target cannot be written.
    """

    stdout = None

    def __init__(self, target: Path) -> None:
        self.shown = target
        self._target = Path(os.path.realpath(target))  # a link stays a link
        _check_parent(target, self._target.parent)
        try:
            kind = self._target.stat()
            if not stat.S_ISREG(kind.st_mode):
                raise FileError(target, "exists and is not a regular file")
            if not os.access(self._target, os.W_OK):
                raise FileError(target, "exists and is read-only")
        except FileNotFoundError:
            pass
        self._temporary = _beside(self._target)
        try:
            os.close(os.open(self._temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except OSError as error:
            raise _unwritable(target, error) from None
        self.path = str(self._temporary)

    def publish(self) -> list[Path]:
        try:
            with self._temporary.open("rb") as file:
                os.fsync(file.fileno())
            self._temporary.replace(self._target)
        except OSError as error:
            raise _unwritable(self.shown, error) from None
        return [self.shown]

    def discard(self) -> None:
        with contextlib.suppress(OSError):
            self._temporary.unlink(missing_ok=True)


class StagedFolder:
    """A folder of numbered frames, which replaces one that holds nothing else.

    Raises:
      FileError: the folder cannot be made, or holds files that are not frames.
    """

    stdout = None

    def __init__(self, target: Path) -> None:
        self.shown = target
        self._target = Path(os.path.realpath(target))
        _check_parent(target, self._target.parent)
        if self._target.exists():
            _check_only_frames(target, self._target)
        self._temporary = _beside(self._target)
        try:
            self._temporary.mkdir()
        except OSError as error:
            raise _unwritable(target, error) from None
        self.path = _pattern_in(self._temporary)

    def publish(self) -> list[Path]:
        old = _beside(self._target)
        try:
            if self._target.exists():
                self._target.rename(old)
            self._temporary.rename(self._target)
        except OSError as error:
            raise _unwritable(self.shown, error) from None
        shutil.rmtree(old, ignore_errors=True)
        return sorted(self.shown.iterdir())

    def discard(self) -> None:
        shutil.rmtree(self._temporary, ignore_errors=True)


class StagedFrames:
    """Files named by a pattern such as `frame_%04d.png`. Others of such names are not this film's, and stay.

    Attributes:
      others: those that follow its last frame, once it is published.

    Raises:
      FileError: the folder is missing or cannot be written.
    """

    stdout = None

    def __init__(self, pattern: Path) -> None:
        self.shown, self.others = pattern, list[str]()
        _check_parent(pattern, pattern.parent)
        self._temporary = _beside(Path(os.path.realpath(pattern.parent)) / "frames")
        try:
            self._temporary.mkdir()
        except OSError as error:
            raise _unwritable(pattern, error) from None
        self.path = _pattern_in(self._temporary)

    def publish(self) -> list[Path]:
        before, width, after = re.split(r"%(\d*)d", self.shown.name, maxsplit=1)
        numbered = re.compile(f"{re.escape(before)}(\\d+){re.escape(after)}")
        folder, new = self.shown.parent, list[Path]()
        try:
            for index, frame in enumerate(sorted(self._temporary.iterdir())):
                new.append(folder / f"{before}{index:{width or 1}d}{after}")
                frame.replace(new[-1])
            self._temporary.rmdir()
            there = {path.name: int(found[1]) for path in folder.iterdir() if (found := numbered.fullmatch(path.name))}
        except OSError as error:
            raise _unwritable(self.shown, error) from None
        late = [(n, name) for name, n in there.items() if n >= len(new) and name == f"{before}{n:{width or 1}d}{after}"]
        self.others = [name for _, name in sorted(late)]
        return new

    def discard(self) -> None:
        shutil.rmtree(self._temporary, ignore_errors=True)


class StandardOutput:
    """The process's standard output, which cannot be taken back."""

    path = "pipe:1"
    shown = Path("-")

    def __init__(self, *, terminal: bool = False) -> None:
        """`terminal`: whether it may be one, for what people read there."""
        if sys.stdout.isatty() and not terminal:
            raise FileError("-", "standard output is a terminal", "send it to a file or a pipe: mjrun … -o - | player")
        sys.stdout.flush()
        self.stdout = sys.stdout.fileno()

    def reader_is_gone(self) -> bool:
        """Whether whoever read our standard output has closed it."""
        poll = select.poll()
        poll.register(self.stdout, 0)
        return any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0))

    def publish(self) -> list[Path]:
        return []

    def discard(self) -> None:
        pass


def no_space(text: str) -> bool:
    """Whether an encoder's log says that the disk is full."""
    return os.strerror(errno.ENOSPC) in text or os.strerror(errno.EDQUOT) in text


def _beside(target: Path) -> Path:
    """A hidden, unused name in the folder of `target`."""
    return target.parent / f".{target.name}.{secrets.token_hex(4)}.part"


def _pattern_in(folder: Path) -> str:
    return f"{str(folder).replace('%', '%%')}/{FRAME_NAME}"


def _check_parent(target: Path, folder: Path) -> None:
    if not folder.exists():
        raise FileError(target, f"there is no folder {folder}", f"make it first: mkdir -p {folder}")
    if not folder.is_dir():
        raise FileError(target, f"{folder} is not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise FileError(target, f"the folder {folder} cannot be written to")


def _check_only_frames(shown: Path, folder: Path) -> None:
    if not folder.is_dir():
        raise FileError(shown, "exists and is not a folder")
    foreign = [p.name for p in folder.iterdir() if not re.fullmatch(r"\d{6,}\.png", p.name)]
    if foreign:
        raise FileError(
            shown,
            f"the folder holds other files ({sorted(foreign)[0]!r}), and would be replaced as a whole",
            "give a new folder, or a pattern such as frame_%04d.png",
        )


def _unwritable(shown: Path, error: OSError) -> FileError:
    return FileError(shown, f"cannot be written: {error.strerror or error}")
