"""The bootstrap of processes that run without POSIX, as on Windows: a `sitecustomize` in PYTHONPATH calls `hide`.

It hides the modules and functions that only POSIX has. `os.uname` and `signal.Signals` stay: numpy and the enumerations
of Python need them on Linux. Files follow the rules of Windows: names have no reserved characters, an open file is
neither renamed nor removed, a rename replaces nothing, and only files that are open for writing are synced.
"""

import ctypes
import errno
import fcntl
import functools
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog")
FUNCTIONS: dict[ModuleType, str] = {
    os: "fork forkpty killpg setsid setpgid getpgid link geteuid getuid register_at_fork sysconf sched_yield "
    "memfd_create set_blocking sched_getaffinity O_NONBLOCK O_NOFOLLOW O_CLOEXEC O_ACCMODE O_ASYNC O_PATH",
    signal: "SIGHUP SIGCHLD SIGALRM SIGUSR1 SIGUSR2 SIGXCPU SIGXFSZ SIGBUS SIGKILL SIGPIPE pthread_sigmask setitimer "
    "sigwait alarm ITIMER_REAL",
    select: "poll epoll",
    socket: "AF_UNIX",
}
OPTIONS = ("pass_fds", "start_new_session", "preexec_fn", "process_group", "user", "group")  # of Popen


class Popen(subprocess.Popen[Any]):
    """A process that is started with what Windows supports."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        refused = [name for name in OPTIONS if options.get(name)]
        assert not refused, f"Popen supports no {refused} on Windows"
        super().__init__(*arguments, **options)

    def kill(self) -> None:
        self.send_signal(9)


def refuse_reserved_names(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuses new files and folders with names that Windows does not allow."""
    makes = event == "os.mkdir" or (event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    if makes and isinstance(arguments[0], str) and set('<>:"|?*\\') & set(arguments[0]):
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), arguments[0])


def refuse_open_files(function: Callable[..., None]) -> Callable[..., None]:
    """Makes a function that renames or removes files refuse those that this process has open."""

    @functools.wraps(function)
    def wrapped(*paths: Any, **options: Any) -> None:
        places = [Path(os.path.realpath(path)) for path in paths]
        for descriptor in os.listdir("/proc/self/fd"):  # noqa: PTH208
            opened = Path(os.path.realpath(f"/proc/self/fd/{descriptor}"))
            if any(opened.is_relative_to(place) for place in places):
                raise PermissionError(errno.EACCES, "it is open in this process", str(opened))
        if function.__name__ == "rename" and os.path.lexists(paths[1]):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(paths[1]))
        function(*paths, **options)

    return wrapped


def synced(descriptor: int, sync: Callable[[int], None] = os.fsync, control: Any = fcntl.fcntl) -> None:
    """Syncs a file that is open for writing."""
    if not control(descriptor, fcntl.F_GETFL) & (os.O_WRONLY | os.O_RDWR):
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    sync(descriptor)


class Library(ctypes.CDLL):
    """A library; the process is not one."""

    def __init__(self, name: Any, *arguments: Any, **options: Any) -> None:
        if name is None:
            raise TypeError("Windows loads a library by its name")
        super().__init__(name, *arguments, **options)


def hide() -> None:
    """Hides POSIX in this process."""
    sys.addaudithook(refuse_reserved_names)
    for name in ("rename", "replace", "unlink", "remove", "rmdir"):
        setattr(os, name, refuse_open_files(getattr(os, name)))
    os.fsync = synced
    ctypes.CDLL = Library
    modules: dict[str, Any] = sys.modules
    modules.update(dict.fromkeys(MODULES))
    for owner, names in FUNCTIONS.items():
        for name in names.split():
            vars(owner).pop(name, None)
    shutil.__dict__["_use_fd_functions"] = False
    subprocess.__dict__["Popen"] = Popen
