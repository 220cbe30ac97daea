"""MuJoCo's physically based renderer, Filament, rendering recorded states through Vulkan in a separate process.

Filament aborts on errors, prints on stdout and leaks memory with every image. Unsupported features are refused if
requested, and otherwise reported by `omissions`: never omitted silently.
"""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose
from mjrun.child_process import IDLE
from mjrun.errors import DrawError, UsageError, option
from mjrun.model.camera_images import CameraImages
from mjrun.model.names import enum_members
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import check_size
from mjrun.rendering.visual import SegmentationIds, Visual
from mjrun.worker import Worker, WorkerEndedError

# Images per process: each leaks 1.5 MB with Mesa 22.3, less or nothing with drivers for GPUs. A count rather than a
# measured size, so that a video is the same each time.
LIFETIME = 200
MIRRORS = False  # under Vulkan, MuJoCo 4.0.0 renders reflections upside down

CLASSIC = f"{option('renderer')} classic can"
# Alternatives to a flag that Filament does not support.
REFUSED = {
    **dict.fromkeys(("additive", "cull_face", "flexvert", "flexedge", "flexface", "flexskin"), CLASSIC),
    **dict.fromkeys(("segment", "idcolor"), f"{option('view')} seg can"),
    "depth": f"{option('view')} depth can",
    "fog": f"{CLASSIC}; its own fog is the model's: <custom><numeric name='filament.fog.enabled' data='1'/></custom>",
}
# Modes of rendering the whole image, and the flag value that selects each.
MODES = {"wireframe": (1, "WIREFRAME"), "island": (1, "ISLANDS"), "texture": (0, "DEFAULT_NO_TEXTURES")}


