"""A filter of system calls, by which a Linux process gives up the network and other processes, with its children.

The filter is a program of classic BPF over `struct seccomp_data`: see seccomp(2) and linux/seccomp.h. It assumes that
the process runs code of an attacker, and refuses what neither mjrun nor an encoder or a driver needs: sockets, other
processes, metadata of files, which Landlock does not cover, input of the terminal, and rare interfaces of the kernel.
Calls newer than its lists do not exist for the process.
"""

import ctypes
import errno
import os
import platform
import socket
import struct
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from typing import NamedTuple

from mjrun.confinement.landlock import give_up_privileges

LOAD, JUMP_IF_EQUAL, JUMP_IF_AT_LEAST, AND, RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
NUMBER, ARCHITECTURE, ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data
ALLOW, ASK, KILL = 0x7FFF0000, 0x7FC00000, 0x80000000
REFUSE, UNKNOWN = 0x00050000 | errno.EACCES, 0x00050000 | errno.ENOSYS
NEWEST = 462  # the last known call, mseal; the numbers of x32 begin far beyond
SET_SECCOMP, FILTER = 22, 2  # of prctl
SECCOMP, SET_FILTER, NEW_LISTENER = (317, 277), 1, 1 << 3  # the call that makes a filter which asks
WHOLE = 0xFFFFFFFF  # the lower half of an argument; the kernel ignores the upper half of those below
SOCKET_TYPE = 0xF  # the bits of a socket's type without its flags
AF_UNIX, O_ACCMODE = 1, 3  # not known to Python on every system

# The kernel's identifier of each machine, and its index in the pairs of numbers below.
MACHINES = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}

# Numbers of system calls on x86-64 and 64-bit ARM; None if the call does not exist.
Numbers = Mapping[str, tuple[int | None, int | None]]
METADATA: Numbers = {
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "getxattr": (191, 8),
    "lgetxattr": (192, 9),
    "fgetxattr": (193, 10),
    "listxattr": (194, 11),
    "llistxattr": (195, 12),
    "flistxattr": (196, 13),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "truncate": (76, 45),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
    "fanotify_init": (300, 262),
    "fanotify_mark": (301, 263),
    "inotify_init": (253, None),
    "inotify_init1": (294, 26),
    "inotify_add_watch": (254, 27),
    "quotactl": (179, 60),
    "quotactl_fd": (443, 443),
}
PROCESSES: Numbers = {
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "process_madvise": (440, 440),
    "process_mrelease": (448, 448),
    "kcmp": (312, 272),
    "pidfd_open": (434, 434),
    "pidfd_send_signal": (424, 424),
    "pidfd_getfd": (438, 438),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "migrate_pages": (256, 238),
    "move_pages": (279, 239),
    "ioprio_set": (251, 30),
    "unshare": (272, 97),
    "setns": (308, 268),
    # Shared memory, queues and keys, which unrelated processes of the same user share.
    "shmget": (29, 194),
    "shmat": (30, 196),
    "shmctl": (31, 195),
    "semget": (64, 190),
    "semop": (65, 193),
    "semctl": (66, 191),
    "semtimedop": (220, 192),
    "msgget": (68, 186),
    "msgsnd": (69, 189),
    "msgrcv": (70, 188),
    "msgctl": (71, 187),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
}
KERNEL: Numbers = {
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "swapon": (167, 224),
    "swapoff": (168, 225),
    "reboot": (169, 142),
    "sethostname": (170, 161),
    "setdomainname": (171, 162),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "clock_adjtime": (305, 266),
    "adjtimex": (159, 171),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "kexec_load": (246, 104),
    "kexec_file_load": (320, 294),
    "acct": (163, 89),
    "syslog": (103, 116),
    "vhangup": (153, 58),
    "iopl": (172, None),
    "ioperm": (173, None),
    "modify_ldt": (154, None),
    "lookup_dcookie": (212, 18),
    "uselib": (134, None),
}
SERVING: Numbers = {"bind": (49, 200), "listen": (50, 201), "accept": (43, 202), "accept4": (288, 242)}
CONNECTING: Numbers = {"connect": (42, 203)}
# Calls that libraries replace by older ones on kernels without them: io_uring opens sockets and files unseen, and
# the arguments of the others are in memory, where a filter cannot see them.
UNSEEN: Numbers = {
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    "clone3": (435, 435),
    "openat2": (437, 437),
}


