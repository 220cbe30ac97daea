"""MuJoCo's native viewer, in a desktop window."""

import copy
import importlib
import os
import queue
import sys
import threading
from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.confinement.confinement import confinement
from mjrun.model import state
from mjrun.rendering.backend import BackendTrialProcess
from mjrun.viewer import window

# Key codes of GLFW, equal to those of ASCII where one exists.
SPACE, RIGHT = 32, 262
SLOWER, FASTER = (45, 333), (61, 334)  # - and =, - and + of the number pad
KEYS = "space\nright arrow\nbackspace\n- / =\nctrl + mouse\ntab", "pause\nstep\nreset\nspeed\npull or turn\nsettings"
BEGINNING = 1e-300  # [s] represents time 0, which MuJoCo's viewer sets on a reset
SLOW = 0.9  # share of the speed below which the achieved speed is shown
END = 10.0  # [s] for the window to close


def obstacle() -> str:
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

    def show(self, instant: mujoco.MjData, status: window.Status) -> list[window.Action]:
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

    def _key_actions(self, status: window.Status) -> Iterator[window.Action]:
        paused, speed = status.paused, status.speed
        while not self._keys.empty():
            key = self._keys.get()
            if key == SPACE:
                paused = not paused
                yield window.SetPaused(paused)
            elif key == RIGHT:
                paused = True
                yield window.TakeStep()
            elif key in (*SLOWER, *FASTER):
                speed *= 0.5 if key in SLOWER else 2
                yield window.SetSpeed(speed)

    def _changes(self, shown: np.ndarray) -> Iterator[window.Action]:
        """Yields the viewer's changes to the state `shown` `(nstate,)`."""
        now = state.save(self._model, self._data)
        if now[0] != shown[0]:  # time is first
            yield window.Reset(self._loaded_keyframe())
            return
        yield window.Pull(self._data.xfrc_applied.copy())
        changed = now != shown
        changed[self._layout["xfrc_applied"]] = False
        if changed.any():
            yield window.Edit(now, changed)
        if self._model.opt != self._options:
            self._model.opt = copy.deepcopy(self._options)
            yield window.PHYSICS_SETTINGS

    def _loaded_keyframe(self) -> int | None:
        """Returns the keyframe in the data; None for the state that `mj_resetData` sets."""
        model, data = self._model, self._data
        if np.array_equal(data.qpos, model.qpos0) and not data.qvel.any():
            return None
        same = [key for key in range(model.nkey) if np.array_equal(data.qpos, model.key_qpos[key])]
        return same[0] if same else None


def _lines(status: window.Status) -> tuple[str, str]:
    """Returns the status in two columns; MuJoCo's font supports only ASCII."""
    rows = {"time": f"{status.time:.3f} s", "speed": f"{status.speed:g} x"}
    if status.paused:
        rows["state"] = status.message or "paused"
    elif status.achieved < SLOW * status.speed:
        rows["reached"] = f"{status.achieved:.2g} x"
    return "\n".join(rows), "\n".join(rows.values())
