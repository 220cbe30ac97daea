"""A headless browser, driven over its DevTools protocol: https://chromedevtools.github.io/devtools-protocol."""

import base64
import contextlib
import io
import itertools
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from websockets.sync.client import ClientConnection, connect

from tests.processes import PATIENCE, wait_until

# scripts/setup.sh installs the first of them where all are missing.
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--no-zygote",
    "--disable-dev-shm-usage",  # which has 64 MB in many containers
    "--disable-gpu",
    "--use-angle=swiftshader",  # WebGL in software
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--remote-debugging-port=0",
)
STARTS = 5  # on a busy machine, a start of Chromium ends in a trap now and then
DOMAINS = ("Page", "Runtime", "Network", "Log")
FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))))"


class Tab:
    """A page in the browser.

    Attributes:
      requests: addresses of all requests.
      problems: errors, and messages of the console.
    """

    def __init__(self, connection: ClientConnection, size: tuple[int, int], dark: bool = False) -> None:
        self._connection, self._numbers = connection, itertools.count(1)
        self._session: str | None = None
        self.requests: list[str] = []
        self.problems: list[str] = []
        self._target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"]
        for domain in DOMAINS:
            self.call(f"{domain}.enable")
        self.resize(size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Calls a method of the protocol and returns its result; collects what happens meanwhile."""
        number = next(self._numbers)
        session = {} if self._session is None else {"sessionId": self._session}
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters, **session}))
        while True:
            message = json.loads(self._connection.recv(timeout=PATIENCE))
            if message.get("id") == number and message.get("sessionId") == self._session:
                assert "error" not in message, message
                return message["result"]
            self._note(message)

    def open(self, address: str) -> None:
        """Opens an address."""
        self.call("Page.navigate", url=address)

    def resize(self, size: tuple[int, int], mobile: bool = False) -> None:
        """Sets the size of the page [pixels]."""
        width, height = size
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        self.call("Emulation.setTouchEmulationEnabled", enabled=mobile)

    def evaluate(self, expression: str) -> Any:
        """Returns the value of an expression of JavaScript, which may be a promise."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str) -> None:
        """Waits until an expression of JavaScript is true."""
        for _ in range(100 * PATIENCE):
            if self.evaluate(f"new Promise(done => setTimeout(() => done(!!({expression})), 10))"):
                return
        raise AssertionError(f"{expression} stays false")

    def settle(self) -> None:
        """Waits until the page is drawn."""
        self.evaluate(FRAMES)

    def press(self, key: str) -> None:
        """Presses a key, by its name in KeyboardEvent.key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key)
        self.settle()

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drags with the left button."""
        for kind, (x, y), buttons in (("mousePressed", start, 1), ("mouseMoved", end, 1), ("mouseReleased", end, 0)):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)
        self.settle()

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Returns left, top, width and height of an element [pixels]."""
        box = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        left, top, width, height = self.evaluate(f"(({{x, y, width, height}}) => [x, y, width, height])({box})")
        return left, top, width, height

    def screenshot(self, selector: str) -> np.ndarray:
        """Returns the pixels of an element `(height, width, 3)`."""
        x, y, width, height = self.box(selector)
        clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
        image = base64.b64decode(self.call("Page.captureScreenshot", format="png", clip=clip)["data"])
        return np.array(Image.open(io.BytesIO(image)).convert("RGB"))

    def _note(self, message: dict[str, Any]) -> None:
        about = message.get("params", {})
        match message.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(about["request"]["url"])
            case "Runtime.exceptionThrown":
                self.problems.append(json.dumps(about["exceptionDetails"]))
            case "Runtime.consoleAPICalled":
                self.problems.append(json.dumps(about["args"]))
            case "Log.entryAdded" if "GPU stall due to ReadPixels" not in about["entry"]["text"]:  # by screenshots
                self.problems.append(about["entry"]["text"])
            case _:
                pass


@contextmanager
def browser(folder: Path) -> Iterator[ClientConnection]:
    """Starts a browser, with its profile in an empty folder, and connects to it.

    Raises:
      AssertionError: no browser is installed.
    """
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    assert program, f"no browser is installed, such as {BROWSERS[0]}: scripts/setup.sh installs it"
    process, place = _started(program, folder)
    try:
        port, path = place.read_text().split()
        with connect(f"ws://127.0.0.1:{port}{path}", max_size=None, ping_interval=None) as connection:
            yield connection
    finally:
        _end(process)


def _started(program: str, folder: Path) -> tuple["subprocess.Popen[bytes]", Path]:
    """Starts a browser, and returns it with the file of its port and path, each on a line."""
    endings = list[int]()
    while len(endings) < STARTS:
        profile = folder / str(len(endings))
        command = [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        place = profile / "DevToolsActivePort"
        try:
            wait_until(lambda: _is_written(place) or process.poll() is not None)  # noqa: B023 – at once
        except BaseException:
            _end(process)
            raise
        if _is_written(place):
            return process, place
        _end(process)
        endings.append(process.returncode)
    raise AssertionError(f"{program} ends as it starts, with {endings}")


def _is_written(place: Path) -> bool:
    return place.exists() and place.read_text().count("\n") == 1


def _end(process: "subprocess.Popen[bytes]") -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
