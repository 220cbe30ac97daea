"""The functions of `system` on Windows, with nothing but what every Python has.

A process works without a crash monitor and without limits, and nothing confines it. A file that is open cannot be
renamed there, so outputs are written without locks: a killed process leaves its unfinished outputs behind.
"""

import ctypes
import errno
import os
import shutil
import signal
import subprocess
import threading
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn, TypedDict

CAN_FORK = False
CAN_FORK_LATE = False
PASSES_DESCRIPTORS = False
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name)
)  # the last is Ctrl-Break, and the closing of a console
PATH_MAX = 32_766  # characters of a path, if the system is set up for long ones; otherwise it refuses them itself
CP_UTF8 = 65001
READ_FLAGS = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOINHERIT", 0)


class PopenArguments(TypedDict):
    """Arguments of `Popen`."""

    creationflags: int


def release_signals() -> None:
    """Does nothing."""


def send_promise(pid: int) -> NoReturn:
    """Refuses: no process watches this one."""
    raise _unsupported("no process watches another one")


@contextmanager
def end_after(seconds: int) -> Generator[None]:
    """Ends this process if the block takes `seconds`, unless native code keeps the interpreter's lock for good."""
    timer = threading.Timer(seconds, os._exit, (1,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def set_limits(
    *, memory: float | None, cpu: float | None, file_size: float | None, core: float | None, hard: bool
) -> None:
    """Does nothing: a process cannot limit itself."""


def most_open_files() -> int:
    """Returns how many files this process may have open."""
    return 8192


def process_options(descriptors: Sequence[int]) -> PopenArguments:
    """Returns the arguments of `Popen` for a process that Ctrl-C in this console does not reach.

    Raises:
      OSError: it is to get `descriptors`.
    """
    if descriptors:
        raise _unsupported("a process inherits no descriptors")
    return {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}


def duplicate(descriptor: int) -> NoReturn:
    """Refuses: a copy could not be inherited."""
    raise _unsupported("a process inherits no descriptors")


def kill_group(pid: int) -> None:
    """Does nothing: processes have no sessions. Workers and encoders end by themselves when their parent has ended."""


def make_nonblocking(pipe: int) -> None:
    """Does nothing: writing to a full pipe waits."""


def wait_until_writable(pipe: int, seconds: float) -> bool:
    """Returns True: writing waits by itself."""
    return True


def wait_for_hangup(connection: int) -> None:
    """Waits until the other end of a pipe is closed."""
    while os.read(connection, 2**12):
        pass


def reader_is_gone(descriptor: int) -> bool:
    """Returns False: only writing shows it."""
    return False


def is_full(descriptor: int) -> bool:
    """Returns False: only writing shows it."""
    return False


def is_read_only(descriptor: int) -> bool:
    """Returns False: only writing shows it."""
    return False


def locked(path: Path, *, wait: bool = True) -> NoReturn:
    """Refuses, as a file system without locks does: an open file could not be renamed."""
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


def is_open_elsewhere(path: Path) -> bool:
    """Returns False: a file that is open cannot be replaced, which fails later."""
    return False


def hard_link(existing: Path, new: Path) -> None:
    """Gives a file a second name.

    Raises:
      OSError: it is a symbolic link, or the file system has no hard links.
    """
    link = getattr(os, "link", None)
    if link is None or existing.is_symlink():
        raise _unsupported("a file has no second name")
    link(existing, new)


def remove_folder(path: Path) -> None:
    """Removes a folder with everything in it, as far as possible."""
    shutil.rmtree(path, ignore_errors=True)


def effective_user() -> int:
    """Returns 0: no folder keeps users from replacing each other's files."""
    return 0


def show_utf8() -> None:
    """Lets the console show UTF-8, which it would decode by an older code page."""
    libraries = getattr(ctypes, "windll", None)
    if libraries:
        libraries.kernel32.SetConsoleOutputCP(CP_UTF8)


def cache_home() -> Path:
    """Returns the folder below which programs store what they can make again."""
    return Path(os.environ.get("LOCALAPPDATA") or os.path.expanduser("~/.cache"))  # noqa: PTH111 – never fails


def machine_name() -> str:
    """Returns the name of this machine in its network."""
    import platform

    return platform.node()


def process_identity() -> str:
    """Returns nothing: no process of this system is recognized."""
    return ""


def has_ended(identity: str) -> bool:
    """Returns False: the end of another process is not known."""
    return False


def _unsupported(reason: str) -> OSError:
    return OSError(errno.EOPNOTSUPP, f"{reason} on this system")
