"""MuJoCo Studio in a browser on this machine."""

import copy
import socket
from typing import TYPE_CHECKING

import mujoco

from mjrun.errors import UsageError, option
from mjrun.model import state
from mjrun.viewer.window import Action, Edit, Status

if TYPE_CHECKING:
    from mjrun.viewer.studio_page import StudioPage

HOST = "127.0.0.1"
PORTS = range(8080, 8100)  # tried in order


def obstacle() -> str:
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
        self._page: StudioPage = _studio_page()(self._model, self._data, port, speed)
        self.url = f"http://{HOST}:{port}/?token={self._page.token}"

    @property
    def is_open(self) -> bool:
        return self._page.is_open

    @property
    def is_seen(self) -> bool:
        return self._page.is_seen

    def show(self, instant: mujoco.MjData, status: Status) -> list[Action]:
        mujoco.mj_copyData(self._data, self._model, instant)
        self._data.xfrc_applied[:] = 0  # the page returns its input, with the forces of the mouse
        shown = state.save(self._model, self._data)
        actions = self._page.sync(status)
        now = state.save(self._model, self._data)
        changed = now != shown
        changed[self._forces] = False
        return [*actions, Edit(now, changed)] if changed.any() else actions

    def close(self) -> None:
        self._page.close()


def _studio_page() -> "type[StudioPage]":
    from mjrun.viewer.studio_page import StudioPage

    return StudioPage


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
