"""The functions of `system` on Linux, macOS and other POSIX systems."""

import errno
import fcntl
import math
import mmap
import os
import select
import signal
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypedDict

CAN_FORK = True
CAN_FORK_LATE = sys.platform == "linux"  # after libraries have been loaded, which macOS does not support
PASSES_DESCRIPTORS = True  # to the processes that it starts
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # that end a process
PROMISE = signal.SIGUSR1  # by which a process calls for the one that reads its promise
READ_FLAGS = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC  # to open a file that may turn out to be a pipe
FOLDER_FLAGS = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
LAST_SECONDS = 5  # of computing, from the signal of the soft limit to the hard one
PATH_MAX = os.pathconf("/", "PC_PATH_MAX") - 1  # bytes of a path, without the null character at its end
STATUS = Path("/proc/self/statm")
BOOT = Path("/proc/sys/kernel/random/boot_id")


class PopenArguments(TypedDict):
    """Arguments of `Popen`."""

    pass_fds: Sequence[int]
    start_new_session: bool


def release_signals() -> None:
    """Lets the signals through that this process has held back since its start."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def send_promise(pid: int) -> None:
    """Calls for the process that reads the promise of this one."""
    os.kill(pid, PROMISE)


@contextmanager
def end_after(seconds: int) -> Generator[None]:
    """Lets the system end this process if the block takes `seconds`, whatever it does then."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)


def set_limits(
    *, memory: float | None, cpu: float | None, file_size: float | None, core: float | None, hard: bool
) -> None:
    """Sets the limits of this process that are not None; see `child_process.limit_this_process`."""
    import resource

    if memory is not None:
        pages = int(STATUS.read_text().split()[0]) if STATUS.exists() else 0
        memory += pages * mmap.PAGESIZE
    kinds = (resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_FSIZE, resource.RLIMIT_CORE)
    for kind, most in zip(kinds, (memory, cpu, file_size, core), strict=True):
        if most is None:
            continue
        with suppress(OSError, ValueError):
            highest = resource.getrlimit(kind)[1]
            soft = highest if most == math.inf else most if highest == resource.RLIM_INFINITY else min(most, highest)
            # At the hard limit of computing the kernel kills the process without a signal that explains it.
            lasting = soft + LAST_SECONDS if kind == resource.RLIMIT_CPU and most < math.inf else soft
            resource.setrlimit(kind, (int(soft), int(lasting) if hard else highest))


def most_open_files() -> int:
    """Returns how many files and other descriptors this process may have."""
    import resource

    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def process_options(descriptors: Sequence[int]) -> PopenArguments:
    """Returns the arguments of `Popen` for a process in a separate session that inherits `descriptors`."""
    return {"pass_fds": descriptors, "start_new_session": True}


def duplicate(descriptor: int) -> int:
    """Returns a copy of a descriptor that is above those of the standard streams, and is not inherited."""
    return fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)


