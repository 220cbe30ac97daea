"""MuJoCo Studio's web viewer, restricted to this machine, with a simulation stepped elsewhere."""

import contextlib
import copy
import hmac
import importlib
import io
import logging
import os
import secrets
import socket
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import mujoco

with contextlib.redirect_stdout(sys.stderr):  # its server logs there from now on
    from mujoco.studio import app, launch_thread, messages, plugin, viewer_handle, viewer_protocol, web_viewer
    from mujoco.studio.dear_imgui import dear_imgui
    from mujoco.studio.web import web_server

from mjrun.confinement.confinement import confinement
from mjrun.viewer.actions import (
    PHYSICS_SETTINGS,
    Action,
    PullBodies,
    ResetSimulation,
    SetPaused,
    SetSpeed,
    SimulationStatus,
    TakeStep,
    UnsupportedAction,
)

sim: Any = importlib.import_module("mujoco.studio.sim")  # both are written in C++
ux: Any = importlib.import_module("mujoco.studio.ux")

HOST = "127.0.0.1"
TITLE = "mjrun view"
OWN_NAMES = (HOST, "localhost", "::1")  # names of this machine, also at the end of a tunnel
STATES = "/state"  # path at which a page with a loaded model requests states
TOKEN = "token"  # query parameter in the address
HANDSHAKE = 60.0  # [s] limit of a request, so that connections without a token cannot stay open
DESCRIPTORS = Path("/dev/fd")  # the open files of this process
# The page has inline scripts, and its WebAssembly creates functions from text and threads from blobs.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self' data: blob: ws://{host} wss://{host}; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Access-Control-Allow-Origin": "",  # which Studio sets to all
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address contains the token
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
# ImGui crashes on a page that connects before its first frames, as a tab that is still open may.
FRAMES_BEFORE_A_PAGE = 30
START = 30.0  # [s] for the server to start
FIRST = messages.Priority.CRITICAL + 10  # before Studio's handlers

DROPPED = UnsupportedAction("models dropped on the page are not loaded: open a separate view for them")
NOISE = UnsupportedAction(
    "noise cannot be set while a simulation runs: start it with the options for noise on controls"
)
KEYFRAME = UnsupportedAction("keyframes cannot be saved from the page")


class _StudioActionCollector(plugin.SimPlugin):
    """A plugin that collects the actions on the page, which Studio's physics would otherwise perform.

    Args:
      model: the model that the page shows.
      speed: the speed that the page shows [percent].

    Attributes:
      actions: the actions since they were last taken.
    """

    def __init__(self, model: mujoco.MjModel, speed: float) -> None:
        self.actions: list[Action] = []
        self._model, self._options = model, copy.deepcopy(model.opt)
        self._shown = messages.StepControlSnapshot(speed=speed)

    def update_page(self, status: SimulationStatus) -> None:
        """Corrects the page where it shows the wrong pause state, or noise.

        The speed is left unchanged: the page supports only some speeds, none above real time.
        """
        paused = sim.PauseState.NORMAL_PAUSED if status.paused else sim.PauseState.UNPAUSED
        if paused != self._shown.pause_state or self._shown.noise_scale:
            self._shown = messages.StepControlSnapshot(pause_state=paused, speed=self._shown.speed)
            self.handle.send_to_viewer(self._shown)

    @messages.handler(priority=FIRST)
    def on_step_control(self, event: messages.StepControlSnapshot) -> bool:
        if event.pause_state != self._shown.pause_state:
            self.actions.append(SetPaused(event.pause_state == sim.PauseState.NORMAL_PAUSED))
        if event.speed != self._shown.speed:
            self.actions.append(SetSpeed(event.speed / 100))
        if event.noise_scale:
            self.actions.append(NOISE)
        self._shown = event
        return True

    @messages.handler(priority=FIRST)
    def on_single_step(self, _: messages.SingleStepEvent) -> bool:
        self.actions.append(TakeStep())
        return True

    @messages.handler(priority=FIRST)
    def on_reset(self, event: messages.ResetEvent) -> bool:
        key = event.key if event.key is not None and event.key >= 0 else None
        self.actions.append(ResetSimulation(key))
        return True

    @messages.handler(priority=FIRST)
    def on_load_model(self, event: messages.LoadModelEvent) -> bool:
        self.actions.append(DROPPED if event.path else ResetSimulation())
        return True

    @messages.handler(priority=FIRST)
    def on_perturb(self, event: messages.PerturbSnapshot) -> bool:
        if event.state.size == 6 * self._model.nbody:
            self.actions.append(PullBodies(event.state.reshape(-1, 6).copy()))
        return True

    @messages.handler(priority=FIRST)
    def on_options(self, event: messages.MjOptionSnapshot) -> bool:
        if event.opt != self._options:
            self.actions.append(PHYSICS_SETTINGS)
            self.handle.send_to_viewer(messages.MjOptionSnapshot(opt=copy.deepcopy(self._options)))
        return True

    @messages.handler(priority=FIRST)
    def on_keyframe(self, _: messages.KeyframeEvent) -> bool:
        self.actions.append(KEYFRAME)
        return True

    @messages.handler(priority=FIRST)
    def on_threads(self, _: messages.ThreadPoolEvent) -> bool:
        return True


