"""The filter refuses what an attacker would call; as a program, and in processes of their own, as it is for good."""

import ctypes
import errno
import mmap
import platform
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.confinement import seccomp

ALLOWED, REFUSED, UNKNOWN, KILLED, ASKED = "allowed", "refused", "unknown", "killed", "asked"
# What the kernel calls machines, and the headers that number their calls, where they are installed.
ARCHITECTURES = {"x86_64": 0xC000003E, "i386": 0x40000003, "aarch64": 0xC00000B7, "arm": 0x40000028}
HEADERS = {
    "x86_64": Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h"),
    "aarch64": Path("/usr/include/asm-generic/unistd.h"),
}
HIGH = 0xABCD0000_00000000  # what the kernel ignores of an argument of 32 bits

# Calls with their arguments, and what follows with and without a server. The numbers: x86-64, 64-bit ARM.
CALLS: tuple[tuple[str, tuple[int | None, int | None], tuple[int, ...], str, str], ...] = (
    ("read", (0, 63), (), ALLOWED, ALLOWED),
    ("mseal", (462, 462), (), ALLOWED, ALLOWED),
    ("setxattrat", (463, 463), (), UNKNOWN, UNKNOWN),
    ("file_setattr", (469, 469), (), UNKNOWN, UNKNOWN),
    ("a call of the future", (5000, 5000), (), UNKNOWN, UNKNOWN),
    ("read of x32", (0x40000000, None), (), UNKNOWN, UNKNOWN),
    ("chmod of x32", (0x40000000 + 90, None), (), UNKNOWN, UNKNOWN),
    ("clone3", (435, 435), (), UNKNOWN, UNKNOWN),
    ("io_uring_setup", (425, 425), (), UNKNOWN, UNKNOWN),
    ("ptrace", (101, 117), (), REFUSED, REFUSED),
    ("fchmodat2", (452, 452), (), REFUSED, REFUSED),
    ("utimensat", (280, 88), (), REFUSED, REFUSED),
    ("socket, Unix", (41, 198), (socket.AF_UNIX, 1, 0), REFUSED, REFUSED),
    ("socket, TCP", (41, 198), (socket.AF_INET, 1, 0), REFUSED, ALLOWED),
    ("socket, TCP by name", (41, 198), (socket.AF_INET6, 0o2004001, 6), REFUSED, ALLOWED),
    ("socket, TCP with high bits", (41, 198), (HIGH | socket.AF_INET, HIGH | 1, HIGH), REFUSED, ALLOWED),
    ("socket, UDP", (41, 198), (socket.AF_INET, 2, 0), REFUSED, REFUSED),
    ("socket, MPTCP", (41, 198), (socket.AF_INET, 1, 262), REFUSED, REFUSED),
    ("socket, SCTP", (41, 198), (socket.AF_INET, 1, 132), REFUSED, REFUSED),
    ("socket, netlink", (41, 198), (16, 3, 0), REFUSED, REFUSED),
    ("listen", (50, 201), (3, 1), REFUSED, ALLOWED),
    ("connect", (42, 203), (3, 1), REFUSED, ASKED),
    ("socketpair, stream", (53, 199), (1, 1), ALLOWED, ALLOWED),
    ("socketpair, packets", (53, 199), (1, 0o2004005), ALLOWED, ALLOWED),
    ("socketpair, datagrams", (53, 199), (1, 2), REFUSED, REFUSED),
    ("socketpair, TIPC", (53, 199), (30, 1), REFUSED, REFUSED),
    ("sendto", (44, 206), (3, 1, 1, 0x4000), ALLOWED, ALLOWED),
    ("sendto that connects", (44, 206), (3, 1, 1, 0x20004000), REFUSED, REFUSED),
    ("sendmsg that connects", (46, 211), (3, 1, HIGH | 0x20000000), REFUSED, REFUSED),
    ("sendmmsg that connects", (307, 269), (3, 1, 1, 0x20000000), REFUSED, REFUSED),
    ("TCGETS", (16, 29), (0, 0x5401), ALLOWED, ALLOWED),
    ("TIOCGWINSZ", (16, 29), (0, HIGH | 0x5413), ALLOWED, ALLOWED),
    ("TIOCSTI", (16, 29), (0, 0x5412), REFUSED, REFUSED),
    ("TIOCSTI with high bits", (16, 29), (0, HIGH | 0x5412), REFUSED, REFUSED),
    ("TIOCLINUX", (16, 29), (0, 0x541C), REFUSED, REFUSED),
    ("TIOCLINUX with high bits", (16, 29), (0, 1 << 32 | 0x541C), REFUSED, REFUSED),
    ("TIOCSPGRP", (16, 29), (0, 0x5410), REFUSED, REFUSED),
    ("TCSETS", (16, 29), (0, 0x5402), REFUSED, REFUSED),
    ("TCSETS2", (16, 29), (0, 0x402C542B), REFUSED, REFUSED),
    ("KDSKBSENT", (16, 29), (0, 0x4B49), REFUSED, REFUSED),
    ("a request to a graphics card", (16, 29), (0, 0xC0106446), ALLOWED, ALLOWED),
    ("FS_IOC_SETFLAGS", (16, 29), (3, 0x40086602), REFUSED, REFUSED),
    ("FIOSETOWN", (16, 29), (3, 0x8901), REFUSED, REFUSED),
    ("F_GETFL", (72, 25), (3, 3), ALLOWED, ALLOWED),
    ("F_SETOWN", (72, 25), (3, 8), REFUSED, REFUSED),
    ("F_SETOWN_EX", (72, 25), (3, HIGH | 15), REFUSED, REFUSED),
    ("fork", (56, 220), (signal.SIGCHLD,), ALLOWED, ALLOWED),
    ("a thread", (56, 220), (0x3D0F00,), ALLOWED, ALLOWED),
    *(
        (f"clone, {flag:#x}", (56, 220), (flag | 17,), REFUSED, REFUSED)
        for flag in (0x20000, *(1 << k for k in range(25, 31)))
    ),
    ("kill of a process", (62, 129), (4711, 9), ALLOWED, ALLOWED),  # which Landlock judges
    ("kill of a group", (62, 129), (2**32 - 4711, 9), ALLOWED, ALLOWED),
    ("kill of its own group", (62, 129), (HIGH, 9), REFUSED, REFUSED),
    ("kill of all", (62, 129), (2**32 - 1, 9), REFUSED, REFUSED),
    ("limits of itself", (302, 261), (0, 7), ALLOWED, ALLOWED),
    ("limits of another", (302, 261), (4711, 7), REFUSED, REFUSED),
    ("priority of itself", (141, 140), (0, 0, 19), ALLOWED, ALLOWED),
    ("priority of another", (141, 140), (0, 4711, 19), REFUSED, REFUSED),
    ("priority of a user", (141, 140), (2, 0, 19), REFUSED, REFUSED),
    ("cores of another", (203, 122), (4711, 8, 0), REFUSED, REFUSED),
    ("open", (2, None), (0, 0o102), ALLOWED, ALLOWED),
    ("open to write and cut", (257, 56), (0, 0, 0o1102), ALLOWED, ALLOWED),
    ("open to read and cut", (257, 56), (0, 0, HIGH | 0o1000), REFUSED, REFUSED),
    ("open to read and cut, by open", (2, None), (0, 0o1000), REFUSED, REFUSED),
)


