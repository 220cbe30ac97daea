"""MuJoCo's classic OpenGL renderer, applied to recorded states."""

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, lens, metric_depth
from mjrun.errors import DrawError, UsageError, option
from mjrun.model.camera_images import CameraImages
from mjrun.model.names import enum_members
from mjrun.model.state import restore
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.backend import OpenGLContext, WorkingBackend, require_own_opengl
from mjrun.rendering.visual import SegmentationIds, Visual, downsampled, updated_scene

GEOMS = 10_000  # initial capacity of the scene; it grows
FONTS = (50, 100, 150, 200, 250, 300)  # percent
COSTLY = ("shadow", "reflection")
# Arrays of a model that a context copies when it is made.
MESHES = ("mesh_vert", "mesh_face", "mesh_normal", "mesh_texcoord", "mesh_graph", "hfield_data")
SURFACES = ("skin_vert", "skin_face", "skin_texcoord", "flex_vertnum", "flex_elem", "flex_texcoord")
TEXTURES = ("tex_data", "tex_adr", "tex_type", "tex_height", "tex_width")
PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
OFFSCREEN = mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value


class ClassicRenderer:
    """A renderer of one model at one size. To be used in the thread that created it, and closed.

    Args:
      model: read only; its framebuffer size is ignored, any `size` can be rendered.
      size: width and height of a frame [pixels].
      backend: a working backend, from `BackendDetector`.
      visual: flags, groups, frames, labels and quality.
      segmentation: the grouping of ids.
      decorations: additions to colour images, of which geoms are used.

    Raises:
      UsageError: the frame is larger than the backend's maximum.
      DrawError: OpenGL failed.
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
        self.size = size
        self._model, self._visual, self._decors = model, visual, decorations
        self._segmentation = segmentation
        check_size(size, backend, visual)
        _check_shadows(model, backend)
        width, height = (side * visual.samples for side in size)
        self._data = mujoco.MjData(model)
        self._index = 0
        self._has_shadows = False
        self._scene = mujoco.MjvScene(model, GEOMS)
        self._options = visual.options()
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)
        visual.set_flags(self._scene)
        self._fixed = self._fixed_settings(model)
        self._gl: OpenGLContext | None = None
        self._context: mujoco.MjrContext | None = None
        self._buffer: SingleSampleFramebuffer | None = None  # made when it is needed
        try:
            self._gl = backend.context(width, height)
            self._has_shadows = self._needs_shadows(model)
            self._context = _offscreen(model, width, height, visual.quality, self._has_shadows)
        except Exception as error:
            self.close()
            if isinstance(error, DrawError):
                raise
            raise DrawError(f"{backend.renderer} cannot draw {width}x{height}: {error}") from error

    def set_state(self, state: np.ndarray, index: int = 0) -> None:
        """Moves the model to an integration `state`, which `render` then renders.

        Everything in the image, contacts and forces included, belongs to that state.

        Args:
          index: index of the frame, for decorations.

        Raises:
          DrawError: MuJoCo ran out of memory.
        """
        restore(self._model, self._data, state)
        try:
            mujoco.mj_forward(self._model, self._data)
        except mujoco.FatalError as error:
            raise DrawError(f"MuJoCo failed at time {self._data.time:.9g} s: {error}") from error
        self._index = index

    def render(self, pose: CameraPose, views: Sequence[str] = ("rgb",)) -> CameraImages:
        """Renders the views from `pose`: `rgb`, `depth` or `seg`. The array of colours is reused by the next call."""
        self._update_scene(pose)
        seen = CameraImages(lens(pose, self.size))
        if "depth" in views or "seg" in views:
            seen = self._exact(seen, pose, views)
        if "rgb" in views:
            for decoration in self._decors:
                decoration.add(self._scene, self._index)
            self._render()
            upright = self._pixels[::-1]  # OpenGL's rows run upward
            seen = replace(seen, rgb=downsampled(upright, self._visual.samples))
        return seen

    def can_show(self, model: mujoco.MjModel) -> bool:
        """Returns whether a model has the same meshes, textures, height fields, skins, flexes and drawing buffers.

        Of the model that is shown, only its visual settings may have changed.
        """
        if self._fixed_settings(model) != self._fixed or self._needs_shadows(model) > self._has_shadows:
            return False
        return model is self._model or all(
            np.array_equal(getattr(model, name), getattr(self._model, name)) for name in (*MESHES, *SURFACES, *TEXTURES)
        )

    def show(self, model: mujoco.MjModel, segmentation: SegmentationIds | None) -> None:
        """Replaces the model by one that `can_show` accepts, and directs this thread's OpenGL calls to the renderer."""
        self._model, self._data, self._segmentation = model, mujoco.MjData(model), segmentation
        self.make_current()

    def make_current(self) -> None:
        """Directs this thread's OpenGL calls to this renderer, if another one has been used since."""
        require_own_opengl()
        assert self._gl
        assert self._context
        try:
            self._gl.make_current()
        except Exception as error:  # of the library of the backend
            reason = "one thread at a time can use an OpenGL context, and another thread uses it"
            raise DrawError(f"{reason}\nrender, and ask for frames, in one thread") from error
        mujoco.mjr_setBuffer(OFFSCREEN, self._context)

    def draft_cost(self) -> float:
        """Returns the time to render the last scene again without shadows and reflections [s]."""
        with self._flags(**dict.fromkeys(COSTLY, False)):
            self._render()  # the first draw of a kind compiles shaders
            start = time.perf_counter()
            self._render()
            return time.perf_counter() - start

    def close(self) -> None:
        """Frees the driver's resources; without it, EGL prints tracebacks at exit."""
        if self._context is not None:
            with contextlib.suppress(DrawError):
                self.make_current()  # or else objects with the same numbers in another context would be freed
        if self._buffer is not None:
            self._buffer.free()
        if self._context is not None:
            self._context.free()
        if self._gl is not None:
            self._gl.free()
        self._buffer = self._context = self._gl = None

    def _fixed_settings(self, model: mujoco.MjModel) -> tuple[float, ...]:
        """Returns the settings that OpenGL keeps: of buffers, of the triangles of shapes, of materials, and of fog."""
        quality, distances, extent = model.vis.quality, model.vis.map, model.stat.extent
        fixed = quality.shadowsize, quality.offsamples, quality.numslices, quality.numstacks, quality.numquads
        planes = model.geom_size[model.geom_type == PLANE]
        if (planes[:, :2] <= 0).any():  # infinite: drawn up to the far clipping plane
            fixed = *fixed, extent, distances.zfar
        fixed = *fixed, *planes.ravel().tolist(), *model.mat_texid.ravel().tolist()
        if not self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG]:
            return fixed
        return *fixed, extent * distances.fogstart, extent * distances.fogend, *model.vis.rgba.fog.tolist()

    def _needs_shadows(self, model: mujoco.MjModel) -> bool:
        return bool(self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] and model.light_castshadow.any())

    def _update_scene(self, pose: CameraPose) -> None:
        room = sum(decoration.geoms for decoration in self._decors)
        self._scene = updated_scene(self._model, self._data, self._options, pose, self._scene, room)

    def _exact(self, seen: CameraImages, pose: CameraPose, views: Sequence[str]) -> CameraImages:
        """Renders depth and ids in one pass without shading."""
        if self._buffer is None:
            self._buffer = SingleSampleFramebuffer(self.size)
        with self._flags(segment=True, idcolor=True, depth=False, **dict.fromkeys(COSTLY, False)):
            colors, depth = self._buffer.draw(self._scene, self._context)
        if "depth" in views:
            seen = replace(seen, depth=metric_depth(depth, pose.frustum))
        if "seg" in views:
            assert self._segmentation
            ids = np.take(self._segmentation.ids(self._scene), _segments(colors, self._scene.ngeom))
            seen = replace(seen, ids=ids, legend=self._segmentation.legend)
        return seen

    @contextlib.contextmanager
    def _flags(self, **wanted: bool) -> Iterator[None]:
        """Sets rendering flags within the block."""
        previous, indices = self._scene.flags.copy(), enum_members(mujoco.mjtRndFlag)
        for name, value in wanted.items():
            self._scene.flags[indices[name]] = value
        try:
            yield
        finally:
            self._scene.flags[:] = previous

    def _render(self) -> None:
        _update_context(self._context, self._model)
        mujoco.mjr_render(self._rect, self._scene, self._context)
        mujoco.mjr_readPixels(self._pixels, None, self._rect, self._context)


