"""Operations of an attacker's code inside a confined process, which plays an exploited parser; each runs in a fork.

An operation returns the stolen content, or None if its harm shows outside; it raises if it is refused.
"""

import ctypes
import errno
import fcntl
import json
import mmap
import os
import platform
import resource
import signal
import socket
import struct
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from tests.scoreboard.data import inputs_of

PLACE, RESULTS, TARGETS, LIE = "ATTACK_PLACE", "ATTACK_RESULTS", "ATTACK_TARGETS", "ATTACK_LIE"  # of the environment
SECRET = "hunter2"
REFUSED = (errno.EACCES, errno.EPERM, errno.ENOSYS)
LIMIT = 20  # [s] for an operation
SECCOMP, LANDLOCK, SIGNALS = "seccomp", "Landlock", "Landlock 6"  # the mechanism that refuses an operation
MAIN, LOADER, CHILD = "main", "loader", "child"  # the place of the code
IS_X86 = platform.machine() == "x86_64"


@dataclass(frozen=True)
class Target:
    """The files, processes and sockets outside that an operation attacks.

    Attributes:
      folder: a folder outside, with a file `secret`, which has an attribute, and a folder `empty`.
      readable: a file beside the model.
      beside: an empty folder beside the one of temporary files.
      memory: a file in /dev/shm.
      pid: a process that runs in the folder, with a secret in its environment.
      sockets: addresses of servers: the path of a stream, its abstract name, the path of datagrams, TCP and UDP ports.
      key: key of shared memory and semaphores.
      watcher: the process that watches the command.
    """

    folder: str
    readable: str
    beside: str
    memory: str
    pid: int
    sockets: tuple[str, str, str, int, int]
    key: int
    watcher: int = 0

    @property
    def secret(self) -> str:
        return f"{self.folder}/secret"


Act = Callable[[Target], object]


@dataclass(frozen=True)
class Operation:
    """One operation.

    Attributes:
      name: a few words for the list of failures.
      act: the operation itself.
      by: the mechanism that refuses it.
      free: true if it may be tried in a process that is not confined, to see that it works.
    """

    name: str
    act: Act
    by: str
    free: bool = True


OPERATIONS: dict[str, Operation] = {}


def operation(name: str, by: str = LANDLOCK, *, free: bool = True) -> Callable[[Act], Act]:
    def add(act: Act) -> Act:
        OPERATIONS[name] = Operation(name, act, by, free)
        return act

    return add


def call(x86: int, arm: int, *arguments: object) -> int:
    """Makes a system call by its number on each machine."""
    numbers = {"x86_64": x86, "aarch64": arm}
    library = ctypes.CDLL(None, use_errno=True)
    result = library.syscall(ctypes.c_long(numbers[platform.machine()]), *arguments)
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def reached(x86: int, arm: int, *arguments: object) -> str | None:
    """Makes a system call with invalid arguments: an error about them shows that it was reached."""
    try:
        return f"{call(x86, arm, *arguments)}"
    except OSError as error:
        if error.errno in REFUSED:
            raise
        return str(error)


# Reading
operation("read a file")(lambda at: Path(at.secret).read_text())
operation("list a folder")(lambda at: os.listdir(at.folder))  # noqa: PTH208
operation("read by way of /proc/self/root")(lambda at: Path(f"/proc/self/root{at.secret}").read_text())
operation("read by way of another process")(lambda at: Path(f"/proc/{at.pid}/cwd/secret").read_text())
operation("read the environment of a process")(lambda at: Path(f"/proc/{at.pid}/environ").read_text())
operation("open the memory of a process")(lambda at: os.close(os.open(f"/proc/{at.pid}/mem", os.O_RDWR)) or "opened")
operation("see the files of a process")(lambda at: os.readlink(f"/proc/{at.pid}/fd/0"))  # noqa: PTH115
operation("see the program of a process")(lambda at: os.readlink(f"/proc/{at.pid}/exe"))  # noqa: PTH115
operation("read shared memory in /dev/shm")(lambda at: Path(at.memory).read_text())
operation("write shared memory in /dev/shm")(lambda at: Path(at.memory).write_text("mine"))
operation("read an attribute of a file", SECCOMP)(lambda at: os.getxattr(at.secret, "user.secret").decode())
operation("openat2", SECCOMP)(lambda at: call(437, 437, -100, at.secret.encode(), struct.pack("QQQ", 0, 0, 0), 24))
operation("io_uring", SECCOMP)(lambda at: reached(425, 425, 1, None))
operation("watch a folder by inotify", SECCOMP)(
    lambda at: call(254, 27, call(294, 26, 0), at.folder.encode(), 0x100) and "watched"
)
operation("fanotify", SECCOMP)(lambda at: reached(300, 262, 0x4, 0))
operation("open the terminal")(lambda at: os.close(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY)) or "opened")