def judged(machine: str, architecture: str, number: int, arguments: tuple[int, ...], *, serves: bool) -> str:
    """What the kernel's machine for these programs comes to: bpf(4), with the data of seccomp(2) as 16 words."""
    words = [number, ARCHITECTURES[architecture], 0, 0]
    for argument in (*arguments, *[0] * 6)[:6]:
        words += [argument & 0xFFFFFFFF, argument >> 32]
    steps, place, accumulator = seccomp.program(machine, serves=serves), 0, 0
    while True:
        operation, if_so, if_not, value = steps[place]
        place += 1
        if operation == 0x20:
            accumulator = words[value // 4]
        elif operation == 0x54:
            accumulator &= value
        elif operation == 0x15:
            place += if_so if accumulator == value else if_not
        elif operation == 0x35:
            place += if_so if accumulator >= value else if_not
        else:
            assert operation == 0x06
            results = {0x7FFF0000: ALLOWED, 0x50000 + errno.EACCES: REFUSED, 0x50000 + errno.ENOSYS: UNKNOWN}
            return {**results, 0x80000000: KILLED, 0x7FC00000: ASKED}[value]


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
@pytest.mark.parametrize(("name", "numbers", "arguments", "alone", "serving"), CALLS, ids=[call[0] for call in CALLS])
def test_the_filter_judges_calls_by_what_the_kernel_reads_of_them(
    machine: str,
    name: str,
    numbers: tuple[int | None, int | None],
    arguments: tuple[int, ...],
    alone: str,
    serving: str,
) -> None:
    number = numbers[machine == "aarch64"]
    if number is None:  # the machine has no such call
        return
    assert judged(machine, machine, number, arguments, serves=False) == alone
    assert judged(machine, machine, number, arguments, serves=True) == serving


@pytest.mark.parametrize(("machine", "other"), [("x86_64", "i386"), ("x86_64", "aarch64"), ("aarch64", "arm")])
def test_calls_with_the_numbers_of_another_machine_kill(machine: str, other: str) -> None:
    assert {judged(machine, other, number, (), serves=False) for number in range(500)} == {KILLED}


@pytest.mark.parametrize("machine", HEADERS)
def test_numbers_are_those_of_the_kernels_headers(machine: str) -> None:
    if not HEADERS[machine].exists():
        pytest.skip("the kernel's headers are not installed")
    text = HEADERS[machine].read_text()
    known = {name: int(n) for name, n in re.findall(r"#define __NR(?:3264)?_(\w+)\s+(\d+)\s*$", text, re.MULTILINE)}
    tables = (seccomp.METADATA, seccomp.PROCESSES, seccomp.KERNEL, seccomp.SERVING, seccomp.CONNECTING, seccomp.UNSEEN)
    ours = {name: numbers for table in tables for name, numbers in table.items()}
    ours |= {name: numbers for name, (numbers, _) in seccomp.CHECKED.items()}
    assert len(ours) > 100
    latest = max(known.values())
    for name, numbers in ours.items():
        number = numbers[machine == "aarch64"]
        if number is None or number <= latest:
            assert known.get(name) == number, name


def test_jumps_stay_within_the_program() -> None:
    for machine in seccomp.MACHINES:
        for serves in (False, True):
            steps = seccomp.program(machine, serves=serves)
            assert len(steps) <= 4096  # the kernel's limit
            for place, (operation, *jumps, _) in enumerate(steps, 1):
                assert operation == 0x06 or all(0 <= jump < 256 and place + jump < len(steps) for jump in jumps)


NEEDS_FILTER = pytest.mark.skipif(not seccomp.is_known(), reason="there is no filter for this machine")
TRY = """
import socket, sys
from mjrun.confinement.seccomp import restrict
restrict(serves=sys.argv[1] == "serves")
def can(family, kind):
    try:
        socket.socket(family, kind).close()
    except PermissionError:
        return "-"
    return "+"
socket.socketpair()
print(*(can(*each) for each in (
    (socket.AF_UNIX, socket.SOCK_STREAM),
    (socket.AF_INET, socket.SOCK_STREAM),
    (socket.AF_INET6, socket.SOCK_STREAM | socket.SOCK_NONBLOCK),
    (socket.AF_INET, socket.SOCK_DGRAM),
    (socket.AF_NETLINK, socket.SOCK_RAW),
    (socket.AF_VSOCK, socket.SOCK_STREAM),
)))
import subprocess, threading
thread = threading.Thread(target=print, args=("thread",))
thread.start()
thread.join()
code = "import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM)"
print(subprocess.run([sys.executable, "-S", "-c", code], capture_output=True).returncode)
"""


@NEEDS_FILTER
@pytest.mark.parametrize(("mode", "sockets"), [("none", "- - - - - -"), ("serves", "- + + - - -")])
def test_a_process_opens_no_socket_but_starts_threads_and_others_that_open_none(mode: str, sockets: str) -> None:
    done = subprocess.run([sys.executable, "-c", TRY, mode], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:3] == [sockets, "thread", "1"]


# Machine code that asks for the number of its process by the interface of 32 bits: mov eax, 20; int 0x80; ret.
OF_32_BITS = bytes.fromhex("b814000000cd80c3")


def call_32_bits() -> int:
    """What the interface of 32 bits answers to getpid."""
    memory = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    memory.write(OF_32_BITS)
    return ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(memory)))()


@NEEDS_FILTER
@pytest.mark.skipif(platform.machine() != "x86_64", reason="the machine code is that of x86-64")
def test_a_process_that_calls_by_the_interface_of_32_bits_is_killed() -> None:
    code = f"""
import sys
sys.path[:0] = {sys.path!r}
from mjrun.confinement.seccomp import restrict
from tests.confinement.test_seccomp import call_32_bits
restrict()
print(call_32_bits())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[2])
    assert (done.returncode, done.stdout) == (-signal.SIGSYS, "")
