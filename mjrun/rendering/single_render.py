"""Rendering of a state in one call."""

import atexit
import contextlib
import threading
from collections import OrderedDict
from typing import Any

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose
from mjrun.camera.rigs.rig import MujocoCameras, compute_positions
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import BadValueError, UnknownNameError, UsageError, concerning, option
from mjrun.model.state import SIZES, restore, save
from mjrun.options.number_kinds import SizeKind
from mjrun.options.option import converted
from mjrun.options.rendering import VIEWS
from mjrun.rendering.backend import BackendDetector
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.visual import SegmentationIds, Visual

CACHED = 4  # renderers kept for the next call, in all threads together
CACHED_CAMERAS = 8  # cameras kept for the next call by each renderer; each has an MjData


def render(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: str | int | mujoco.MjvCamera = "free",
    size: tuple[int, int] = (640, 480),
    view: str = "rgb",
    visual: Visual | None = None,
) -> np.ndarray:
    """Renders the state in `data`, which is not changed.

    Positions, contacts and forces are computed again from the state (mjSTATE_INTEGRATION). The renderer is cached for
    calls with the same model, size and `visual`: changed positions, colours and visual settings of the model take
    effect, changed meshes, textures and height fields do not.

    Args:
      camera: as on the command line: a camera of the model by name or index, `free`, `orbit:lookat=box,distance=2`,
        `track:hand`; or MuJoCo's own structure.
      size: width and height [pixels].
      view: `rgb`, `depth` or `seg`.
      visual: visual options; MuJoCo's defaults when None.

    Returns:
      `rgb`: `(height, width, 3)` uint8. `depth`: `(height, width)` float32, along the axis of view [m], infinite for
      the background. `seg`: `(height, width)` int32, indices into `mjrun.SegmentationIds(model).legend`, -1 for none.

    Raises:
      UsageError: an argument has the wrong type, the camera or the view is unknown, the size is invalid or too large,
        or `data` belongs to another model.
      NoRendererError: no backend works; the message gives the packages to install.
      DrawError: OpenGL failed.
    """
    if view not in VIEWS:
        raise UnknownNameError(option("view"), str(view), VIEWS, plural="views")
    size = converted(option("size"), SizeKind(), size)
    visual = Visual() if visual is None else visual
    _check(model, data, visual)
    cached = _cached_renderer(model, size, visual)
    state = save(model, data)
    with concerning("camera"):
        pose = cached.pose(camera, state)
    cached.renderer.make_current()
    cached.renderer.set_state(state)
    picture = cached.renderer.render(pose, (view,))
    image = {"rgb": picture.rgb, "depth": picture.depth, "seg": picture.ids}[view]
    assert image is not None
    return np.array(image)


def _check(model: Any, data: Any, visual: Any) -> None:
    """Checks the types of the arguments, and that the state in `data` is one of `model`, or of a variant of it."""
    if not isinstance(model, mujoco.MjModel):
        raise BadValueError("model", model, "an MjModel; mjrun.load returns that of a file")
    if not isinstance(data, mujoco.MjData):
        raise BadValueError("data", data, "an MjData")
    if not isinstance(visual, Visual):
        raise BadValueError("visual", visual, "an mjrun.Visual")
    for name in SIZES:
        own, other = getattr(model, name), getattr(data.model, name)
        if own != other:
            raise UsageError(f"data: it belongs to another model, with {name} {other} instead of {own}")


class _CachedRenderer:
    """A renderer with the cameras that it has already resolved."""

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int], visual: Visual) -> None:
        self.model, self.size = model, size
        self.renderer = ClassicRenderer(model, size, BackendDetector().result(), visual, SegmentationIds(model))
        self._data = mujoco.MjData(model)
        self._cameras = MujocoCameras(model)
        self._motions = OrderedDict[str, BoundCameraScript]()
        self._free_camera = _free_camera(model)

    def pose(self, camera: str | int | mujoco.MjvCamera, state: np.ndarray) -> CameraPose:
        """Returns the pose of the camera in `state`."""
        if (free_camera := _free_camera(self.model)) != self._free_camera:  # which rigs have copied
            self._free_camera, self._cameras = free_camera, MujocoCameras(self.model)
            self._motions.clear()
        if isinstance(camera, mujoco.MjvCamera):
            restore(self.model, self._data, state)
            compute_positions(self.model, self._data)
            return self._cameras.pose(self._data, camera)
        text = str(camera)
        if text not in self._motions:
            self._motions[text] = BoundCameraScript(parse_camera(text, self.model), self.model, self.size)
        self._motions.move_to_end(text)
        if len(self._motions) > CACHED_CAMERAS:
            self._motions.popitem(last=False)
        return self._motions[text].pose(state)


def _free_camera(model: mujoco.MjModel) -> tuple[float, ...]:
    """Returns the numbers of the free camera, which follow from the statistics and visual settings of the model."""
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    distances = model.vis.map.znear, model.vis.map.zfar
    lens = model.vis.global_.fovy, camera.orthographic, model.stat.extent, *distances
    return *camera.lookat, camera.distance, camera.azimuth, camera.elevation, *lens


_renderers: OrderedDict[tuple[int, int, tuple[int, int], str], _CachedRenderer] = OrderedDict()
_lock = threading.Lock()
_local = threading.local()


class _EndOfThread:
    """The only reference to it is local to a thread: Python deletes it in that thread, as the thread ends."""

    def __init__(self) -> None:
        self._thread, self._renderers = threading.get_ident(), _renderers  # globals are gone when Python ends

    def __del__(self) -> None:
        for key in [key for key in [*self._renderers] if key[0] == self._thread]:
            self._renderers.pop(key).renderer.close()


def _cached_renderer(model: mujoco.MjModel, size: tuple[int, int], visual: Visual) -> _CachedRenderer:
    """Returns a renderer of this thread. It holds the model, so that no other model can have the same id."""
    width, height = size
    key = threading.get_ident(), id(model), (width, height), repr(visual)
    with _lock:
        if key in _renderers and not _renderers[key].renderer.can_show(model):
            _renderers.pop(key).renderer.close()
        if key not in _renderers:
            _renderers[key] = _CachedRenderer(model, (width, height), visual)
            _local.end = getattr(_local, "end", None) or _EndOfThread()
            atexit.unregister(close_renderers)
            atexit.register(close_renderers)  # after the backend's handlers, and so run before them
        _renderers.move_to_end(key)
        oldest = next((other for other in _renderers if other[0] == key[0]), key)
        if len(_renderers) > CACHED and oldest != key:
            _renderers.pop(oldest).renderer.close()
        return _renderers[key]


def close_renderers() -> None:
    """Frees all cached renderers."""
    while _renderers:
        _, cached = _renderers.popitem()
        with contextlib.suppress(Exception):  # its thread may have ended
            cached.renderer.close()
