"""What windows report is plain values."""

import socket

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError, spelled
from mjrun.viewer import window
from mjrun.viewer.actions import PHYSICS_SETTINGS, PullBodies, ResetSimulation
from mjrun.viewer.window import BrowserWindow


def test_actions_are_values() -> None:
    forces = np.zeros((2, 6))
    assert PullBodies(forces).forces is forces
    assert ResetSimulation() == ResetSimulation(None) != ResetSimulation(0)


def test_what_is_refused_says_which_option_does_it() -> None:
    assert "set, as in opt.gravity" in spelled(PHYSICS_SETTINGS.what)


def test_a_port_in_use_is_reported_at_once(swing: object) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(UsageError, match=f"port: {port} is not available: Address already in use"):
            BrowserWindow(model, port)


def test_without_a_wish_the_first_free_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as other, socket.socket() as free:
        other.bind(("127.0.0.1", 0))
        other.listen()
        free.bind(("127.0.0.1", 0))
        taken, port = other.getsockname()[1], free.getsockname()[1]
        free.close()
        monkeypatch.setattr(window, "PORTS", [taken, port])
        assert window._free_port(None) == port
        monkeypatch.setattr(window, "PORTS", [taken])
        with pytest.raises(UsageError, match="all in use"):
            window._free_port(None)


def test_a_missing_studio_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise ImportError("No module named 'mujoco.studio'")

    monkeypatch.setattr(window, "_studio_page", fail)
    assert window.browser_obstacle() == "MuJoCo Studio cannot be loaded: No module named 'mujoco.studio'"
