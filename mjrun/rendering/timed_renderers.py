"""Renderers that measure the cost of each part of rendering an image."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from mjrun.camera.pose import Pose
from mjrun.model.rendered_view import RenderedView
from mjrun.rendering.classic import ClassicRenderer, ExactFramebuffer
from mjrun.rendering.filament import FilamentRenderer

Clock = Callable[[], float]
UPDATE, DRAW, READ = "update", "draw", "read"


class Stopwatch:
    """A stopwatch for nested parts, each counted without the parts inside it.

    Attributes:
      spent: time by name of the part [s].
    """

    def __init__(self, clock: Clock) -> None:
        self.spent: dict[str, float] = {}
        self._clock, self._since = clock, 0.0
        self._inside: list[str] = []

    @contextmanager
    def part(self, name: str) -> Generator[None]:
        """Counts the time of the block towards `name`."""
        self._switch()
        self._inside.append(name)
        try:
            yield
        finally:
            self._switch()
            self._inside.pop()

    def _switch(self) -> None:
        now = self._clock()
        if self._inside:
            name = self._inside[-1]
            self.spent[name] = self.spent.get(name, 0.0) + now - self._since
        self._since = now


class TimedClassicRenderer(ClassicRenderer):
    """A classic renderer that waits for OpenGL, which would otherwise still be rendering when the clock is read.

    Attributes:
      watch: counts `update` (derived fields and scene), `draw`, and `read` (pixels and their conversion).
    """

    def __init__(self, *arguments: Any, watch: Stopwatch) -> None:
        self.watch = watch
        super().__init__(*arguments)

    def set_state(self, state: np.ndarray, index: int = 0) -> None:
        with self.watch.part(UPDATE):
            super().set_state(state, index)

    def render(self, pose: Pose, views: Sequence[str] = ("rgb",)) -> RenderedView:
        with self.watch.part(READ):
            return super().render(pose, views)

    def _update_scene(self, pose: Pose) -> None:
        with self.watch.part(UPDATE):
            super()._update_scene(pose)

    def _render(self) -> None:
        with self.watch.part(DRAW):
            mujoco.mjr_render(self._rect, self._scene, self._context)
            mujoco.mjr_finish()
        mujoco.mjr_readPixels(self._pixels, None, self._rect, self._context)

    def _exact(self, seen: RenderedView, pose: Pose, views: Sequence[str]) -> RenderedView:
        if self._buffer is None:
            self._buffer = _TimedBuffer(self.size, self.watch)
        return super()._exact(seen, pose, views)


class _TimedBuffer(ExactFramebuffer):
    def __init__(self, size: tuple[int, int], watch: Stopwatch) -> None:
        super().__init__(size)
        self._gl, self._watch = _TimedReading(self._gl, watch), watch

    def draw(self, scene: mujoco.MjvScene, context: mujoco.MjrContext) -> tuple[np.ndarray, np.ndarray]:
        with self._watch.part(DRAW):
            return super().draw(scene, context)


class _TimedReading:
    """A wrapper of OpenGL that counts reading pixels separately from drawing."""

    def __init__(self, gl: Any, watch: Stopwatch) -> None:
        self._gl, self._watch = gl, watch

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gl, name)

    def glReadPixels(self, *arguments: Any) -> None:  # noqa: N802
        self._gl.glFinish()
        with self._watch.part(READ):
            self._gl.glReadPixels(*arguments)


class TimedFilamentRenderer(FilamentRenderer):
    """A Filament renderer that counts its time. Filament renders an image when it is read, so `draw` covers both.

    Attributes:
      watch: counts `update` and `draw`.
    """

    def __init__(self, *arguments: Any, watch: Stopwatch) -> None:
        self.watch = watch
        super().__init__(*arguments)

    def set_state(self, state: np.ndarray, index: int = 0) -> None:
        with self.watch.part(UPDATE):
            super().set_state(state, index)

    def render(self, pose: Pose, views: Sequence[str] = ("rgb",)) -> RenderedView:
        with self.watch.part(DRAW):
            return super().render(pose, views)


TIMED: Mapping[str, Callable[..., Any]] = {"classic": TimedClassicRenderer, "filament": TimedFilamentRenderer}