class _ArgumentVerdict(Enum):
    """The result if an argument has one of some values; `REQUIRE` continues then, and refuses all other values."""

    ALLOW = ALLOW
    REFUSE = REFUSE
    REQUIRE = 0


class _ArgumentCheck(NamedTuple):
    """A check of an argument of a system call, by its lower 32 bits. If no check decides, the call is allowed."""

    argument: int
    mask: int
    values: Sequence[int]
    verdict: _ArgumentVerdict


SELF = _ArgumentCheck(0, WHOLE, (0,), _ArgumentVerdict.REQUIRE)  # the calling process, not another one by its number
NAMESPACES = 0x7E020000  # the flags of clone for new namespaces
FAST_OPEN = 0x20000000  # the flag of a message that connects
# Terminal requests (of type T) that change nothing; the others change the terminal, or type into it.
TERMINAL = (0x5401, 0x802C542A, 0x5413, 0x540F, 0x5411, 0x541B, 0x5421, 0x5450, 0x5451)
# Types of requests: all requests of terminals, and those by which file systems change attributes, labels and versions.
TYPES = (0x5400, 0x6600, 0x5800, 0x7600, 0x9400)
CONSOLE = (0x4B00, 0x5600)  # requests to the keyboard and the screen of the machine's console, without their last byte
OWNERS = (0x8901, 0x8902)  # requests that redirect the signals of a descriptor to a process
SET_OWNER = (8, 15)  # the same with fcntl

# Calls that are allowed with some arguments only.
CHECKED: Mapping[str, tuple[tuple[int | None, int | None], Sequence[_ArgumentCheck]]] = {
    "ioctl": (
        (16, 29),
        (
            _ArgumentCheck(1, WHOLE, TERMINAL, _ArgumentVerdict.ALLOW),
            _ArgumentCheck(1, 0xFF00, TYPES, _ArgumentVerdict.REFUSE),
            _ArgumentCheck(1, 0xFFFFFF00, CONSOLE, _ArgumentVerdict.REFUSE),
            _ArgumentCheck(1, WHOLE, OWNERS, _ArgumentVerdict.REFUSE),
        ),
    ),
    "fcntl": ((72, 25), (_ArgumentCheck(1, WHOLE, SET_OWNER, _ArgumentVerdict.REFUSE),)),
    # Two sockets that are connected to each other permanently; datagram sockets could be connected elsewhere.
    "socketpair": (
        (53, 199),
        (
            _ArgumentCheck(0, WHOLE, (AF_UNIX,), _ArgumentVerdict.REQUIRE),
            _ArgumentCheck(1, SOCKET_TYPE, (socket.SOCK_STREAM, socket.SOCK_SEQPACKET), _ArgumentVerdict.REQUIRE),
        ),
    ),
    "sendto": ((44, 206), (_ArgumentCheck(3, FAST_OPEN, (FAST_OPEN,), _ArgumentVerdict.REFUSE),)),
    "sendmsg": ((46, 211), (_ArgumentCheck(2, FAST_OPEN, (FAST_OPEN,), _ArgumentVerdict.REFUSE),)),
    "sendmmsg": ((307, 269), (_ArgumentCheck(3, FAST_OPEN, (FAST_OPEN,), _ArgumentVerdict.REFUSE),)),
    # The caller's process group, which may be that of a shell's script, and all processes.
    "kill": ((62, 129), (_ArgumentCheck(0, WHOLE, (0, WHOLE), _ArgumentVerdict.REFUSE),)),
    "clone": ((56, 220), (_ArgumentCheck(0, NAMESPACES, (0,), _ArgumentVerdict.REQUIRE),)),
    "prlimit64": ((302, 261), (SELF,)),
    "setpriority": ((141, 140), (SELF, _ArgumentCheck(1, WHOLE, (0,), _ArgumentVerdict.REQUIRE))),
    "sched_setaffinity": ((203, 122), (SELF,)),
    "sched_setattr": ((314, 274), (SELF,)),
    "sched_setparam": ((142, 118), (SELF,)),
    "sched_setscheduler": ((144, 119), (SELF,)),
    # A file opened for reading and truncated, which Landlock allows before version 3.
    "open": ((2, None), (_ArgumentCheck(1, os.O_TRUNC | O_ACCMODE, (os.O_TRUNC,), _ArgumentVerdict.REFUSE),)),
    "openat": ((257, 56), (_ArgumentCheck(2, os.O_TRUNC | O_ACCMODE, (os.O_TRUNC,), _ArgumentVerdict.REFUSE),)),
}
SOCKET = (41, 198)
OF_TCP = (
    _ArgumentCheck(0, WHOLE, (socket.AF_INET, socket.AF_INET6), _ArgumentVerdict.REQUIRE),
    _ArgumentCheck(1, SOCKET_TYPE, (socket.SOCK_STREAM,), _ArgumentVerdict.REQUIRE),
    _ArgumentCheck(2, WHOLE, (0, socket.IPPROTO_TCP), _ArgumentVerdict.REQUIRE),
)