class FilamentRenderer:
    """A renderer of one model at one size. To be closed.

    Filament's colours carry noise, whose sequence continues from image to image: rendered again, a pixel differs by one
    grey level, rarely by more at an edge. Depth and ids carry none. A video is the same each time if a single renderer
    renders all of it.

    Args:
      model: read only.
      size: width and height of a frame [pixels].
      backend: the backend that `VulkanDetector` has found.
      visual: flags, groups, frames and quality.
      segmentation: the grouping of ids, which applies to objects of the model and never to decorations.
      decorations: geoms added to colour images.

    Raises:
      UsageError: Filament does not support an option in `visual`, or this size.
      DrawError: Vulkan failed.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        backend: WorkingBackend,
        visual: Visual,
        segmentation: SegmentationIds | None = None,
        decorations: Sequence[Decoration] = (),
    ) -> None:
        check_size(size, backend, visual)
        check_visual(model, visual)
        check_segmentation(segmentation)
        self.size = size
        self._segmentation = segmentation
        self._task = (model, size, visual, segmentation, decorations)
        self._index, self._drawn = 0, 0
        self._shown_warnings: set[str] = set()
        self._worker = _started()
        try:
            self._ask("open", *self._task)
        except BaseException:
            self.close()
            raise

    def set_state(self, state: np.ndarray, index: int = 0) -> None:
        """Moves the model to an integration `state`, which `render` then renders.

        Everything in the image, contacts and forces included, belongs to that state.

        Args:
          index: index of the frame, for decorations.

        Raises:
          DrawError: MuJoCo ran out of memory, or Filament's process ended.
        """
        self._index = index
        if self._drawn >= LIFETIME:
            self._worker.close()
            self._worker, self._drawn = _started(), 0
            self._ask("open", *self._task)
        self._ask("set_state", state, index)

    def render(self, pose: CameraPose, views: Sequence[str] = ("rgb",)) -> CameraImages:
        """Renders the views from `pose`: `rgb`, `depth` or `seg`.

        Depth and ids end at the far plane, as in MuJoCo; colours do not.

        Raises:
          UsageError: a decoration adds a geom that Filament cannot render.
          DrawError: Filament's process ended.
        """
        self._drawn += 1
        picture = self._ask("render", pose, tuple(views))
        if self._segmentation and "seg" in views:
            return replace(picture, legend=self._segmentation.legend)
        return picture

    def draft_cost(self) -> float:
        """Returns the time to render the last scene again without shadows [s]."""
        return self._ask("draft_cost")

    def close(self) -> None:
        """Ends the process."""
        self._worker.close()

    def _ask(self, name: str, *arguments: Any) -> Any:
        self._worker.send(name, *arguments)
        try:
            reply = self._worker.receive(idle=IDLE)
        except WorkerEndedError as death:
            raise DrawError(f"filament's process {death}\n{option('renderer')} classic may work instead") from None
        for text in reply.warnings:
            if text not in self._shown_warnings:
                self._shown_warnings.add(text)
                warnings.warn(text, stacklevel=3)
        if reply.failure and name == "open":
            raise reply.failure.error("a rendering process cannot start", DrawError)
        if reply.failure:
            raise reply.failure.error(f"a bug in mjrun, rendering frame {self._index}")
        return reply.value


def _started() -> Worker:
    try:
        return Worker("mjrun.rendering.filament_worker:FilamentServer", environment={"MUJOCO_GL": "disable"})
    except OSError as error:
        raise DrawError(f"cannot start a process for filament: {error}") from error


def check_visual(model: mujoco.MjModel, visual: Visual) -> None:
    """Checks that Filament supports the visual options.

    Raises:
      UsageError: names the option and an alternative.
    """
    if visual.label != "none":
        raise UsageError(f"{option('label')} {visual.label}: filament cannot render text\n{CLASSIC}")
    if "reflection" in visual.show and not MIRRORS:
        raise UsageError(f"{option('show')} reflection: filament renders reflections upside down\n{CLASSIC}")
    usual, wanted = flags(mujoco.MjvOption(), mujoco.MjvScene(model, 1)), _wanted(model, visual)
    for name, instead in REFUSED.items():
        if wanted[name] != usual[name]:
            raise UsageError(f"{_option_text(name, wanted)}: filament cannot do that\n{instead}")
    modes = [_option_text(name, wanted) for name, (value, _) in MODES.items() if wanted[name] == value]
    if len(modes) > 1:
        raise UsageError(f"{' and '.join(modes)}: filament supports only one at a time\n{CLASSIC} do both")


def omissions(model: mujoco.MjModel, visual: Visual) -> list[str]:
    """Returns warnings about what Filament omits from images of `model` although it is not hidden."""
    if MIRRORS or not _wanted(model, visual)["reflection"] or not _reflects(model):
        return []
    advice = f"{option('hide')} reflection, or {option('renderer')} classic"
    return [f"filament omits reflections, which it would render upside down; {advice}"]


def check_segmentation(segmentation: SegmentationIds | None) -> None:
    """Raises UsageError if Filament renders none of the objects that a segmentation distinguishes."""
    kinds = {segment.type for segment in segmentation.legend} if segmentation else set()
    if kinds and kinds <= {"joint", "camera", "light"}:
        raise UsageError(f"filament cannot render a {min(kinds)} in a segmentation\n{CLASSIC}")


def flags(options: mujoco.MjvOption, scene: mujoco.MjvScene) -> dict[str, int]:
    """Returns all flags of the visualizer and of rendering, by name."""
    visual, rendering = enum_members(mujoco.mjtVisFlag), enum_members(mujoco.mjtRndFlag)
    return {name: int(options.flags[i]) for name, i in visual.items()} | {
        name: int(scene.flags[i]) for name, i in rendering.items()
    }


def _wanted(model: mujoco.MjModel, visual: Visual) -> dict[str, int]:
    scene = mujoco.MjvScene(model, 1)
    visual.set_flags(scene)
    return flags(visual.options(), scene)


def _option_text(name: str, wanted: dict[str, int]) -> str:
    return f"{option('show' if wanted[name] else 'hide')} {name}"


def _reflects(model: mujoco.MjModel) -> bool:
    """Returns whether the material of a plane or a box is reflective."""
    flat = np.isin(model.geom_type, [mujoco.mjtGeom.mjGEOM_PLANE.value, mujoco.mjtGeom.mjGEOM_BOX.value])
    materials = model.geom_matid[flat]
    return bool(model.mat_reflectance[materials[materials >= 0]].any())
