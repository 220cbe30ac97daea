"""Painters for tests of drawing in several processes, which import this module by name."""

import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjrun.errors import NoRendererError, UnstableError
from mjrun.rendering.backend import WorkingBackend

HANG = 36000.0  # [s], longer than any wait, on however busy a machine
OPENING, ASKED = -1, -2  # the frames of mischief done by `open` and when asked for the process


def unstable() -> None:
    raise UnstableError(7, 0.5, "qpos", "hinge", 0.002)


def without_renderer() -> None:
    raise NoRendererError({"egl": "is not there"}, "install it")


def talkative() -> None:
    print("from Python", flush=True)  # noqa: T201
    os.write(1, b"from a driver\n")


MISCHIEF: dict[str, Callable[[], object]] = {
    "is killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "crashes": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "ends": lambda: os._exit(3),
    "exits": lambda: sys.exit(4),
    "hangs": lambda: time.sleep(HANG),
    "stops": lambda: os.kill(os.getpid(), signal.SIGSTOP),
    "is unstable": unstable,
    "has no renderer": without_renderer,
    "divides": lambda: 1 // 0,
    "prints": talkative,
}


@dataclass(frozen=True)
class Adding:
    """Fills frame k with k plus the sum of its state, after up to four times `delay` [s] and the k-th `mischief`."""

    mischief: Mapping[int, str] = field(default_factory=dict)
    delay: float = 0

    def open(self) -> None:
        self._do(OPENING)

    def compose(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        time.sleep(self.delay * (index * 7 % 5))
        self._do(index)
        into[...] = index + state.sum()

    def close(self) -> None:
        pass

    def windows(self) -> bool:
        """Whether anything that opens windows was imported."""
        return "mujoco" not in sys.modules or "glfw" in sys.modules

    def process(self) -> int:
        """Where it draws."""
        self._do(ASKED)
        return os.getpid()

    def _do(self, index: int) -> None:
        if index in self.mischief:
            MISCHIEF[self.mischief[index]]()


class Telling(Adding):
    """Draws the process's id, and what it was given of LP_NUM_THREADS."""

    def compose(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        super().compose(state, index, into)
        into[...] = os.getpid(), int(os.environ.get("LP_NUM_THREADS", "-1"))


@dataclass(frozen=True)
class Warner(Adding):
    """Makes MuJoCo warn, of the same at every frame."""

    model: Any = None

    def _do(self, index: int) -> None:
        import mujoco

        data = mujoco.MjData(self.model)
        data.qpos[:] = np.nan
        mujoco.mj_step(self.model, data)


@dataclass
class Drawing:
    """Draws the qpos in a state with OpenGL, seen by the model's first camera."""

    model: Any
    backend: WorkingBackend
    size: tuple[int, int]

    def open(self) -> None:
        import mujoco

        view = self.model.vis.global_
        view.offwidth, view.offheight = self.size
        self._gl = self.backend.context(*self.size)
        self._context = mujoco.MjrContext(self.model, 100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._data = mujoco.MjData(self.model)
        self._scene = mujoco.MjvScene(self.model, 100)

    def compose(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        import mujoco

        camera, rect = mujoco.MjvCamera(), mujoco.MjrRect(0, 0, *self.size)
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, 0
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        self._data.qpos[:] = state
        mujoco.mj_forward(self.model, self._data)
        mujoco.mjv_updateScene(self.model, self._data, mujoco.MjvOption(), None, camera, everything, self._scene)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(into, None, rect, self._context)
        into[:] = into[::-1].copy()

    def close(self) -> None:
        self._context.free()
        self._gl.free()
