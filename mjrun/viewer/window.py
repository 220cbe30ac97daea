"""The windows that show a live simulation, MuJoCo's and Studio's page, and the actions that users take there."""

import copy
import importlib
import os
import queue
import socket
import sys
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

import mujoco
import numpy as np

from mjrun.confinement.confinement import confinement
from mjrun.errors import UsageError, option
from mjrun.model import state
from mjrun.rendering.backend import BackendTrialProcess
from mjrun.viewer.actions import (
    PHYSICS_SETTINGS,
    Action,
    PullBodies,
    ResetSimulation,
    SetPaused,
    SetSpeed,
    SetStateNumbers,
    SimulationStatus,
    TakeStep,
)

if TYPE_CHECKING:
    from mjrun.viewer.studio_page import StudioWebPage

# Key codes of GLFW, equal to those of ASCII where one exists.
SPACE, RIGHT = 32, 262
SLOWER, FASTER = (45, 333), (61, 334)  # - and =, - and + of the number pad
KEYS = "space\nright arrow\nbackspace\n- / =\nctrl + mouse\ntab", "pause\nstep\nreset\nspeed\npull or turn\nsettings"
BEGINNING = 1e-300  # [s] represents time 0, which MuJoCo's viewer sets on a reset
SLOW = 0.9  # share of the speed below which the achieved speed is shown
END = 10.0  # [s] for the window to close
HOST = "127.0.0.1"
PORTS = range(8080, 8100)  # tried in order


class Window(Protocol):
    """A window that shows a model and receives user actions.

    Attributes:
      kind: `window` or `browser`.
    """

    kind: str

    @property
    def is_open(self) -> bool:
        """True until a user closes it."""
        ...

    @property
    def is_seen(self) -> bool:
        """True once a user could see it."""
        ...

    def show(self, instant: mujoco.MjData, status: SimulationStatus) -> list[Action]:
        """Shows an instant, and returns the user's actions since the previous one.

        Args:
          instant: an MjData whose fields all belong to its state; it is copied.
        """
        ...

    def close(self) -> None:
        """Closes it, and waits until all its resources are freed."""
        ...


def native_obstacle() -> str:
    """Returns the reason why no window can be opened; empty if one can. The test runs in a separate process."""
    if sys.platform == "darwin":
        return "MuJoCo's window requires the program mjpython on macOS"
    if confinement():
        return "a confined process cannot access a display"
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return "no display: neither DISPLAY nor WAYLAND_DISPLAY is set"
    answer = BackendTrialProcess("glfw").answer()
    return answer.get("error", "")


class NativeWindow:
    """MuJoCo's passive viewer, which renders a copy of the model and writes user actions into a copy of the data.

    Args:
      model: the model to show.
    """

    kind = "window"
    is_seen = True

    def __init__(self, model: mujoco.MjModel) -> None:
        viewer = importlib.import_module("mujoco.viewer")  # loads GLFW
        self._model, self._data = copy.copy(model), mujoco.MjData(model)
        self._options = copy.deepcopy(self._model.opt)
        self._layout = state.fields(state.sizes(model))
        self._keys: queue.SimpleQueue[int] = queue.SimpleQueue()
        others = set(threading.enumerate())
        self._handle = viewer.launch_passive(
            self._model, self._data, key_callback=self._keys.put, show_left_ui=False, show_right_ui=False
        )
        self._threads = set(threading.enumerate()) - others

    @property
    def is_open(self) -> bool:
        return self._handle.is_running()

    def show(self, instant: mujoco.MjData, status: SimulationStatus) -> list[Action]:
        mujoco.mj_copyData(self._data, self._model, instant)
        self._data.xfrc_applied[:] = 0  # the viewer stores only the mouse's forces there
        self._data.time = max(instant.time, BEGINNING)
        shown = state.save(self._model, self._data)
        self._handle.set_texts([(None, None, *KEYS), (None, mujoco.mjtGridPos.mjGRID_TOPRIGHT, *_lines(status))])
        self._handle.sync()
        return [*self._key_actions(status), *self._changes(shown)]

    def close(self) -> None:
        self._handle.close()
        for thread in self._threads:
            thread.join(END)

    def _key_actions(self, status: SimulationStatus) -> Iterator[Action]:
        paused, speed = status.paused, status.speed
        while not self._keys.empty():
            key = self._keys.get()
            if key == SPACE:
                paused = not paused
                yield SetPaused(paused)
            elif key == RIGHT:
                paused = True
                yield TakeStep()
            elif key in (*SLOWER, *FASTER):
                speed *= 0.5 if key in SLOWER else 2
                yield SetSpeed(speed)

    def _changes(self, shown: np.ndarray) -> Iterator[Action]:
        """Yields the viewer's changes to the state `shown` `(nstate,)`."""
        now = state.save(self._model, self._data)
        if now[0] != shown[0]:  # time is first
            yield ResetSimulation(self._loaded_keyframe())
            return
        yield PullBodies(self._data.xfrc_applied.copy())
        changed = now != shown
        changed[self._layout["xfrc_applied"]] = False
        if changed.any():
            yield SetStateNumbers(now, changed)
        if self._model.opt != self._options:
            self._model.opt = copy.deepcopy(self._options)
            yield PHYSICS_SETTINGS

    def _loaded_keyframe(self) -> int | None:
        """Returns the keyframe in the data; None for the state that `mj_resetData` sets."""
        model, data = self._model, self._data
        if np.array_equal(data.qpos, model.qpos0) and not data.qvel.any():
            return None
        same = [key for key in range(model.nkey) if np.array_equal(data.qpos, model.key_qpos[key])]
        return same[0] if same else None


