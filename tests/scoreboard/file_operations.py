"""Operations of a process and its children on the files of a folder, watched from outside, and faults in them.

The kernel (Linux's seccomp) stops each system call that changes files, and asks the process that watches: Python, C and
C++ writers and a statically linked encoder are reached alike. The watcher counts the calls of one folder, and makes
the N-th fail, alone or with all that follow, or kills the process before it.
"""

import array
import ctypes
import errno
import fcntl
import os
import platform
import select
import signal
import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from tests.scoreboard.data import inputs_of

INPUTS = inputs_of(__name__)
ERRORS = INPUTS["ERRORS"]
REMOVAL = "unlink"  # counted, and a process may be killed there; it never fails, since nothing could be done about it


class Call(NamedTuple):
    """A system call: its number on each machine (-1 for none), and the arguments that name the file.

    `descriptor` is the index of an argument that is an open file; otherwise `path` is that of the path, and `folder`
    that of the descriptor it is relative to, or -1.
    """

    operation: str
    x86_64: int
    aarch64: int
    descriptor: int = -1
    path: int = -1
    folder: int = -1


CALLS = (
    Call("write", 1, 64, 0),
    Call("write", 18, 68, 0),  # pwrite64
    Call("write", 20, 66, 0),  # writev
    Call("write", 296, 70, 0),  # pwritev
    Call("write", 328, 287, 0),  # pwritev2
    Call("write", 40, 71, 0),  # sendfile
    Call("write", 326, 285, 2),  # copy_file_range
    Call("open", 2, -1, path=0),
    Call("open", 85, -1, path=0),  # creat
    Call("open", 257, 56, path=1, folder=0),  # openat
    Call("fsync", 74, 82, 0),
    Call("fsync", 75, 83, 0),  # fdatasync
    Call("rename", 82, -1, path=0),
    Call("rename", 264, 38, path=1, folder=0),  # renameat
    Call("exchange", 316, 276, path=1, folder=0),  # renameat2
    Call("link", 86, -1, path=1),
    Call("link", 265, 37, path=3, folder=2),  # linkat
    Call("link", 88, -1, path=1),  # symlink
    Call("link", 266, 36, path=2, folder=1),  # symlinkat
    Call("mkdir", 83, -1, path=0),
    Call("mkdir", 258, 34, path=1, folder=0),  # mkdirat
    Call("truncate", 76, 45, path=0),
    Call("truncate", 77, 46, 0),  # ftruncate
    Call("truncate", 285, 47, 0),  # fallocate
    Call("unlink", 87, -1, path=0),
    Call("unlink", 263, 35, path=1, folder=0),  # unlinkat
    Call("unlink", 84, -1, path=0),  # rmdir
)
FLAGS = {2: 1, 257: 2, 56: 2}  # the argument of an opening call with its flags
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
MACHINES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}  # AUDIT_ARCH_* of the kernel

NOTIFICATION, RESPONSE = "=QIIiIQ6Q", "=QqiI"  # struct seccomp_notif and struct seccomp_notif_resp
RECEIVE, SEND, CONTINUE = 0xC0502100, 0xC0182101, 1
SECCOMP, SET_FILTER, NEW_LISTENER, WAIT_KILLABLE = {"x86_64": 317, "aarch64": 277}, 1, 1 << 3, 1 << 5
NO_NEW_PRIVILEGES = 38
ALLOW, NOTIFY = 0x7FFF0000, 0x7FC00000
LOAD, EQUAL, ANY_OF, RETURN = 0x20, 0x15, 0x45, 0x06  # instructions of the filter
PATH_MAX = 4096


@dataclass(frozen=True)
class Fault:
    """A fault at one of the operations on a folder.

    Attributes:
      folder: the folder; operations elsewhere are not disturbed.
      number: number of the operation, from 1 on; 0 only lists the operations.
      kind: `once`: it fails; `from then on`: so do all that follow, except removals; `kill`: the process is killed.
    """

    folder: str
    number: int = 0
    kind: str = "once"


def watched(channel: socket.socket) -> None:
    """Lets the process at the other end of `channel` watch this process and all its children.

    Raises:
      OSError: the kernel cannot watch a process.
    """
    machine = platform.machine()
    if machine not in MACHINES:
        raise OSError(errno.ENOSYS, f"unknown system calls of {machine}")
    program = _filter(machine)
    code = ctypes.create_string_buffer(program, len(program))
    header = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(code))
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    for flags in (NEW_LISTENER | WAIT_KILLABLE, NEW_LISTENER):
        listener = libc.syscall(SECCOMP[machine], SET_FILTER, flags, header)
        if listener >= 0:
            break
    else:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    channel.sendmsg([b"1"], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [listener]))])
    os.close(listener)
    channel.close()