def _update_context(context: mujoco.MjrContext | None, model: mujoco.MjModel) -> None:
    """Writes the visual settings of a model that a context has copied and reads again, as mjr_makeContext does."""
    assert context
    extent, distances = model.stat.extent, model.vis.map
    context.lineWidth = model.vis.global_.linewidth
    context.shadowClip, context.shadowScale = extent * distances.shadowclip, distances.shadowscale


def _segments(colors: np.ndarray, most: int) -> np.ndarray:
    """Decodes segment ids `(h, w)` from colours `(h, w, 3)`, lowest byte first; none exceeds `most`."""
    segments = colors[:, :, 0]
    for channel in (1, 2):
        if most >= 2 ** (8 * channel):
            segments = segments | colors[:, :, channel].astype(np.int32) << 8 * channel
    return segments


def check_size(size: tuple[int, int], backend: WorkingBackend, visual: Visual) -> None:
    """Raises UsageError if the size exceeds the backend's maximum."""
    if max(size) * visual.samples > backend.max_size:
        raise UsageError(
            f"{option('size')} {size[0]}x{size[1]} is too large: {backend.renderer} renders at most "
            f"{backend.max_size // visual.samples} pixels a side at {option('quality')} {visual.quality}"
        )


def _check_shadows(model: mujoco.MjModel, backend: WorkingBackend) -> None:
    """Raises DrawError if the model's shadow maps exceed the backend's maximum, which crashes some drivers."""
    if (size := model.vis.quality.shadowsize) > backend.max_size:
        raise DrawError(
            f"vis.quality.shadowsize of the model, {size}, is too large: {backend.renderer} renders at most "
            f"{backend.max_size} pixels a side\n{option('set')} vis.quality.shadowsize=4096 reduces it"
        )


