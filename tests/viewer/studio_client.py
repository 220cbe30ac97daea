"""What a browser does with Studio's page, as far as tests need it: it takes control, and receives states."""

import json
import re
import struct
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager

from websockets.sync.client import ClientConnection, connect

from tests.processes import PATIENCE

LIMIT = float(PATIENCE)  # [s] for whatever is waited for
# NetImgui's first command: its size, its type, the client's name, and versions, which the viewer does not refuse.
VERSION = struct.pack("<IBxxx64s16s16sIIIB3x", 120, 0, b"test", b"1.92.9b", b"1.13.0", 18, 19291, 11300, 2)


def address(line: str) -> str:
    """The address of the page in a line that mjrun has printed."""
    match = re.search(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{43}\b", line)
    assert match, line
    return match[0]


class Page:
    """The page at an address, opened as browsers do: the token in the address becomes a cookie."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._root = url.partition("?")[0]
        with urllib.request.urlopen(url, timeout=LIMIT) as answer:
            self.content: bytes = answer.read()
            self.headers = answer.headers
        self.cookie = str(self.headers["Set-Cookie"]).partition(";")[0]

    def get(self, path: str) -> bytes:
        """What the page loads from a path."""
        request = urllib.request.Request(f"{self._root}{path}", headers={"Cookie": self.cookie})
        with urllib.request.urlopen(request, timeout=LIMIT) as answer:
            return answer.read()

    def connect(self, path: str) -> ClientConnection:
        """A connection that the page opens."""
        url = f"{self._root}{path}".replace("http://", "ws://")
        return connect(url, max_size=None, additional_headers={"Cookie": self.cookie})


def model_bytes(page: Page) -> int:
    """The size of the model that the page loads."""
    return json.loads(page.get("model?total_bytes"))["total_bytes"]


@contextmanager
def browser(page: Page) -> Iterator[ClientConnection]:
    """The connection that states come over, of a page that is in control."""
    with page.connect("ui?sid=test") as control:
        control.send(VERSION)
        assert len(control.recv(timeout=LIMIT)) == len(VERSION)
        with page.connect("state?sid=test") as states:
            yield states


def payloads(states: ClientConnection) -> Iterator[bytes]:
    """The states that come, each with what the page needs besides."""
    while True:
        message = states.recv(timeout=LIMIT)
        if isinstance(message, bytes):
            states.send("state_ack")
            yield message
