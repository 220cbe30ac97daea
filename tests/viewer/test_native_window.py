"""MuJoCo's own window, on a display without a screen: what is done in it arrives, and nothing of it stays."""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

from mjrun.confinement.confinement import VARIABLE, Confinement
from mjrun.viewer.window import native_obstacle
from tests.processes import PATIENCE

pytestmark = pytest.mark.gl

ROOT = Path(__file__).parents[2]
# Works a window as the simulation does, in a process of its own: GLFW and OpenGL stay in it for good.
SCRIPT = """
import sys, threading, time
import mujoco, numpy as np
from mjrun.viewer.window import NativeWindow, RIGHT, SPACE
from mjrun.viewer.actions import PullBodies, ResetSimulation, SetPaused, SetSpeed, SetStateNumbers, SimulationStatus
from mjrun.viewer.actions import TakeStep

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
threads = threading.active_count()
window = NativeWindow(model)
assert window.is_open and window.is_seen and window.kind == "window"

def show(**changes):
    return window.show(data, SimulationStatus(**{**dict(time=0.0, paused=False, speed=1.0, achieved=1.0), **changes}))

def quiet(actions):
    return all(isinstance(a, PullBodies) and not a.forces.any() for a in actions)

data.xfrc_applied[1] = 1  # a controller's, which is none of the window's business
assert quiet(show()), "nothing was done yet"
for key in (SPACE, RIGHT, 45, 61, 61, 65):
    window._keys.put(key)  # as GLFW's callback does
actions = [a for a in show() if not isinstance(a, PullBodies)]
assert actions == [SetPaused(True), TakeStep(), SetSpeed(0.5), SetSpeed(1.0), SetSpeed(2.0)], actions
window._keys.put(SPACE)
assert SetPaused(False) in show(paused=True)

window._model.opt.gravity[2] = 3  # as the window's settings do
assert "physics settings" in next(a for a in show() if hasattr(a, "what")).what
assert window._model.opt.gravity[2] == model.opt.gravity[2]
assert quiet(show())

mouse = window._handle.perturb  # which the mouse moves
mouse.select, mouse.active, mouse.localmass, mouse.scale = 1, int(mujoco.mjtPertBit.mjPERT_TRANSLATE), 1, 1
mouse.refpos, mouse.refquat = data.xpos[1] + [0, 0, 0.5], data.xquat[1]
(pull,) = show()
expected = mujoco.MjData(model)
mujoco.mj_copyData(expected, model, data)
expected.xfrc_applied[:] = 0
mujoco.mjv_applyPerturbForce(model, expected, mouse)
assert pull.forces.any() and pull.forces.tolist() == expected.xfrc_applied.tolist()
mouse.active = 0
assert quiet(show())

window.close()
assert not window.is_open
assert threading.active_count() == threads
print("closed")
"""


def python(display: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **display, "PYTHONPATH": str(ROOT), "MUJOCO_GL": "disable"}
    command = [sys.executable, "-c", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)


@pytest.mark.slow
def test_what_is_done_in_it_arrives_and_nothing_of_it_stays(display: dict[str, str], swing: Path) -> None:
    done = python(display, SCRIPT, str(swing))
    assert (done.stdout, done.returncode) == ("closed\n", 0), done.stderr


def test_a_display_is_tried(display: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in display.items():
        monkeypatch.setenv(name, value)
    assert native_obstacle() == ""
    monkeypatch.setenv("DISPLAY", ":54321")
    assert native_obstacle() != ""


def test_a_confined_process_tries_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv(VARIABLE, json.dumps(asdict(Confinement(()))))
    assert native_obstacle() == "a confined process cannot access a display"


def test_without_a_display_it_says_so(monkeypatch: pytest.MonkeyPatch, no_display: dict[str, str]) -> None:
    for name, value in no_display.items():
        monkeypatch.setenv(name, value)
    assert "no display" in native_obstacle()