def kill_group(pid: int) -> None:
    """Kills a process that was started with `process_options`, and everything in its session."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def make_nonblocking(pipe: int) -> None:
    """Makes writing to a pipe fail with BlockingIOError, instead of waiting, while it is full."""
    os.set_blocking(pipe, False)


def wait_until_writable(pipe: int, seconds: float) -> bool:
    """Waits until a pipe takes more, for `seconds` at most, and returns whether it does."""
    return bool(_events(pipe, select.POLLOUT, seconds))


def wait_for_hangup(connection: int) -> None:
    """Waits until the other end of a connection is closed."""
    _events(connection, 0, math.inf)


def reader_is_gone(descriptor: int) -> bool:
    """Returns whether the other end of a pipe is closed."""
    return bool(_events(descriptor, 0, 0) & (select.POLLERR | select.POLLHUP))


def is_full(descriptor: int) -> bool:
    """Returns whether the other end of a pipe must be read before more can be written."""
    return not _events(descriptor, select.POLLOUT, 0)


def is_read_only(descriptor: int) -> bool:
    """Returns whether a descriptor is open for reading only."""
    return fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY


def locked(path: Path, *, wait: bool = True) -> int | None:
    """Returns a descriptor that holds the lock of a file or folder; None if another process has removed it.

    Raises:
      OSError: another process holds the lock and `wait` is False, or the file system has no locks.
    """
    is_folder = path.is_dir()
    try:
        descriptor = os.open(path, (os.O_RDONLY if is_folder else os.O_RDWR) | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        if os.path.samestat(os.fstat(descriptor), path.lstat()):
            return descriptor
    except FileNotFoundError:
        pass
    except BaseException:
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None


def is_open_elsewhere(path: Path) -> bool:
    """Returns whether another process has locked a file, or has it open, as far as the system reveals that."""
    try:
        descriptor = os.open(path, READ_FLAGS)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if hasattr(fcntl, "F_SETLEASE"):  # Linux grants it for a file that no other process has open
            fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)  # which is ignored, if one opens it now
            fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_WRLCK)
    except OSError as error:
        return error.errno in (errno.EAGAIN, errno.EACCES)
    finally:
        os.close(descriptor)
    return False


def hard_link(existing: Path, new: Path) -> None:
    """Gives a file a second name, without following a symbolic link.

    Raises:
      OSError: the file system has no links.
    """
    os.link(existing, new, follow_symlinks=False)


def remove_folder(path: Path) -> None:
    """Removes a folder with everything in it, as far as possible, and without following links.

    Raises:
      OSError: it cannot be opened, or something in it cannot be removed.
    """
    import shutil  # not before the command forks

    with suppress(RecursionError):
        shutil.rmtree(path, ignore_errors=True)
    if path.exists():
        _remove_deep_folder(path)


def _remove_deep_folder(path: Path) -> None:
    """Removes a folder that is nested too deeply for recursion and for the number of open descriptors.

    Folders in it are moved up before they are emptied, which requires space on the disk.
    """
    top = os.open(path, FOLDER_FLAGS)
    try:
        waiting = _without_files(top)
        while waiting:
            name = waiting.pop()
            with suppress(OSError):
                folder = os.open(name, FOLDER_FLAGS, dir_fd=top)
                try:
                    for inner in _without_files(folder):
                        waiting.append(os.urandom(8).hex())
                        os.rename(inner, waiting[-1], src_dir_fd=folder, dst_dir_fd=top)
                finally:
                    os.close(folder)
                os.rmdir(name, dir_fd=top)
    finally:
        os.close(top)
    path.rmdir()


def _without_files(folder: int) -> list[str]:
    """Removes the files of an open folder, and returns the names of the folders in it."""
    with os.scandir(folder) as entries:
        found = [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
    for name, is_folder in found:
        if not is_folder:
            with suppress(OSError):
                os.unlink(name, dir_fd=folder)
    return [name for name, is_folder in found if is_folder]


def effective_user() -> int:
    """Returns the user whose rights this process has; 0 may replace everyone's files."""
    return os.geteuid()


def show_utf8() -> None:
    """Does nothing: terminals show what the user has chosen."""


def cache_home() -> Path:
    """Returns the folder below which programs store what they can make again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111 – never fails


def machine_name() -> str:
    """Returns the name of this machine in its network."""
    return os.uname().nodename


def process_identity() -> str:
    """Returns what `has_ended` knows this process by; empty where the system does not reveal it."""
    try:
        container = Path("/proc/self/ns/pid").stat().st_ino  # which numbers processes by itself
        return f"{BOOT.read_text().strip()}/{container} {os.getpid()} {_process_start(os.getpid())}"
    except OSError:
        return ""


def has_ended(identity: str) -> bool:
    """Returns whether the process with an identity has ended; False for those of other machines and containers."""
    machine, _, process = identity.partition(" ")
    pid, _, start = process.partition(" ")
    if not pid.isdecimal() or process_identity().partition(" ")[0] != machine:
        return False
    try:
        return _process_start(int(pid)) != start
    except (FileNotFoundError, ProcessLookupError):
        return True
    except OSError:
        return False


def _process_start(pid: int) -> str:
    """Returns the time at which a process started; empty if it has ended and its parent does not know yet."""
    state, *facts = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(")")[2].split()
    return "" if state in "ZX" else facts[18]


def _events(descriptor: int, which: int, seconds: float) -> int:
    poll = select.poll()
    poll.register(descriptor, which)
    return next((events for _, events in poll.poll(None if seconds == math.inf else seconds * 1000)), 0)
