"""Runs a command as on a kernel without Landlock: a filter answers its system calls as such a kernel does."""

import ctypes
import errno
import os
import struct
import sys

from mjrun.confinement import landlock
from mjrun.confinement.seccomp import (
    ALLOW,
    FILTER,
    JUMP_IF_EQUAL,
    LOAD,
    NO_NEW_PRIVILEGES,
    NUMBER,
    RETURN,
    SET_SECCOMP,
    Program,
)

UNKNOWN = 0x00050000 | errno.ENOSYS


def main() -> None:
    steps = [
        (LOAD, 0, 0, NUMBER),
        (JUMP_IF_EQUAL, 0, 1, landlock.CREATE_RULESET),
        (RETURN, 0, 0, UNKNOWN),
        (RETURN, 0, 0, ALLOW),
    ]
    program = Program(len(steps), b"".join(struct.pack("HBBI", *step) for step in steps))
    library = ctypes.CDLL(None, use_errno=True)
    library.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    if library.prctl(SET_SECCOMP, FILTER, ctypes.byref(program), 0, 0):
        raise OSError(ctypes.get_errno(), "seccomp")
    os.execv(sys.argv[1], sys.argv[1:])


if __name__ == "__main__":
    main()
