"""MuJoCo's physically based renderer, Filament, drawing recorded states through Vulkan.

What it cannot draw is refused, or warned of where nobody asked for it: never left out in silence.
"""

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType

import mujoco
import numpy as np

from mjrun.errors import DrawError, MjrunWarning, UsageError
from mjrun.model.names import COUNTS, KINDS, members
from mjrun.model.picture import Picture
from mjrun.model.state import restore
from mjrun.render.backend import Backend
from mjrun.render.camera import Rig
from mjrun.render.classic import check_size
from mjrun.render.decor import Decor
from mjrun.render.lens import average_camera, lens
from mjrun.render.segmentation import NOTHING, Segmentation
from mjrun.render.stage import NUMBERED, Form, Stage
from mjrun.render.visual import Visual

GEOMS = 2_000  # room in the scene to begin with; it grows
EVERYTHING, DECORATION = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.mjtCatBit.mjCAT_DECOR.value

MIRRORS = False  # under Vulkan, MuJoCo 4.0.0 draws reflections upside down

CLASSIC = "--renderer classic can"
# What to do instead of changing a flag that Filament does not know.
REFUSED = {
    **dict.fromkeys(("additive", "cull_face", "flexvert", "flexedge", "flexface", "flexskin"), CLASSIC),
    **dict.fromkeys(("segment", "idcolor"), "--view seg can"),
    "depth": "--view depth can",
    "fog": f"{CLASSIC}; its own fog is the model's: <custom><numeric name='filament.fog.enabled' data='1'/></custom>",
}
# Ways to draw the whole picture, and the value of the flag that asks for each.
MODES = {"wireframe": (1, "WIREFRAME"), "island": (1, "ISLANDS"), "texture": (0, "DEFAULT_NO_TEXTURES")}


DEPTH = Form("R32F", "DEPTH", 1, np.float32)
SEGMENTS = Form("RGB8", "SEGMENTATION_BY_ID", 3, np.uint8)


class FilamentRenderer:
    """Draws states of one model at one size. To be used, and closed, in the thread that made it.

    Filament's colours carry noise that goes on from picture to picture: drawn again, a pixel differs by a grey
    level, seldom by more at an edge. Depth and ids do not. A film that one process draws is the same each time.

    Args:
      model: read only.
      size: width and height of a frame [pixels].
      backend: of `backend.VulkanSearch`.
      visual: flags, groups, frames and quality.
      segmentation: what ids tell apart.
      decors: what is added to colour pictures.

    Raises:
      UsageError: Filament cannot draw what `visual` asks for, or not that large.
      DrawError: Vulkan refused.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        backend: Backend,
        visual: Visual,
        segmentation: Segmentation | None = None,
        decors: Sequence[Decor] = (),
    ) -> None:
        check_size(size, backend, visual)
        check_visual(model, visual)
        check_segmentation(segmentation)
        self.size = size
        self._model, self._visual, self._decors = model, visual, decors
        self._segmentation = segmentation
        self._data = mujoco.MjData(model)
        self._index, self._phase = 0, 0.0
        self._scene = mujoco.MjvScene(model, GEOMS)
        self._options = visual.options()
        self._camera = mujoco.MjvCamera()
        visual.set_flags(self._scene)
        self._wanted = _flags(self._options, self._scene)
        self._colors = Form("RGB8", _mode(self._wanted), 3, np.uint8)
        try:
            self._stage: Stage | None = Stage(model, self._options)
        except (ImportError, RuntimeError) as error:
            raise DrawError(f"{backend.renderer} cannot draw with filament: {error}") from error
        self._update_scene()
        self._stage.hide_all_but({(geom.objtype, geom.objid) for geom in self._scene.geoms[: self._scene.ngeom]})

    def look(self, state: np.ndarray, phase: float, index: int = 0) -> None:
        """Goes to the instant of an integration `state`, which `picture` then shows.

        Everything drawn, contacts and forces included, belongs to that state.

        Args:
          phase: how far along the film it is, from 0 to 1, for cameras that move.
          index: of the frame, for decors.

        Raises:
          DrawError: MuJoCo ran out of memory.
        """
        assert self._stage
        restore(self._model, self._data, state)
        try:
            mujoco.mj_forward(self._model, self._data)
        except mujoco.FatalError as error:
            raise DrawError(f"MuJoCo failed at time {self._data.time:.9g} s: {error}") from error
        self._phase, self._index = phase, index
        self._stage.update(self._data)

    def picture(self, rig: Rig, views: Sequence[str] = ("rgb",)) -> Picture:
        """What is seen through `rig`, of the views `rgb`, `depth` and `seg`. Colours are reused by the next call."""
        assert self._stage
        rig.aim(self._camera, self._data, self._phase)
        self._update_scene()
        camera = average_camera(self._scene)
        seen = Picture(lens(camera, self.size))
        if "depth" in views or "seg" in views:
            seen = self._exact(self._stage, seen, camera, views)
        if "rgb" in views:
            for decor in self._decors:
                decor.add(self._scene, self._index)
            geoms = self._scene.geoms[: self._scene.ngeom]
            self._stage.decorate(geom for geom in geoms if geom.category == DECORATION)
            seen = replace(seen, rgb=self._shown(camera, shadows=True))
        return seen

    def draft_cost(self) -> float:
        """Seconds to draw the last scene once more without shadows."""
        camera = average_camera(self._scene)
        self._shown(camera, shadows=False)  # the first draw of a kind compiles shaders
        start = time.perf_counter()
        self._shown(camera, shadows=False)
        return time.perf_counter() - start

    def close(self) -> None:
        """Frees what the graphics driver holds."""
        self._stage = None

    def __enter__(self) -> "FilamentRenderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _update_scene(self) -> None:
        while True:
            mujoco.mjv_updateScene(self._model, self._data, self._options, None, self._camera, EVERYTHING, self._scene)
            if self._scene.ngeom + sum(decor.geoms for decor in self._decors) < self._scene.maxgeom:
                return
            self._scene = mujoco.MjvScene(self._model, 2 * self._scene.maxgeom)

    def _exact(self, stage: Stage, seen: Picture, camera: mujoco.MjvGLCamera, views: Sequence[str]) -> Picture:
        """Depth and ids, which end at the far plane; colours do not."""
        depth = _metres(stage.draw(self.size, camera, DEPTH)[:, :, 0], camera)
        if "depth" in views:
            seen = replace(seen, depth=depth)
        if "seg" in views:
            assert self._segmentation
            segments = stage.draw(self.size, camera, SEGMENTS) @ np.array([1, 2**8, 2**16], np.int32)
            ids = np.where(np.isfinite(depth), self._ids(self._segmentation)[segments], NOTHING)
            seen = replace(seen, ids=ids, legend=self._segmentation.legend)
        return seen

    def _shown(self, camera: mujoco.MjvGLCamera, shadows: bool) -> np.ndarray:
        assert self._stage
        (width, height), n = self.size, self._visual.samples
        pixels = self._stage.draw(
            (n * width, n * height),
            camera,
            self._colors,
            shadows=shadows and bool(self._wanted["shadow"]),
            reflections=MIRRORS and bool(self._wanted["reflection"]),
            **{name: bool(self._wanted[name]) for name in ("skybox", "haze", "post_processing")},
        )
        if n == 1:
            return pixels
        blocks = pixels.reshape(height, n, width, n, 3)
        return ((blocks.sum(axis=(1, 3), dtype=np.uint16) + n * n // 2) // (n * n)).astype(np.uint8)

    def _ids(self, segmentation: Segmentation) -> np.ndarray:
        """The id of each of Filament's numbers; number 0 is nothing."""
        known = segmentation.ids(self._scene)
        counts = [getattr(self._model, COUNTS[kind]) for kind in NUMBERED]
        first = {int(KINDS[kind]): 1 + sum(counts[:i]) for i, kind in enumerate(NUMBERED)}
        found = np.full(1 + sum(counts), NOTHING, np.int32)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.objtype in first and geom.segid >= 0:
                found[first[geom.objtype] + geom.objid] = known[geom.segid + 1]
        return found