class _StudioApp(app.App):
    """Studio's page, which leaves the user's settings file unchanged unless its menu saves it.

    Args:
      speed: the speed shown, as far as the page supports it: simulated seconds per second of wall time.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        super().__init__()

    def _reset_app_state(self) -> None:
        super()._reset_app_state()
        control, begin = self.step_control_state, -1
        while control.get_speed() > 100 * self._speed and begin != self.ux_state.speed_index:
            begin = self.ux_state.speed_index
            self.ux_state.speed_index = ux.set_speed_index(control, begin, begin + 1)

    def _on_exit(self, _: messages.ExitEvent) -> None:
        """Saves nothing on leaving."""

    @messages.handler(priority=messages.Priority.INTERNAL)
    def _on_theme(self, event: plugin.ThemeEvent) -> None:
        self.theme = event.theme  # which browsers choose themselves
        ux.setup_theme(self.theme)

    @messages.handler(priority=FIRST)
    def on_build(self, _: messages.BuildGuiEvent) -> None:
        dear_imgui.GetIO().WantSaveIniSettings = False


class LoopbackViewer(web_viewer.WebViewer):
    """Studio's web viewer on the loopback address instead of all, and without files dropped on its page."""

    # Studio sets it to all addresses in its constructor, without an option.
    _host = property(lambda _: HOST, lambda _, value: None)

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # a banner with the address
            super().__init__(*arguments, **settings)
        address = self._http_sock.getsockname()[0]
        if address != HOST:
            self.close()
            raise RuntimeError(f"MuJoCo Studio would listen on {address}, not on this machine only")

    _frames = 0

    def prepare_next_frame(self) -> bool:
        self._frames += 1
        if self._frames == FRAMES_BEFORE_A_PAGE:
            _ports_ready.add(self._http_port)
        return super().prepare_next_frame()

    @messages.handler(priority=messages.Priority.INTERNAL)
    def _on_post_model(self, _: messages.PostModelEvent) -> None:
        self._update_model()

    def get_drop_file(self) -> str:
        if self._drop_queue.empty():
            return ""
        self._drop_queue.get()
        self.send_to_sim(messages.LoadModelEvent(path="dropped"))
        return ""


