"""The filter refuses the sockets of networks, and no others; in processes of their own, as nobody can lift it again."""

import subprocess
import sys

import pytest

from mjrun.confinement import seccomp

pytestmark = pytest.mark.skipif(not seccomp.is_known(), reason="there is no filter for this machine")

TRY = """
import socket, sys
from mjrun.confinement.seccomp import refuse_network
refuse_network(serves=sys.argv[1] == "serves")
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
import subprocess
code = "import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM)"
print(subprocess.run([sys.executable, "-S", "-c", code], capture_output=True).returncode)
"""


@pytest.mark.parametrize(("mode", "sockets"), [("none", "+ - - - - -"), ("serves", "+ + + - - -")])
def test_only_sockets_of_this_machine_are_opened(mode: str, sockets: str) -> None:
    done = subprocess.run([sys.executable, "-c", TRY, mode], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == [sockets, "1"]  # what it starts cannot either