@operation("open by a handle", SECCOMP)
def open_by_handle(at: Target) -> object:
    handle = ctypes.create_string_buffer(struct.pack("Ii", 128, 0) + bytes(128))
    call(303, 264, -100, at.secret.encode(), handle, ctypes.byref(ctypes.c_int()), 0)
    folder = os.open(at.folder, os.O_RDONLY)
    return os.read(call(304, 265, folder, handle, 0), 100).decode()


# Files
operation("link a file into the output")(lambda at: os.link(at.secret, _own("linked")) or "linked")
operation("move a file into the output")(lambda at: Path(at.secret).rename(_own("moved")))
operation("make a link in the output")(lambda at: Path(_own("link")).symlink_to(at.secret) or "made")
operation("append to a file")(lambda at: _append(at.secret))
operation("truncate", SECCOMP)(lambda at: os.truncate(at.secret, 1))
operation("truncate what may be read", SECCOMP)(lambda at: os.truncate(at.readable, 1))
operation("open to read, and truncate", SECCOMP)(lambda at: os.close(os.open(at.readable, os.O_RDONLY | os.O_TRUNC)))
operation("write what may be read")(lambda at: _append(at.readable))
operation("remove what may be read")(lambda at: Path(at.readable).unlink())
operation("write beside the model")(lambda at: Path(f"{at.readable}.new").write_text("x"))
operation("remove a file")(lambda at: Path(at.secret).unlink())
operation("make a file")(lambda at: Path(f"{at.folder}/new").write_text("x"))
operation("make a folder")(lambda at: Path(f"{at.folder}/new").mkdir())
operation("make a link")(lambda at: Path(f"{at.folder}/new").symlink_to("secret"))
operation("make a pipe")(lambda at: os.mkfifo(f"{at.folder}/new"))
operation("remove an empty folder")(lambda at: Path(f"{at.folder}/empty").rmdir())
operation("remove a folder beside the temporary one")(lambda at: Path(at.beside).rmdir())
operation("make a file beside the temporary one")(lambda at: Path(f"{at.beside}/new").write_text("x"))
operation("write into the interpreter")(lambda at: _scratch(f"{sys.prefix}/pwned"))
operation("write into the packages")(lambda at: _scratch(f"{Path(np_folder())}/pwned"))
operation("chmod", SECCOMP)(lambda at: Path(at.secret).chmod(0o777))
operation("fchmod", SECCOMP)(lambda at: os.fchmod(os.open(at.readable, os.O_RDONLY), 0o777))
operation("fchmodat2", SECCOMP)(lambda at: call(452, 452, -100, at.secret.encode(), 0o777, 0))
operation("chown", SECCOMP)(lambda at: os.chown(at.secret, os.getuid(), os.getgid()) or "done")
operation("utime", SECCOMP)(lambda at: os.utime(at.secret, (0, 0)))
operation("utime by a descriptor", SECCOMP)(lambda at: os.utime(os.open(at.readable, os.O_RDONLY), (0, 0)))
operation("set an attribute", SECCOMP)(lambda at: os.setxattr(at.secret, "user.secret", b"mine"))
operation("set an attribute by a descriptor", SECCOMP)(
    lambda at: os.setxattr(os.open(at.readable, os.O_RDONLY), "user.new", b"mine") or "set"
)
operation("remove an attribute", SECCOMP)(lambda at: os.removexattr(at.secret, "user.secret"))
operation("change flags of a file", SECCOMP)(lambda at: _flags(at.readable))


def np_folder() -> str:
    return os.path.dirname(import_module("numpy").__file__ or "")  # noqa: PTH120


def _own(name: str) -> Path:
    """Returns a new name in the folder of the outputs."""
    return Path(os.environ[RESULTS]).with_name(f"{name}-{os.getpid()}")


def _append(path: str) -> None:
    with Path(path).open("a") as file:
        file.write("x")


def _scratch(path: str) -> str:
    Path(path).write_text("x")
    Path(path).unlink()
    return "written"


def _flags(path: str) -> str:
    """Sets the flag that excludes a file from backups (FS_IOC_SETFLAGS)."""
    fcntl.ioctl(os.open(path, os.O_RDONLY), 0x40086602, struct.pack("i", 0x40))
    return "set"