def check_visual(model: mujoco.MjModel, visual: Visual) -> None:
    """Refuses what Filament cannot draw, and warns of what it leaves out of `model`.

    Raises:
      UsageError: names the option, and what to do instead.
    """
    if visual.label != "none":
        raise UsageError(f"--label {visual.label}: filament cannot write\n{CLASSIC}")
    scene = mujoco.MjvScene(model, 1)
    usual = _flags(mujoco.MjvOption(), scene)
    visual.set_flags(scene)
    wanted = _flags(visual.options(), scene)
    for name, instead in REFUSED.items():
        if wanted[name] != usual[name]:
            raise UsageError(f"{_spelt(name, wanted)}: filament cannot do that\n{instead}")
    modes = [_spelt(name, wanted) for name, (value, _) in MODES.items() if wanted[name] == value]
    if len(modes) > 1:
        raise UsageError(f"{' and '.join(modes)}: filament can do one at a time\n{CLASSIC} do both")
    if MIRRORS:
        return
    if "reflection" in visual.show:
        raise UsageError(f"--show reflection: filament draws reflections upside down\n{CLASSIC}")
    if wanted["reflection"] and _reflects(model):
        text = "filament would draw reflections upside down and leaves them out, as --hide reflection does"
        warnings.warn(text, MjrunWarning, stacklevel=3)


def check_segmentation(segmentation: Segmentation | None) -> None:
    """Raises UsageError when Filament numbers nothing of what is to be told apart."""
    kinds = {thing.type for thing in segmentation.legend} if segmentation else set()
    if kinds and kinds <= {"joint", "camera", "light"}:
        raise UsageError(f"segmentation by {', '.join(kinds)}: filament can only tell apart the model's own\n{CLASSIC}")


def _flags(options: mujoco.MjvOption, scene: mujoco.MjvScene) -> dict[str, int]:
    """All flags of the visualizer and of rendering, by name."""
    visual, rendering = members(mujoco.mjtVisFlag), members(mujoco.mjtRndFlag)
    return {name: int(options.flags[i]) for name, i in visual.items()} | {
        name: int(scene.flags[i]) for name, i in rendering.items()
    }


def _mode(wanted: dict[str, int]) -> str:
    return next((mode for name, (value, mode) in MODES.items() if wanted[name] == value), "DEFAULT")


def _spelt(name: str, wanted: dict[str, int]) -> str:
    return f"--{'show' if wanted[name] else 'hide'} {name}"


def _reflects(model: mujoco.MjModel) -> bool:
    """Whether the material of a plane or a box mirrors."""
    flat = np.isin(model.geom_type, [mujoco.mjtGeom.mjGEOM_PLANE.value, mujoco.mjtGeom.mjGEOM_BOX.value])
    materials = model.geom_matid[flat]
    return bool(model.mat_reflectance[materials[materials >= 0]].any())


def _metres(buffer: np.ndarray, camera: mujoco.MjvGLCamera) -> np.ndarray:
    """Planar depth [m] of Filament's, which is 1 at the near plane and 0 at the far one; infinite where that is 0."""
    near, far, values = float(camera.frustum_near), float(camera.frustum_far), buffer.astype(np.float64)
    with np.errstate(divide="ignore"):
        depth = far - (far - near) * values if camera.orthographic else near * far / (near + (far - near) * values)
    return np.where(values > 0, depth, np.inf).astype(np.float32)
