"""The bootstrap of processes that run without POSIX, as on Windows: a `sitecustomize` in PYTHONPATH calls `hide`.

It hides the modules and functions that only POSIX has. `os.uname` and `signal.Signals` stay: numpy and the enumerations
of Python need them on Linux.
"""

import os
import select
import shutil
import signal
import socket
import subprocess
import sys
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


def hide() -> None:
    """Hides POSIX in this process."""
    modules: dict[str, Any] = sys.modules
    modules.update(dict.fromkeys(MODULES))
    for owner, names in FUNCTIONS.items():
        for name in names.split():
            vars(owner).pop(name, None)
    shutil.__dict__["_use_fd_functions"] = False
    subprocess.__dict__["Popen"] = Popen
