"""`mjrun view`, driven for real: under Xvfb, and by a client that speaks to its page as a browser does."""

import json
import re
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Command
from tests.processes import children, worker
from tests.viewer.studio_client import LIMIT, Page, address, browser, model_bytes, payloads

ALONE = {"HOME": "/nonexistent"}  # nothing is read from there or written to it


@pytest.fixture
def port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def ended(child: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Its exit code and its messages."""
    _, messages = child.communicate(timeout=LIMIT)
    return child.returncode, messages.decode()


def wait_until(condition: Callable[[], bool], child: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + LIMIT
    while not condition():
        assert child.poll() is None, ended(child)
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.gl
def test_in_a_window_it_records_what_trace_records(
    mjrun: Command,
    swing: Path,
    display: dict[str, str],
) -> None:
    done = mjrun("view", swing, "--duration", "0.2", "--recording", "seen.npz", "--json", env=display)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["kind"], result["steps"], result["states"]) == ("window", 100, 101)
    assert mjrun("trace", swing, "--duration", "0.2", "-o", "t.csv", "--recording", "bare.npz").returncode == 0
    seen, bare = (np.load(mjrun.folder / name)["states"] for name in ("seen.npz", "bare.npz"))
    assert seen.tobytes() == bare.tobytes()


@pytest.mark.slow
@pytest.mark.gl
def test_a_signal_ends_it_and_keeps_the_recording(mjrun: Command, swing: Path, display: dict[str, str]) -> None:
    child = mjrun.start("view", swing, "--recording", "seen.npz", env=display)
    wait_until(lambda: any(path.stat().st_size > 20_000 for path in mjrun.folder.iterdir()), child)  # it records
    others = children(worker(child))
    child.send_signal(signal.SIGTERM)
    returncode, messages = ended(child)
    assert returncode == 143, messages
    assert others == []
    assert mjrun.files() == ["seen.npz"]
    assert mjrun("trace", swing, "--replay", "seen.npz", "-o", "t.csv").returncode == 0


@pytest.mark.parametrize("trust", [[], ["--untrusted"]], ids=["trusted", "untrusted"])
def test_in_a_browser_it_waits_for_one_and_sends_it_what_it_records(
    mjrun: Command,
    swing: Path,
    port: int,
    no_display: dict[str, str],
    trust: list[str],
) -> None:
    line = ("view", swing, "--port", str(port), "--recording", "seen.npz", *trust)
    child = mjrun.start(*line, env={**no_display, **ALONE})
    try:
        assert child.stderr
        for _ in trust:
            assert b"untrusted" in child.stderr.readline()
        first = child.stderr.readline().decode()
        page = Page(address(first))
        assert b"<canvas" in page.content
        assert model_bytes(page) > 1000
        assert listeners(worker(child)) == {"127.0.0.1"}
        with browser(page) as states:
            stream = payloads(states)
            seen = [next(stream) for _ in range(8)]
    finally:
        child.send_signal(signal.SIGINT)
        returncode, messages = ended(child)
    assert returncode == 130, messages
    assert re.search(rf"open http://127.0.0.1:{port}/\?token=\S+ in a browser on this machine", first)
    recorded = {row[1:9].tobytes() for row in np.load(mjrun.folder / "seen.npz")["states"]}
    assert all(any(positions in payload for positions in recorded) for payload in seen)
    assert mjrun.files() == ["seen.npz"]
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=1)


def test_its_address_is_printed_whatever_else_is_not(
    mjrun: Command, swing: Path, port: int, no_display: dict[str, str]
) -> None:
    child = mjrun.start("view", swing, "--port", str(port), "--quiet", env={**no_display, **ALONE})
    try:
        assert child.stderr
        page = Page(address(child.stderr.readline().decode()))
        assert b"<canvas" in page.content
        with page.connect("state?sid=test") as states:
            next(payloads(states))
    finally:
        child.send_signal(signal.SIGINT)
        assert ended(child)[0] == 130


def listeners(pid: int) -> set[str]:
    """The addresses that a process listens at, of both families, as the kernel tells."""
    links = [str(link.readlink()) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()]
    sockets = {link[8:-1] for link in links if link.startswith("socket:")}
    addresses: set[str] = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            local, state, inode = line.split()[1], line.split()[3], line.split()[9]
            if state == "0A" and inode in sockets:
                packed = bytes.fromhex(local.partition(":")[0])
                addresses.add(socket.inet_ntoa(packed[::-1]) if table == "tcp" else "of IPv6")
    return addresses


def test_without_a_display_it_goes_to_the_browser_unless_that_is_forbidden(
    mjrun: Command,
    swing: Path,
    no_display: dict[str, str],
) -> None:
    done = mjrun("view", swing, "--no-browser", "--recording", "seen.npz", env=no_display)
    assert done.returncode == 5
    assert b"neither DISPLAY nor WAYLAND_DISPLAY is set" in done.stderr
    assert mjrun.files() == []


def test_a_port_in_use_is_reported(mjrun: Command, swing: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        done = mjrun("view", swing, "--port", str(port))
    assert done.returncode == 2
    assert f"--port: {port} is not available: Address already in use".encode() in done.stderr


def test_what_is_wrong_is_reported_before_anything_opens(mjrun_here: Command, swing: Path) -> None:
    assert mjrun_here("view", swing, "--no-browser", "--port", "8080").returncode == 2
    assert mjrun_here("view", swing, "--speed", "0").returncode == 2
    assert mjrun_here("view", swing, "--recording", "seen.csv").returncode == 2
    assert mjrun_here("view", "nowhere.xml").returncode == 3
    assert mjrun_here("view", swing, "--recording", "/dev/null/seen.npz").returncode == 7
    assert mjrun_here.files() == []
