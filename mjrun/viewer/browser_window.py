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
PORTS = range(8080, 8100)  # that are tried


def obstacle() -> str:
    """Why no page can be served here; empty if one can."""
    try:
        _studio_page()
    except ImportError as error:
        return f"MuJoCo Studio cannot be loaded: {error}"
    return ""


class BrowserWindow:
    """MuJoCo Studio's page. The browser draws a copy of the model; what is done in it comes as messages.

    The server listens to this machine alone, and answers only those who know the token in the address.

    Args:
      model: what is shown.
      port: of the page; the first free one of `PORTS` when None.
      speed: simulated seconds per second of wall time, at the beginning.

    Attributes:
      url: where the page is, with its token.

    Raises:
      UsageError: the port cannot be had.
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
        self._data.xfrc_applied[:] = 0  # the page sends back what it gets, with the forces of the mouse
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
    """A port of this machine that nobody listens at.

    Raises:
      UsageError: the one that is wanted cannot be had, or none.
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
        raise UsageError(f"ports {PORTS[0]} to {PORTS[-1]} are all in use; give another {option('port')}")
    raise UsageError(
        f"{option('port')}: {wanted} cannot be had: {reason}\ngive another one, or none to have one chosen"
    )
