"""A process finds and ends all that its children have started, however far they went from it."""

import subprocess
import sys

import pytest

from tests.processes import PATIENCE, command_line_of, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives orphans to an ancestor")

TRY = """
import os, signal, sys, time
from pathlib import Path
from mjrun.cli import crash_monitor
listed = sys.argv[1]
if listed == "scanned":  # as on a kernel that does not list children
    read = Path.read_text
    def read_text(path, *arguments, **settings):
        if path.name == "children":
            raise FileNotFoundError
        return read(path, *arguments, **settings)
    Path.read_text = read_text
crash_monitor.PURSUIT = end = 600  # a busy machine may take longer than usual
end += time.monotonic()
crash_monitor.adopt_descendants()
into, out = os.pipe()
def daemon(depth):
    if os.fork() == 0:
        os.setsid()
        if depth:
            daemon(depth - 1)
            os._exit(0)
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        os.write(out, f"{os.getpid()} ".encode())
        time.sleep(1000)
for depth in range(6):
    daemon(depth)
chain = os.fork()
if not chain:
    while time.monotonic() < end:  # each link of the chain starts the next one and ends; none stays if it escapes
        if os.fork():
            break
        if listed == "scanned":
            time.sleep(.02)  # about as long as a scan on a busy machine, in which faster links escape for seconds
    os._exit(0)
pids = ""
while len(pids.split()) < 6:
    pids += os.read(into, 1000).decode()
crash_monitor.kill_descendants()
print(pids)
print(crash_monitor._children())
"""


@pytest.mark.parametrize("how", ["listed", "scanned"])
def test_daemons_and_chains_of_forks_are_killed(how: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", TRY, how], capture_output=True, text=True, check=True, timeout=PATIENCE
    )
    pids, children = done.stdout.splitlines()
    assert children == "[]"
    for pid in pids.split():
        wait_until(lambda pid=pid: not command_line_of(int(pid)))
