"""What a browser does with Studio's page, as far as tests need it: it takes control, and receives states."""

import json
import struct
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from websockets.sync.client import ClientConnection, connect

LIMIT = 60.0  # [s] for whatever is waited for
# NetImgui's first command: its size, its type, the client's name, and versions, which the viewer does not refuse.
VERSION = struct.pack("<IBxxx64s16s16sIIIB3x", 120, 0, b"test", b"1.92.9b", b"1.13.0", 18, 19291, 11300, 2)


def wait_for_page(port: int, running: Callable[[], bool]) -> bytes:
    """The page, once it is served; `running` is called to see whether that can still happen."""
    end = time.monotonic() + LIMIT
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=LIMIT) as page:
                return page.read()
        except OSError:
            assert time.monotonic() < end
            assert running(), "it ended"
            time.sleep(0.1)


def model_bytes(port: int) -> int:
    """The size of the model that the page loads."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/model?total_bytes", timeout=LIMIT) as answer:
        return json.load(answer)["total_bytes"]


@contextmanager
def browser(port: int) -> Iterator[ClientConnection]:
    """The connection that states come over, of a page that is in control."""
    address = f"ws://127.0.0.1:{port}"
    with connect(f"{address}/ui?sid=test", max_size=None) as control:
        control.send(VERSION)
        assert len(control.recv(timeout=LIMIT)) == len(VERSION)
        with connect(f"{address}/state?sid=test", max_size=None) as states:
            yield states


def payloads(states: ClientConnection) -> Iterator[bytes]:
    """The states that come, each with what the page needs besides."""
    while True:
        message = states.recv(timeout=LIMIT)
        if isinstance(message, bytes):
            states.send("state_ack")
            yield message
