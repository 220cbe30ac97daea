"""The server in Filament's process, which renders what `filament.FilamentRenderer` requests."""

import time
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.camera.pose import Frustum, Pose, lens, pose_of
from mjrun.errors import DrawError
from mjrun.model.names import COUNTS, KINDS
from mjrun.model.rendered_view import RenderedView
from mjrun.model.state import restore
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.filament import MIRRORS, MODES, flags
from mjrun.rendering.filament_scene import NUMBERED, FilamentScene, PixelFormat
from mjrun.rendering.segment_ids import NOTHING, Segmentation
from mjrun.rendering.visual import Visual, downsampled, updated_scene

GEOMS = 2_000  # initial capacity of the scene; it grows
DECORATION = mujoco.mjtCatBit.mjCAT_DECOR.value
DEPTH = PixelFormat("R32F", "DEPTH", 1, np.float32)
SEGMENTS = PixelFormat("RGB8", "SEGMENTATION_BY_ID", 3, np.uint8)


class FilamentServer:
    """A renderer of one model's states; methods and arguments are those of `FilamentRenderer`."""

    def open(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        visual: Visual,
        segmentation: Segmentation | None,
        decorations: Sequence[Decoration],
    ) -> None:
        self._model, self._size, self._samples = model, size, visual.samples
        self._segmentation, self._decors = segmentation, decorations
        self._data = mujoco.MjData(model)
        self._index = 0
        self._scene = mujoco.MjvScene(model, GEOMS)
        self._options = visual.options()
        visual.set_flags(self._scene)
        self._wanted = flags(self._options, self._scene)

        mode = next((mode for name, (value, mode) in MODES.items() if self._wanted[name] == value), "DEFAULT")
        self._colors = PixelFormat("RGB8", mode, 3, np.uint8)
        self._filament_scene = FilamentScene(model, self._options)

        mujoco.mjv_updateCamera(model, self._data, mujoco.MjvCamera(), self._scene)
        self._pose = pose_of(self._scene)  # any pose
        self._update_scene()
        geoms = self._scene.geoms[: self._scene.ngeom]
        self._filament_scene.hide_all_but({(geom.objtype, geom.objid) for geom in geoms})

    def set_state(self, state: np.ndarray, index: int) -> None:
        restore(self._model, self._data, state)
        try:
            mujoco.mj_forward(self._model, self._data)
        except mujoco.FatalError as error:
            raise DrawError(f"MuJoCo failed at time {self._data.time:.9g} s: {error}") from error
        self._index = index
        self._filament_scene.update(self._data)

    def render(self, pose: Pose, views: Sequence[str]) -> RenderedView:
        """Renders the views from `pose`, without the legend, which the other process has."""
        self._pose = pose
        self._update_scene()
        seen = RenderedView(lens(pose, self._size))
        if "depth" in views or "seg" in views:
            seen = self._exact(seen, views)
        if "rgb" in views:
            for decoration in self._decors:
                decoration.add(self._scene, self._index)
            geoms = self._scene.geoms[: self._scene.ngeom]
            self._filament_scene.decorate(geom for geom in geoms if geom.category == DECORATION)
            seen = replace(seen, rgb=self._shown(shadows=True))
        return seen

    def draft_cost(self) -> float:
        self._shown(shadows=False)  # the first draw of a kind compiles shaders
        start = time.perf_counter()
        self._shown(shadows=False)
        return time.perf_counter() - start

    def _update_scene(self) -> None:
        room = sum(decoration.geoms for decoration in self._decors)
        self._scene = updated_scene(self._model, self._data, self._options, self._pose, self._scene, room)

    def _exact(self, seen: RenderedView, views: Sequence[str]) -> RenderedView:
        """Renders depth and ids. Ids have no far plane, so depth decides what lies beyond it."""
        depth = planar_depth(self._filament_scene.draw(self._size, self._pose, DEPTH)[:, :, 0], self._pose.frustum)
        if "depth" in views:
            seen = replace(seen, depth=depth)
        if "seg" in views:
            assert self._segmentation
            colors = self._filament_scene.draw(self._size, self._pose, SEGMENTS)
            segments = colors @ np.array([1, 2**8, 2**16], np.int32)
            seen = replace(seen, ids=np.where(np.isfinite(depth), self._ids(self._segmentation)[segments], NOTHING))
        return seen

    def _ids(self, segmentation: Segmentation) -> np.ndarray:
        """Returns the id of each of Filament's numbers; number 0 is the background."""
        known = segmentation.ids(self._scene)
        counts = [getattr(self._model, COUNTS[kind]) for kind in NUMBERED]
        first = {int(KINDS[kind]): 1 + sum(counts[:i]) for i, kind in enumerate(NUMBERED)}
        ids = np.full(1 + sum(counts), NOTHING, np.int32)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.objtype in first and geom.segid >= 0:
                ids[first[geom.objtype] + geom.objid] = known[geom.segid + 1]
        return ids

    def _shown(self, shadows: bool) -> np.ndarray:
        (width, height), n = self._size, self._samples
        pixels = self._filament_scene.draw(
            (n * width, n * height),
            self._pose,
            self._colors,
            shadows=shadows and bool(self._wanted["shadow"]),
            reflections=MIRRORS and bool(self._wanted["reflection"]),
            **{name: bool(self._wanted[name]) for name in ("skybox", "haze", "post_processing")},
        )
        return downsampled(pixels, n)


def planar_depth(buffer: np.ndarray, frustum: Frustum) -> np.ndarray:
    """Converts Filament's depth buffer, 1 at the near plane and 0 at the far one, to planar depth [m]; 0 means inf."""
    near, far, values = frustum.near, frustum.far, buffer.astype(np.float64)
    depth = far - (far - near) * values if frustum.orthographic else near * far / (near + (far - near) * values)
    return np.where(values > 0, depth, np.inf).astype(np.float32)