# Processes
operation("kill a process", SIGNALS)(lambda at: os.kill(at.pid, signal.SIGKILL))
operation("kill a group", SIGNALS)(lambda at: os.killpg(at.pid, signal.SIGKILL))
operation("kill a thread", SIGNALS)(lambda at: call(234, 131, at.pid, at.pid, 9) and None)
operation("kill by a queue", SECCOMP)(
    lambda at: call(129, 138, at.pid, 10, struct.pack("iii4x112x", 10, 0, -1)) and None
)
operation("kill by a descriptor", SECCOMP)(lambda at: call(424, 424, call(434, 434, at.pid, 0), 9, None, 0) and None)
operation("signal the own group", SECCOMP)(lambda at: os.kill(0, 0) or "reached")
operation("signal all", SECCOMP)(lambda at: os.kill(-1, 0) or "reached")
operation("signal the watcher", SIGNALS, free=False)(lambda at: os.kill(at.watcher, 0) or "reached")
operation("trace a process", SECCOMP)(lambda at: call(101, 117, 0x4206, at.pid, None, None) or "seized")
operation("read memory of a process", SECCOMP)(lambda at: reached(310, 270, at.pid, _vector(), 1, _vector(), 1, 0))
operation("write memory of a process", SECCOMP)(lambda at: reached(311, 271, at.pid, _vector(), 1, _vector(), 1, 0))
operation("take a file of a process", SECCOMP)(lambda at: call(438, 438, call(434, 434, at.pid, 0), 1, 0) and "taken")
operation("compare processes", SECCOMP)(lambda at: reached(312, 272, at.pid, at.pid, 2, 0, 0))
operation("move pages of a process", SECCOMP)(lambda at: reached(279, 239, at.pid, 1, None, None, None, 0))
operation("change the priority of a process", SECCOMP)(lambda at: os.setpriority(os.PRIO_PROCESS, at.pid, 19))
operation("change the cores of a process", SECCOMP)(lambda at: os.sched_setaffinity(at.pid, {0}) or "set")
operation("change the scheduling of a process", SECCOMP)(
    lambda at: os.sched_setscheduler(at.pid, os.SCHED_IDLE, os.sched_param(0))
)
operation("change limits of a process", SECCOMP)(lambda at: resource.prlimit(at.pid, resource.RLIMIT_NOFILE, (8, 8)))
operation("change the disk priority of a process", SECCOMP)(lambda at: reached(251, 30, 1, at.pid, 3 << 13))


@operation("signal by the owner of a pipe", SECCOMP)
def signal_by_owner(at: Target) -> None:
    into, out = os.pipe()
    fcntl.fcntl(into, fcntl.F_SETOWN, at.pid)
    fcntl.fcntl(into, 10, signal.SIGKILL)  # F_SETSIG
    fcntl.fcntl(into, fcntl.F_SETFL, os.O_ASYNC)
    os.write(out, b"x")


def _vector() -> object:
    """Returns one byte of memory that no process has (struct iovec)."""
    return struct.pack("QQ", 8, 1)


# What processes share
operation("shared memory of System V", SECCOMP)(lambda at: f"{call(29, 194, at.key, 1, 0)}")
operation("semaphores of System V", SECCOMP)(lambda at: f"{call(64, 190, at.key, 1, 0o1600)}")
operation("messages of System V", SECCOMP)(lambda at: f"{call(68, 186, at.key, 0o1600)}")
operation("messages of POSIX", SECCOMP)(lambda at: reached(240, 180, None, 0, 0, None))
operation("keys of the session", SECCOMP)(lambda at: reached(250, 219, 0, ctypes.c_int(-4), 0, 0, 0))
operation("add a key", SECCOMP)(lambda at: reached(248, 217, None, None, None, 0, 0))
operation("search for a key", SECCOMP)(lambda at: reached(249, 218, None, None, None, 0))


# Sockets
def _connected(family: int, kind: int, address: object) -> str:
    with socket.socket(family, kind) as opened:
        opened.connect(address)  # type: ignore[arg-type]
        opened.send(b"x")
    return "connected"


