"""Capabilities, the parts of a superuser's privileges, which a Linux process drops for itself and its children.

Python's library does not wrap these system calls. See capabilities(7) and linux/capability.h.
"""

import ctypes
import os
import sys

DAC_OVERRIDE, DAC_READ_SEARCH, FOWNER = 1, 2, 3
KEPT = 1 << DAC_OVERRIDE | 1 << DAC_READ_SEARCH | 1 << FOWNER  # to use files of other owners, as far as Landlock allows
VERSION = 0x20080522
LAST = 63
BOUNDING_DROP = 24  # of prctl


class _Header(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))


class _Sets(ctypes.Structure):
    """The capabilities 0 to 31, and those from 32 on."""

    _fields_ = (("effective", ctypes.c_uint32), ("permitted", ctypes.c_uint32), ("inheritable", ctypes.c_uint32))


def drop() -> None:
    """Drops all capabilities of this process except those on files.

    Raises:
      OSError: they cannot be dropped.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None, use_errno=True)
    header, sets = _Header(VERSION, 0), (_Sets * 2)()
    if library.capget(ctypes.byref(header), sets):
        raise OSError(ctypes.get_errno(), "the capabilities of this process are unknown")
    if not any(each.permitted for each in sets):
        return
    for number in range(LAST + 1):
        if not KEPT >> number & 1:
            library.prctl(BOUNDING_DROP, number, 0, 0, 0)  # fails for unknown numbers, and without the privilege
    for place, each in enumerate(sets):
        lasting = KEPT >> 32 * place
        each.effective &= lasting
        each.permitted &= lasting
        each.inheritable &= lasting  # this removes the ambient ones, too
    if library.capset(ctypes.byref(header), sets):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