def _offscreen(model: mujoco.MjModel, width: int, height: int, quality: str, has_shadows: bool) -> mujoco.MjrContext:
    """Creates a context whose offscreen buffer has exactly this size, regardless of the model's."""
    view, detail = model.vis.global_, model.vis.quality
    previous = view.offwidth, view.offheight, detail.offsamples, detail.shadowsize
    view.offwidth, view.offheight = width, height
    if quality == "draft":
        detail.offsamples = 0
    if not has_shadows:
        detail.shadowsize = 0  # a map takes 64 MB and, in software, most of the time until the first image
    try:
        font = min(FONTS, key=lambda percent: abs(percent - height / 4.8))
        context = mujoco.MjrContext(model, font)
    finally:
        view.offwidth, view.offheight, detail.offsamples, detail.shadowsize = previous
    mujoco.mjr_setBuffer(OFFSCREEN, context)
    return context


class SingleSampleFramebuffer:
    """A framebuffer for one image without multisampling. To be used in the thread of its OpenGL context, and freed.

    Args:
      size: width and height [pixels].

    Raises:
      DrawError: OpenGL failed.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        from OpenGL import GL  # which detects its platform when it is imported

        self._gl: Any = GL
        width, height = size
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._colors, self._depth = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        self._frame = GL.glGenFramebuffers(1)
        self._parts = GL.glGenRenderbuffers(2)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._frame)
        kinds = ((GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8), (GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT32F))
        for part, (place, kind) in zip(self._parts, kinds, strict=True):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, part)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, width, height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, part)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise DrawError(f"OpenGL cannot create a framebuffer of {width}x{height} with 32-bit depth")

    def draw(self, scene: mujoco.MjvScene, context: mujoco.MjrContext) -> tuple[np.ndarray, np.ndarray]:
        """Renders `scene`, whose flags request ids as colours.

        Returns:
          Colours `(h, w, 3)` uint8, and OpenGL's depth `(h, w)` float32, 1 near and 0 far, as MuJoCo reverses it. Both
          arrays are reused by the next call.
        """
        self._bind()
        mujoco.mjr_render(self._rect, scene, context)
        self._bind()  # rendering a shadow map may have bound another
        place = (0, 0, self._rect.width, self._rect.height)
        self._gl.glPixelStorei(self._gl.GL_PACK_ALIGNMENT, 1)
        self._gl.glReadPixels(*place, self._gl.GL_RGB, self._gl.GL_UNSIGNED_BYTE, self._colors)
        self._gl.glReadPixels(*place, self._gl.GL_DEPTH_COMPONENT, self._gl.GL_FLOAT, self._depth)
        mujoco.mjr_restoreBuffer(context)
        return self._colors[::-1], self._depth[::-1]  # OpenGL's rows run upward

    def free(self) -> None:
        """Frees the driver's resources."""
        self._gl.glDeleteFramebuffers(1, [self._frame])
        self._gl.glDeleteRenderbuffers(2, self._parts)

    def _bind(self) -> None:
        self._gl.glBindFramebuffer(self._gl.GL_FRAMEBUFFER, self._frame)
        self._gl.glDrawBuffer(self._gl.GL_COLOR_ATTACHMENT0)
        self._gl.glReadBuffer(self._gl.GL_COLOR_ATTACHMENT0)