operation("connect to a socket of a path", SECCOMP)(lambda at: _connected(1, 1, at.sockets[0]))
operation("connect to an abstract socket", SECCOMP)(lambda at: _connected(1, 1, at.sockets[1]))
operation("send to a socket of datagrams", SECCOMP)(lambda at: _connected(1, 2, at.sockets[2]))
operation("send from a pair of datagrams", SECCOMP)(
    lambda at: socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)[0].sendto(b"x", at.sockets[2])
)
operation("connect by TCP", SECCOMP)(lambda at: _connected(2, 1, ("127.0.0.1", at.sockets[3])))
operation("connect by sending", SECCOMP)(
    lambda at: socket.socket(2, 1).sendto(b"x", 0x20000000, ("127.0.0.1", at.sockets[3]))
)
operation("send by UDP", SECCOMP)(lambda at: _connected(2, 2, ("127.0.0.1", at.sockets[4])))
operation("a socket of the kernel (netlink)", SECCOMP)(lambda at: socket.socket(16, 3).fileno())
operation("a socket for ciphers", SECCOMP)(lambda at: socket.socket(38, 5).fileno())
operation("a socket of machines (vsock)", SECCOMP)(lambda at: socket.socket(40, 1).fileno())
operation("a socket of MPTCP", SECCOMP)(lambda at: socket.socket(2, 1, 262).fileno())
operation("a raw socket", SECCOMP)(lambda at: socket.socket(2, 3, 1).fileno())
LISTEN = "listen at a port"


@operation(LISTEN, SECCOMP)
def listen(at: Target) -> str:
    with socket.socket(2, 1) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.listen()
    return "listens"


# The terminal, which is standard input
def _terminal(request: int, value: bytes) -> str | None:
    try:
        library = ctypes.CDLL(None, use_errno=True)
        result = library.ioctl(0, ctypes.c_ulong(request), value)
        if result < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    except OSError as error:
        if error.errno in REFUSED:
            raise
        return str(error)  # from the terminal, which was reached
    return None if request & 0xFFFFFFFF == 0x5412 else "done"


operation("type into the terminal", SECCOMP)(lambda at: _terminal(0x5412, b"x"))
operation("type into the terminal, high bits", SECCOMP)(lambda at: _terminal(0x1_00005412, b"y"))
operation("TIOCLINUX", SECCOMP)(lambda at: _terminal(0x541C, b"\x03"))
operation("TIOCLINUX, high bits", SECCOMP)(lambda at: _terminal(0xFF_0000541C, b"\x03"))
operation("change the foreground of the terminal", SECCOMP)(
    lambda at: _terminal(0x5410, struct.pack("i", os.getpgrp()))
)
operation("change the size of the terminal", SECCOMP)(lambda at: _terminal(0x5414, struct.pack("4H", 7, 7, 0, 0)))
operation("change the discipline of the terminal", SECCOMP)(lambda at: _terminal(0x5423, struct.pack("i", 0)))


@operation("change the settings of the terminal", SECCOMP)
def change_settings(at: Target) -> str:
    termios.tcsetattr(0, termios.TCSANOW, termios.tcgetattr(0))
    return "changed"


# The kernel
for _name, _call in inputs_of(__name__)["CALLS"].items():
    operation(_name, SECCOMP)(lambda at, numbers=_call: reached(*numbers))  # type: ignore[misc]


@operation("set limits of a superuser", SECCOMP)
def raise_limits(at: Target) -> str:
    """Sets a higher priority, which only a superuser may."""
    os.setpriority(os.PRIO_PROCESS, 0, os.getpriority(os.PRIO_PROCESS, 0) - 5)
    return "set"


if IS_X86:
    operation("chmod by numbers of x32", SECCOMP)(lambda at: call(0x40000000 | 90, 0, at.secret.encode(), 0o777))
    for _name, _request in (("iopl", (172, 0, 99)), ("modify_ldt", (154, 0, 0, None, 0)), ("uselib", (134, 0, None))):
        operation(_name, SECCOMP)(lambda at, numbers=_request: reached(*numbers))  # type: ignore[misc]

    @operation("chmod by the interface of 32 bits", SECCOMP)
    def chmod_32_bits(at: Target) -> None:
        low = ctypes.CDLL(None).mmap
        low.restype, low.argtypes = ctypes.c_void_p, [ctypes.c_void_p, *[ctypes.c_size_t] * 5]
        memory = low(None, 8192, mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC, 0x22 | 0x40, 2**64 - 1, 0)
        path = memory + 4096
        ctypes.memmove(path, at.secret.encode() + b"\0", len(at.secret) + 1)
        # push rbx; mov eax, 15; mov ebx, path; mov ecx, 0777; int 0x80; pop rbx; ret
        code = b"\x53\xb8\x0f\0\0\0\xbb" + struct.pack("I", path) + b"\xb9\xff\x01\0\0\xcd\x80\x5b\xc3"
        ctypes.memmove(memory, code, len(code))
        ctypes.CFUNCTYPE(ctypes.c_int)(memory)()


