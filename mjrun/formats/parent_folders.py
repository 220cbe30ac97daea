"""Folders of outputs: missing ones are created, and removed again if nothing is published in them.

All outputs of a process share the folders that it has created. The last output that is cleaned up removes the empty
ones; if the process is killed, the process that monitors it removes them.
"""

import os
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from mjrun.errors import FileError, clean
from mjrun.interruption import uninterrupted
from mjrun.shared_status import note_made_folder

TRIES = 100  # attempts while other processes remove folders that they had created

_lock = threading.RLock()
_users: dict[Path, int] = {}  # number of outputs that use each folder that this process has created


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
                if not _exists(self._folder):
                    require_no_dangling_link(self._shown, self._folder)
                    self._make_missing()
                if _exists(self._folder):  # another process may have removed it again
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
                for folder in reversed([each for each in folders if not _exists(each)]):
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
        if fault and _exists(self._folder):  # another process may just have removed it
            raise FileError(self._shown, fault)


def require_no_dangling_link(path: Path, folder: Path) -> None:
    """Raises FileError if `path`, or a folder above it, is a link, and `folder`, where it leads, is missing."""
    for link in (path, *path.parents):
        if os.path.islink(link) and not _exists(link):  # noqa: PTH114 – also of names that are too long
            raise FileError(path, f"the link {clean(str(link))} leads to a missing folder, {clean(str(folder))}")


def _make(folder: Path) -> None:
    with suppress(FileExistsError):  # another process was faster
        folder.mkdir()
        note_made_folder(folder)
        _users.setdefault(folder, 0)


def _exists(path: Path) -> bool:
    return os.path.exists(path)  # noqa: PTH110 – also of names that are too long