def listener(channel: socket.socket) -> int | None:
    """Returns the descriptor that watches the process at the other end of `channel`; None if it cannot be watched."""
    data, descriptors, _, _ = socket.recv_fds(channel, 1, 1)
    return descriptors[0] if data and descriptors else None


@dataclass
class Watcher:
    """Answers the kernel's questions.

    Attributes:
      listener: the descriptor of the questions.
      process: the process that `kill` kills.
      operations: operations on the folder, in their order, each with the name of its file.
    """

    listener: int
    process: int
    fault: Fault
    operations: list[tuple[str, str]] = field(default_factory=list)

    def answer(self, seconds: float) -> None:
        """Answers for `seconds`, or until there are no more questions."""
        poll = select.poll()
        poll.register(self.listener, select.POLLIN)
        while any(event & select.POLLIN for _, event in poll.poll(1000 * seconds)):
            question = bytearray(struct.calcsize(NOTIFICATION))
            try:
                fcntl.ioctl(self.listener, RECEIVE, question)
            except OSError:  # it has died meanwhile
                return
            number, thread, _, call, _, _, *arguments = struct.unpack(NOTIFICATION, question)
            error = self._error(thread, call, arguments)
            answer = struct.pack(RESPONSE, number, 0, -error, 0 if error else CONTINUE)
            try:
                fcntl.ioctl(self.listener, SEND, answer)
            except OSError:
                return

    def _error(self, thread: int, number: int, arguments: Sequence[int]) -> int:
        """Returns the error of the call; 0 lets it happen."""
        call = _BY_NUMBER[number]
        try:
            path = _path(thread, call, arguments)
        except OSError:  # it has died meanwhile, or the path is invalid
            return 0
        fault, folder = self.fault, self.fault.folder
        if not path.startswith(f"{folder}/"):
            return 0
        operation = call.operation
        if operation == "exchange" and not arguments[4]:
            operation = "rename"  # renameat2 without flags
        self.operations.append((operation, path.removeprefix(f"{folder}/")))
        count = len(self.operations)
        if fault.kind == "kill":
            if count == fault.number:
                os.kill(self.process, signal.SIGKILL)
            return 0
        if operation == REMOVAL or not fault.number:
            return 0
        hit = count == fault.number or (fault.kind == "from then on" and count > fault.number)
        errors = ERRORS[operation]
        return errors[fault.number % len(errors)] if hit else 0


def _path(thread: int, call: Call, arguments: Sequence[int]) -> str:
    """Returns the path of the file of a call.

    Raises:
      OSError: it cannot be read.
    """
    process = f"/proc/{thread}"
    if call.descriptor >= 0:
        return str(Path(f"{process}/fd/{arguments[call.descriptor] & 0xFFFFFFFF}").readlink())
    memory = os.open(f"{process}/mem", os.O_RDONLY)
    try:
        content = os.pread(memory, PATH_MAX, arguments[call.path])
    finally:
        os.close(memory)
    path = os.fsdecode(content.split(b"\0", 1)[0])
    if path.startswith("/"):
        return path
    descriptor = ctypes.c_int32(arguments[call.folder] & 0xFFFFFFFF).value if call.folder >= 0 else -100
    folder = Path(f"{process}/cwd" if descriptor < 0 else f"{process}/fd/{descriptor}").readlink()
    return f"{folder}/{path}"


def _filter(machine: str) -> bytes:
    """Returns the kernel's program, which asks about these calls, except writes to the standard streams."""
    numbers = [number for call in CALLS if (number := getattr(call, machine)) >= 0]
    write = numbers[0]
    program = [
        (LOAD, 0, 0, 4),  # the machine
        (EQUAL, 1, 0, MACHINES[machine]),
        (RETURN, 0, 0, ALLOW),
        (LOAD, 0, 0, 0),  # the number of the call
    ]
    for number in numbers:
        if number in FLAGS:  # asks where it opens to write
            body = [(LOAD, 0, 0, 16 + 8 * FLAGS[number]), (ANY_OF, 0, 1, WRITING), (RETURN, 0, 0, NOTIFY)]
        elif number == write:
            body = [(LOAD, 0, 0, 16), (EQUAL, 2, 0, 1), (EQUAL, 1, 0, 2), (RETURN, 0, 0, NOTIFY)]
        else:
            body = [(RETURN, 0, 0, NOTIFY)]
        if len(body) > 1:
            body.append((RETURN, 0, 0, ALLOW))
        program += [(EQUAL, 0, len(body), number), *body]
    program.append((RETURN, 0, 0, ALLOW))
    return b"".join(struct.pack("HBBI", *instruction) for instruction in program)


_BY_NUMBER = {getattr(call, platform.machine(), -1): call for call in CALLS}