def _attempts(watcher: int) -> Iterator[dict[str, object]]:
    targets = json.loads(os.environ[TARGETS])
    for name, values in targets.items():
        at = Target(**{**values, "sockets": tuple(values["sockets"]), "watcher": watcher})
        into, out = os.pipe()
        child = os.fork()
        if not child:
            signal.alarm(LIMIT)
            result: dict[str, object] = {}
            try:
                result = {"got": OPERATIONS[name].act(at)}
            except BaseException as error:
                result = {"refused": f"{type(error).__name__}: {error}"}
            with suppress(BaseException):
                os.write(out, json.dumps(result, default=str).encode()[:4000])
            os._exit(0)
        os.close(out)
        with os.fdopen(into) as answer:
            text = answer.read()
        _, status = os.waitpid(child, 0)
        died = {"died": os.waitstatus_to_exitcode(status)}
        yield {"name": name, **(json.loads(text) if text else died)}


def attack(watcher: int, results: int | None = None) -> None:
    """Tries all operations that have targets, writes the result of each, and leaves a daemon."""
    own = os.open(os.environ[RESULTS], os.O_WRONLY | os.O_APPEND | os.O_CREAT) if results is None else results
    for attempt in _attempts(watcher):
        os.write(own, json.dumps(attempt).encode() + b"\n")
    into, out = os.pipe()
    if not os.fork():
        try:
            os.setsid()
            if not os.fork():
                signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
                os.write(out, f"{os.getpid()}".encode())
                os.closerange(0, 256)
                time.sleep(1000)
        finally:
            os._exit(0)
    os.write(own, json.dumps({"name": "a daemon", "pid": int(os.read(into, 20))}).encode() + b"\n")


# Statements that write false entries on the status board before the process dies; `at` is the target.
LIES = {
    "folders": "board.write(ProcessStatus(folders=[at.folder]))",
    "children": "board.write(ProcessStatus(children=[at.pid, -at.pid]))",
    "made folders": "board.write(ProcessStatus(made=[at.folder + '/empty']))",
    "a promise": "board.write(ProcessStatus(promise=ConfinementPromise(at.folder, [at.folder], 1)))",
    "escape sequences": "board.write(ProcessStatus('drawing', '\x1b]0;title\x07\x9b' * 999))",
    "garbage": "board.memory[8:] = b'\\xff' * (len(board.memory) - 8)",
}


def attacked(arguments: list[str]) -> int:
    """Runs a command line, with the attacker's code at PLACE from the moment it is confined."""
    from mjrun import child_process, shared_status
    from mjrun.cli import crash_monitor, simulation_command
    from mjrun.cli.main import run
    from mjrun.model.sources import file

    place, begun, results = os.environ[PLACE], list[int](), list[int]()
    load, compile_spec = simulation_command.import_mujoco, file.compile_spec

    def in_main() -> None:
        if not begun:
            begun.append(os.getppid())
            if lie := os.environ.get(LIE):
                at = Target(**json.loads(os.environ[TARGETS])["kill a process"])
                names = {
                    "at": at,
                    "board": shared_status._memory,
                    "ProcessStatus": shared_status.ProcessStatus,
                    "ConfinementPromise": shared_status.ConfinementPromise,
                }
                exec(LIES[lie], names)
                os.kill(os.getpid(), signal.SIGSEGV)
            if place != CHILD:
                results.append(os.open(os.environ[RESULTS], os.O_WRONLY | os.O_APPEND | os.O_CREAT))
            if place == MAIN:
                attack(begun[0], results[0])
                if arguments[0] == "view":  # it waits for its user
                    os._exit(0)
        load()

    def in_loader(*arguments: object, **settings: object) -> object:
        if place == LOADER and results:
            attack(begun[0], results.pop())
        return partial(compile_spec, *arguments, **settings)()  # type: ignore[arg-type]

    simulation_command.import_mujoco = in_main
    file.compile_spec = in_loader  # type: ignore[assignment]
    watcher, continue_in_fork = os.getpid(), child_process._continue_in_fork

    def in_fork(*arguments: Any) -> NoReturn:
        attack(watcher)
        continue_in_fork(*arguments)

    if place == CHILD:  # a new interpreter, or a fork
        begin = f"; from tests.scoreboard.attacks import attack; attack({watcher})"
        child_process.BOOT = child_process.BOOT.replace("; from", f"{begin}; from", 1)
        child_process._continue_in_fork = in_fork
    crash_monitor.continue_in_monitored_child()
    return run(arguments)
