"""Landlock, by which a Linux process gives up access to files and to the network, for itself and its children.

Neither Python's library nor glibc wraps these system calls. See landlock(7); the constants are those of
linux/landlock.h, and the numbers of the calls are the same on every architecture.
"""

import ctypes
import os
import stat
from collections.abc import Iterable

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
VERSION, PATH_BENEATH, NET_PORT = 1, 1, 2

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
REFER, TRUNCATE, IOCTL_DEVICE = 1 << 13, 1 << 14, 1 << 15
MAKE_DEVICES = 1 << 6 | 1 << 9 | 1 << 10 | 1 << 11  # making devices, sockets and pipes
SYMLINKS = 1 << 12  # making links
ALL = (1 << 13) - 1  # of version 1
BIND_TCP, CONNECT_TCP = 1 << 0, 1 << 1
ABSTRACT_SOCKETS, SIGNALS = 1 << 0, 1 << 1  # of other processes

READ = EXECUTE | READ_FILE | READ_DIR
USE = WRITE_FILE | READ_FILE | READ_DIR | IOCTL_DEVICE  # of a device
WRITE = (ALL | REFER | TRUNCATE) & ~(EXECUTE | MAKE_DEVICES | SYMLINKS)  # and read
OF_FILES = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEVICE  # the other rights apply to folders
NO_NEW_PRIVILEGES = 38  # of prctl


class _Ruleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathRule(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"  # Python 3.19 will require it with _pack_
    _fields_ = (("access", ctypes.c_uint64), ("folder", ctypes.c_int32))


def version() -> int:
    """Returns the version of Landlock's interface that the kernel offers; 0 for none."""
    try:
        return max(0, _call(CREATE_RULESET, None, ctypes.c_size_t(0), VERSION))
    except (OSError, AttributeError, TypeError):  # the last two: not Linux
        return 0


def restrict(rules: Iterable[tuple[str, int]], *, network: bool = True, serves: bool = False) -> None:
    """Restricts this thread, and everything it starts from now on, to the file access in `rules`.

    Args:
      rules: paths, each with the access rights there and below; missing paths are omitted.
      network: whether TCP connections, other processes' signals and their abstract sockets are refused too, as far as
        the kernel can.
      serves: whether ports may be opened nevertheless.

    Raises:
      OSError: the kernel refuses the rules.
    """
    known = version()
    handled = ALL | (REFER if known >= 2 else 0) | (TRUNCATE if known >= 3 else 0) | (IOCTL_DEVICE if known >= 5 else 0)
    refused = (CONNECT_TCP if serves else CONNECT_TCP | BIND_TCP) if network and known >= 4 else 0
    scoped = ABSTRACT_SOCKETS | SIGNALS if network and known >= 6 else 0
    size = 24 if known >= 6 else 16 if known >= 4 else 8
    ruleset = _call(CREATE_RULESET, ctypes.byref(_Ruleset(handled, refused, scoped)), ctypes.c_size_t(size), 0)
    try:
        for path, access in rules:
            _add(ruleset, path, access & handled)
        give_up_privileges()
        _call(RESTRICT_SELF, ruleset, 0)
    finally:
        os.close(ruleset)


def _add(ruleset: int, path: str, access: int) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except (OSError, ValueError):
        return
    try:
        if not stat.S_ISDIR(os.fstat(place).st_mode):
            access &= OF_FILES
        _call(ADD_RULE, ruleset, PATH_BENEATH, ctypes.byref(_PathRule(access, place)), 0)
    finally:
        os.close(place)


def give_up_privileges() -> None:
    """Promises never to gain privileges, as by a setuid program, which the kernel requires for restrictions."""
    if ctypes.CDLL(None, use_errno=True).prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "no_new_privs is refused")


def _call(number: int, *arguments: object) -> int:
    result = ctypes.CDLL(None, use_errno=True).syscall(number, *arguments)
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return result