def _lines(status: SimulationStatus) -> tuple[str, str]:
    """Returns the status in two columns; MuJoCo's font supports only ASCII."""
    rows = {"time": f"{status.time:.3f} s", "speed": f"{status.speed:g} x"}
    if status.paused:
        rows["state"] = status.message or "paused"
    elif status.achieved < SLOW * status.speed:
        rows["reached"] = f"{status.achieved:.2g} x"
    return "\n".join(rows), "\n".join(rows.values())


def browser_obstacle() -> str:
    """Returns the reason why no page can be served; empty if one can."""
    try:
        _studio_page()
    except ImportError as error:
        return f"MuJoCo Studio cannot be loaded: {error}"
    return ""


class BrowserWindow:
    """MuJoCo Studio's page. The browser renders a copy of the model; the user's actions arrive as messages.

    The server listens on this machine only, and answers only requests with the token in the address.

    Args:
      model: the model to show.
      port: port of the page; the first free one of `PORTS` when None.
      speed: initial simulated seconds per second of wall time.

    Attributes:
      url: address of the page, with its token.

    Raises:
      UsageError: the port is not available.
    """

    kind = "browser"

    def __init__(self, model: mujoco.MjModel, port: int | None = None, speed: float = 1.0) -> None:
        port = _free_port(port)
        self._model, self._data = copy.copy(model), mujoco.MjData(model)
        self._forces = state.fields(state.sizes(model))["xfrc_applied"]
        self._page: StudioWebPage = _studio_page()(self._model, self._data, port, speed)
        self.url = f"http://{HOST}:{port}/?token={self._page.token}"

    @property
    def is_open(self) -> bool:
        return self._page.is_open

    @property
    def is_seen(self) -> bool:
        return self._page.is_seen

    def show(self, instant: mujoco.MjData, status: SimulationStatus) -> list[Action]:
        mujoco.mj_copyData(self._data, self._model, instant)
        self._data.xfrc_applied[:] = 0  # the page returns its input, with the forces of the mouse
        shown = state.save(self._model, self._data)
        actions = self._page.sync(status)
        now = state.save(self._model, self._data)
        changed = now != shown
        changed[self._forces] = False
        return [*actions, SetStateNumbers(now, changed)] if changed.any() else actions

    def close(self) -> None:
        self._page.close()


def _studio_page() -> "type[StudioWebPage]":
    from mjrun.viewer.studio_page import StudioWebPage

    return StudioWebPage


def _free_port(wanted: int | None) -> int:
    """Returns a free port of this machine.

    Raises:
      UsageError: the requested port, or every port, is in use.
    """
    reason = ""
    for port in PORTS if wanted is None else (wanted,):
        with socket.socket() as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((HOST, port))
                return port
            except OSError as error:
                reason = error.strerror or str(error)
    if wanted is None:
        raise UsageError(f"ports {PORTS[0]} to {PORTS[-1]} are all in use; set another {option('port')}")
    raise UsageError(
        f"{option('port')}: {wanted} is not available: {reason}\nset another port, or none to have one chosen"
    )