class BpfProgram(ctypes.Structure):
    """A program of classic BPF, in the form that the kernel expects."""

    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


_Step = tuple[int, int, int, int]  # operation, steps to skip if it holds, steps to skip if not, value


def is_known() -> bool:
    """Returns whether a filter exists for this machine."""
    return platform.system() == "Linux" and platform.machine() in MACHINES


def restrict(*, serves: bool = False) -> int | None:
    """Restricts this process, and everything it starts from now on, to the calls that the filter allows.

    Args:
      serves: whether it may open TCP sockets and accept connections. The filter then asks about each `connect`.

    Returns:
      The descriptor by which it asks; None if it does not.

    Raises:
      OSError: the kernel refuses the filter.
    """
    library = ctypes.CDLL(None, use_errno=True)
    machine = platform.machine()
    give_up_privileges()
    if serves:
        asking = _assembled(program(machine, serves=True))
        listener = library.syscall(SECCOMP[MACHINES[machine][1]], SET_FILTER, NEW_LISTENER, ctypes.byref(asking))
        if listener >= 0:
            return listener
    made = _assembled(program(machine, serves=serves, asks=False))  # for kernels that cannot ask, before Linux 5.0
    if library.prctl(SET_SECCOMP, FILTER, ctypes.byref(made), 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return None


def _assembled(steps: Iterable[_Step]) -> BpfProgram:
    code = b"".join(struct.pack("HBBI", *step) for step in steps)
    return BpfProgram(len(code) // 8, code)


def program(machine: str, *, serves: bool = False, asks: bool = True) -> list[_Step]:
    """Returns the steps of the filter for a machine of `MACHINES`.

    Args:
      serves: as in `restrict`.
      asks: whether it asks about `connect`, if it serves, instead of refusing it.
    """
    architecture, column = MACHINES[machine]
    steps: list[_Step] = [
        (LOAD, 0, 0, ARCHITECTURE),
        (JUMP_IF_EQUAL, 1, 0, architecture),
        (RETURN, 0, 0, KILL),  # calls of another architecture, such as 32 bits, would pass every comparison below
        (LOAD, 0, 0, NUMBER),
        (JUMP_IF_AT_LEAST, 0, 1, NEWEST + 1),
        (RETURN, 0, 0, UNKNOWN),
    ]
    refused = [METADATA, PROCESSES, KERNEL, *([] if serves else [SERVING, {"socket": SOCKET}])]
    connecting = ASK if serves and asks else REFUSE
    for result, calls in ((REFUSE, refused), (UNKNOWN, [UNSEEN]), (connecting, [CONNECTING])):
        for numbers in (numbers for each in calls for numbers in each.values()):
            steps += _rule(numbers[column], [(RETURN, 0, 0, result)])
    for numbers, checks in (*CHECKED.values(), *([(SOCKET, OF_TCP)] if serves else [])):
        steps += _rule(numbers[column], _checked(checks))
    return [*steps, (RETURN, 0, 0, ALLOW)]


def _rule(number: int | None, body: Sequence[_Step]) -> list[_Step]:
    """Returns the steps that judge the call of a number, and ignore all others."""
    return [] if number is None else [(JUMP_IF_EQUAL, 0, len(body), number), *body]


def _checked(checks: Iterable[_ArgumentCheck]) -> list[_Step]:
    steps: list[_Step] = []
    for argument, mask, values, verdict in checks:
        steps += [(LOAD, 0, 0, ARGUMENTS + 8 * argument), (AND, 0, 0, mask)]
        if verdict is _ArgumentVerdict.REQUIRE:
            steps += [(JUMP_IF_EQUAL, len(values) - place, 0, value) for place, value in enumerate(values)]
            steps += [(RETURN, 0, 0, REFUSE)]
        else:
            last = len(values) - 1
            steps += [(JUMP_IF_EQUAL, last - place, place == last, value) for place, value in enumerate(values)]
            steps += [(RETURN, 0, 0, verdict.value)]
    return [*steps, (RETURN, 0, 0, ALLOW)]
