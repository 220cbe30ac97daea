"""Capabilities, the parts of a superuser's power, which a process of Linux gives up for itself and its children.

There is no wrapper of these system calls in Python's library. See capabilities(7) and linux/capability.h.
"""

import ctypes
import os
import sys

DAC_OVERRIDE, DAC_READ_SEARCH, FOWNER = 1, 2, 3
KEPT = 1 << DAC_OVERRIDE | 1 << DAC_READ_SEARCH | 1 << FOWNER  # to use files of other owners, where Landlock lets it
VERSION = 0x20080522
LAST = 63
BOUNDING_DROP = 24  # of prctl


class _Header(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))


class _Sets(ctypes.Structure):
    """The capabilities from 0 to 31, and those from 32 on."""

    _fields_ = (("effective", ctypes.c_uint32), ("permitted", ctypes.c_uint32), ("inheritable", ctypes.c_uint32))


def drop() -> None:
    """Gives up all capabilities but those on files, if this process has any.

    Raises:
      OSError: it cannot.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None, use_errno=True)
    header, sets = _Header(VERSION, 0), (_Sets * 2)()
    if library.capget(ctypes.byref(header), sets):
        raise OSError(ctypes.get_errno(), "the capabilities of this process are not known")
    if not any(each.permitted for each in sets):
        return
    for number in range(LAST + 1):
        if not KEPT >> number & 1:
            library.prctl(BOUNDING_DROP, number, 0, 0, 0)  # which is refused to who may not, and of those that are none
    for place, each in enumerate(sets):
        lasting = KEPT >> 32 * place
        each.effective &= lasting
        each.permitted &= lasting
        each.inheritable &= lasting  # and the ambient ones with them
    if library.capset(ctypes.byref(header), sets):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
