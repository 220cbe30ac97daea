"""A filter of system calls, by which a process of Linux gives up the network, for itself and its children.

The filter is a program of classic BPF over `struct seccomp_data`: see seccomp(2) and linux/seccomp.h. It refuses every
socket but those between processes of one machine, and the interface by which a kernel opens sockets unseen (io_uring).
"""

import ctypes
import errno
import os
import platform
import socket
import struct

LOAD, JUMP_IF_EQUAL, JUMP_IF_AT_LEAST, AND, RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
NUMBER, ARCHITECTURE, FIRST, SECOND = 0, 4, 16, 24  # offsets in struct seccomp_data
ALLOW, REFUSE, KILL = 0x7FFF0000, 0x00050000 | errno.EACCES, 0x80000000
TYPE = 0xF  # the bits of a socket's type without its flags
IO_URING = 425
FOREIGN = 0x40000000  # numbers of another interface of x86-64 (x32)
SET_SECCOMP, FILTER, NO_NEW_PRIVILEGES = 22, 2, 38

# Of each machine: how the kernel calls it, and the number of `socket`.
MACHINES = {"x86_64": (0xC000003E, 41), "aarch64": (0xC00000B7, 198)}


class Program(ctypes.Structure):
    """A program of classic BPF, as the kernel takes it."""

    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


_Step = tuple[int, int, str, str]


def is_known() -> bool:
    """Whether there is a filter for this machine."""
    return platform.system() == "Linux" and platform.machine() in MACHINES


def refuse_network(*, serves: bool = False) -> None:
    """Lets this process, and what it starts from now on, open no socket of a network.

    Args:
      serves: whether it may open those of TCP.

    Raises:
      OSError: it cannot.
    """
    library = ctypes.CDLL(None, use_errno=True)
    code = _filter(*MACHINES[platform.machine()], serves)
    program = Program(len(code) // 8, code)
    if library.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) or library.prctl(SET_SECCOMP, FILTER, ctypes.byref(program), 0, 0):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _filter(architecture: int, opens_socket: int, serves: bool) -> bytes:
    """The program: of each step the operation, its value, and where to go on if it holds and if not."""
    of_network: list[_Step] = [
        (JUMP_IF_EQUAL, socket.AF_INET, "type", ""),
        (JUMP_IF_EQUAL, socket.AF_INET6, "type", "refuse"),
        (LOAD, SECOND, "", ""),
        (AND, TYPE, "", ""),
        (JUMP_IF_EQUAL, socket.SOCK_STREAM, "allow", "refuse"),
    ]
    steps: list[_Step] = [
        (LOAD, ARCHITECTURE, "", ""),
        (JUMP_IF_EQUAL, architecture, "", "kill"),  # another set of numbers would pass every comparison below
        (LOAD, NUMBER, "", ""),
        (JUMP_IF_AT_LEAST, FOREIGN, "refuse", ""),
        (JUMP_IF_EQUAL, IO_URING, "refuse", ""),
        (JUMP_IF_EQUAL, opens_socket, "", "allow"),
        (LOAD, FIRST, "", ""),
        (JUMP_IF_EQUAL, socket.AF_UNIX, "allow", "" if serves else "refuse"),
        *(of_network if serves else []),
        (RETURN, ALLOW, "", ""),
        (RETURN, REFUSE, "", ""),
        (RETURN, KILL, "", ""),
    ]
    end = len(steps)
    places = {"allow": end - 3, "refuse": end - 2, "kill": end - 1, "type": end - 6}
    return b"".join(
        struct.pack("HBBI", operation, places.get(yes, place) - place, places.get(no, place) - place, value)
        for place, (operation, value, yes, no) in enumerate(steps, 1)  # jumps count from the step after
    )
