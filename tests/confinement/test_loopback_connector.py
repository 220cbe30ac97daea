"""A process whose `connect` is answered by a connector reaches its own port alone, whatever address it names."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from mjrun.confinement import seccomp

pytestmark = pytest.mark.skipif(not seccomp.is_known(), reason="there is no filter for this machine")

TRY = """
import os, socket, sys, threading, time
from mjrun.confinement import loopback_connector, seccomp
free = socket.socket()
free.bind(("127.0.0.1", 0))
free.listen()
elsewhere = free.getsockname()
made = loopback_connector.LoopbackConnector()
helper = int(open(f"/proc/self/task/{os.getpid()}/children").read())
own = made.bound.getsockname()
made.listen(seccomp.restrict(serves=True))

def reached(address, kind=socket.SOCK_STREAM):
    asking = socket.socket()
    number = asking.fileno()
    try:
        asking.connect(address)
    except OSError as error:
        return type(error).__name__
    assert asking.fileno() == number
    return asking.getpeername()

assert reached(elsewhere) == "ConnectionRefusedError"  # nobody listens at the own port
made.bound.listen()
for address in (own, elsewhere, ("203.0.113.1", 80)):
    assert reached(address) == own, address
free.setblocking(False)
try:
    free.accept()
    print("reached another")
except BlockingIOError:
    pass

# What is sent arrives, also from a thread and from a process that is started.
asking = socket.socket()
thread = threading.Thread(target=asking.connect, args=(elsewhere,))
thread.start()
thread.join()
for _ in range(4):
    other, _ = made.bound.accept()
asking.send(b"hello")
assert other.recv(9) == b"hello"
assert asking.gettimeout() is None and not os.get_blocking(asking.fileno())
if not os.fork():
    os._exit(reached(elsewhere) != own)
assert os.wait()[1] == 0
print(helper)
"""


def test_it_connects_to_the_own_port_whatever_is_asked_and_ends_with_the_process() -> None:
    done = subprocess.run([sys.executable, "-c", TRY], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    line, deadline = Path(f"/proc/{int(done.stdout)}/cmdline"), time.monotonic() + 60
    while line.exists() and line.read_bytes():  # which no process has that has ended
        assert time.monotonic() < deadline
        time.sleep(0.01)
