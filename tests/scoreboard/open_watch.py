"""Sees which files of a folder anybody opens, by inotify: an oracle that no library and no path of mjrun can evade."""

import ctypes
import os
import struct
from contextlib import suppress
from pathlib import Path
from types import TracebackType

OPEN, ACCESS, MODIFY, IS_FOLDER = 0x20, 0x1, 0x2, 0x40000000
EVENT = struct.Struct("iIII")  # watch, what happened, cookie, length of the name that follows


class OpenWatch:
    """Tells which files in folders, and below, have been opened. Folders themselves may be listed."""

    def __init__(self, *folders: Path) -> None:
        self._library = ctypes.CDLL(None, use_errno=True)
        self._notes = self._library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if self._notes < 0:
            raise OSError(ctypes.get_errno(), "inotify_init1")
        self._folders: dict[int, Path] = {}
        for folder in folders:
            for each in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
                watch = self._library.inotify_add_watch(self._notes, os.fsencode(each), OPEN | ACCESS | MODIFY)
                if watch < 0:
                    raise OSError(ctypes.get_errno(), f"inotify_add_watch {each}")
                self._folders[watch] = each

    def __enter__(self) -> "OpenWatch":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        os.close(self._notes)

    def opened(self) -> list[str]:
        """The files that were opened since this was asked last."""
        content = b""
        with suppress(BlockingIOError):
            while chunk := os.read(self._notes, 2**20):
                content += chunk
        names = set()
        while content:
            watch, what, _, length = EVENT.unpack_from(content)
            name = content[EVENT.size : EVENT.size + length].rstrip(b"\0").decode()
            content = content[EVENT.size + length :]
            if not what & IS_FOLDER:
                names.add(str(self._folders[watch] / name))
        return sorted(names)