class StudioWebPage:
    """The page, and the thread that serves it.

    Args:
      data: the data that the page shows after each `sync`.
      speed: initial simulated seconds per second of wall time.

    Attributes:
      token: required in every request, in its address or in the cookie that the page receives.

    Raises:
      RuntimeError: the port is in use.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, port: int, speed: float) -> None:
        self._hooks = sys.excepthook, threading.excepthook, warnings.showwarning
        logging.getLogger("WebServer").setLevel(logging.WARNING)
        logging.getLogger("asyncio").addFilter(_is_no_closed_page)
        _ports_seen.discard(port)
        _ports_ready.discard(port)
        self.token = _tokens[port] = secrets.token_urlsafe(32)
        self._port, page, started = port, _StudioApp(speed), threading.Event()
        self._messages = _StudioActionCollector(model, page.step_control_state.get_speed())
        config = viewer_protocol.ViewerConfig(title=TITLE, gfx="web", http_port=port)

        def serve(endpoint: Any) -> None:
            viewer = LoopbackViewer(config, endpoint, plugins=[page])
            started.set()
            viewer_protocol.run_viewer_loop(viewer)

        self._handle: viewer_handle.ViewerHandle = launch_thread.launch_thread(serve, sim_plugins=[self._messages])
        try:
            self._wait(started)
            self._handle.set_model(model, data=data)
            self._wait_for_frames()
        except BaseException:
            self.close()
            raise

    def _wait(self, started: threading.Event) -> None:
        for _ in range(int(START / 0.05)):
            if started.wait(0.05):
                return
            if not self._handle.is_running():  # raises the error, if any
                break
        raise RuntimeError("MuJoCo Studio did not start")

    def _wait_for_frames(self) -> None:
        """Waits until pages may connect."""
        end = time.monotonic() + START
        while self._port not in _ports_ready and time.monotonic() < end and self._handle.is_running():
            time.sleep(0.01)
        self._handle.sync()
        self._messages.actions = []  # none of a user yet

    @property
    def is_open(self) -> bool:
        """True until a user closes it through its menu."""
        return self._handle.is_running()

    @property
    def is_seen(self) -> bool:
        """True once a browser has shown it."""
        return self._port in _ports_seen

    def sync(self, status: SimulationStatus) -> list[Action]:
        """Shows the data, applies edits from the page to it, and returns the other actions."""
        self._messages.update_page(status)
        self._handle.sync()
        actions, self._messages.actions = self._messages.actions, []
        return actions

    def close(self) -> None:
        """Ends the server."""
        self._handle.close()
        logging.getLogger("asyncio").removeFilter(_is_no_closed_page)
        sys.excepthook, threading.excepthook, warnings.showwarning = self._hooks


def _is_no_closed_page(record: logging.LogRecord) -> bool:
    """Returns False for a page that was closed while the server of MuJoCo sent it a frame, which ends nothing else."""
    error = record.exc_info[1] if record.exc_info else None
    return type(error).__name__ != "ConnectionClosedOK"


_ports_ready: set[int] = set()  # ports that accept pages
_ports_seen: set[int] = set()  # ports whose page a browser has loaded, with the model
_tokens: dict[int, str] = {}  # token of the page at each port


def _refusal(request: Any, port: int) -> tuple[HTTPStatus, str] | None:
    """Returns status and text of the refusal of a request; None for a request with the token from the page itself."""
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    try:
        (name,) = [urlsplit(f"//{host}").hostname for host in hosts]
    except ValueError:  # none, several, or an invalid one
        return HTTPStatus.BAD_REQUEST, "the request does not specify its host\n"
    # Browsers let other sites connect to this machine.
    if name not in OWN_NAMES or origins not in ([], [f"http://{hosts[0]}"]):
        return HTTPStatus.FORBIDDEN, "this page is only available on the machine that serves it\n"
    if not any(_is_token(text, port) for text in (*_from_address(request), *_from_cookies(request, port))):
        return HTTPStatus.FORBIDDEN, "open the address that mjrun has printed: it ends with a token\n"
    if port not in _ports_ready:
        return HTTPStatus.SERVICE_UNAVAILABLE, "the simulation is starting\n"
    return None


def _is_token(text: str, port: int) -> bool:
    return hmac.compare_digest(text.encode(errors="surrogateescape"), _tokens[port].encode())


def _from_address(request: Any) -> Iterator[str]:
    """Yields the tokens in the address of a request."""
    for part in request.path.partition("?")[2].split("&"):
        name, _, value = part.partition("=")
        if name == TOKEN:
            yield value


def _from_cookies(request: Any, port: int) -> Iterator[str]:
    """Yields the tokens in the cookies of a request; browsers send those of one port to all."""
    for part in ";".join(request.headers.get_all("Cookie")).split(";"):
        name, _, value = part.strip().partition("=")
        if name == _cookie(port):
            yield value


def _cookie(port: int) -> str:
    return f"mjrun-view-{port}"


def _guarded_serve(handler: Any, *, process_request: Any, process_response: Any, **settings: Any) -> Any:
    """Wraps `websockets.serve` to require the token, and to add headers that keep other sites out."""
    port = settings["sock"].getsockname()[1]

    def process(connection: Any, request: Any) -> Any:
        if refusal := _refusal(request, port):
            return connection.respond(*refusal)
        if request.path.partition("?")[0] == STATES:
            _ports_seen.add(port)
        return process_request(connection, request)

    def secure(connection: Any, request: Any, response: Any) -> Any:
        response = process_response(connection, request, response) or response
        is_answered = _refusal(request, port) is None
        policy = POLICY.format(host=request.headers["Host"]) if is_answered else "default-src 'none'"
        for name, value in {**HEADERS, "Content-Security-Policy": policy}.items():
            with contextlib.suppress(KeyError):
                del response.headers[name]
            if value:
                response.headers[name] = value
        if is_answered and any(_is_token(text, port) for text in _from_address(request)):
            cookie = f"{_cookie(port)}={_tokens[port]}; HttpOnly; SameSite=Strict; Path=/"
            response.headers["Set-Cookie"] = cookie
        return response

    settings["open_timeout"] = HANDSHAKE
    return _serve(handler, process_request=process, process_response=secure, **settings)


class _OwnSocket(socket.socket):
    """A listening socket that accepts connections from this process, and closes all others."""

    def accept(self) -> tuple[socket.socket, Any]:
        while True:
            connection, address = super().accept()
            if _is_of_this_process(connection):
                return connection, address
            connection.close()


def _is_of_this_process(connection: socket.socket) -> bool:
    """Returns whether this process also holds the other end of a connection: pairs of addresses are unique."""
    with contextlib.suppress(OSError):
        ends = connection.getpeername(), connection.getsockname()
        for entry in DESCRIPTORS.iterdir():
            if _ends(int(entry.name)) == ends:
                return True
    return False


def _ends(descriptor: int) -> tuple[Any, Any] | None:
    """Returns a socket's address and that of its peer; None for anything but a connected socket."""
    try:
        borrowed = socket.socket(fileno=descriptor)
    except OSError:
        return None
    try:
        return borrowed.getsockname(), borrowed.getpeername()
    except OSError:
        return None
    finally:
        borrowed.detach()


def _bind_own_socket(port: int = 0) -> socket.socket:
    """Replaces Studio's function for the socket of its user interface, which accepts the whole machine."""
    limits = confinement()
    if limits and limits.own_port >= 0:  # the only port that a confined process can connect to
        bound = _OwnSocket(fileno=os.dup(limits.own_port))
    else:
        bound = _OwnSocket(socket.AF_INET, socket.SOCK_STREAM)
        bound.bind((HOST, port))
    bound.listen()
    return bound


_serve = web_server.serve
web_server.serve = _guarded_serve
web_server.bind_loopback_socket = _bind_own_socket
