"""The server in Filament's process, which renders what `filament.FilamentRenderer` requests."""

import copy
import importlib
import itertools
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence, Set
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, Frustum, lens, pose_of
from mjrun.errors import DrawError, UsageError, option
from mjrun.model.camera_images import CameraImages
from mjrun.model.names import COUNTS, KINDS, enum_members
from mjrun.model.state import restore
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.filament import MIRRORS, MODES, flags
from mjrun.rendering.visual import NOTHING, SegmentationIds, Visual, downsampled, updated_scene
from mjrun.scene_graph.walk import lit_distance

SPOT, POINT = mujoco.mjtLightType.mjLIGHT_SPOT.value, mujoco.mjtLightType.mjLIGHT_POINT.value
# Settings of Filament for models made for the classic renderer, whose lights have no intensity.
LIGHTS, HEADLIGHT = 80_000.0, 40_000.0  # [lux] of all lights together, and of the headlight
_GEOMS = enum_members(mujoco.mjtGeom)
SHAPELESS, MESHES = {_GEOMS["label"], _GEOMS["none"]}, {_GEOMS["mesh"], _GEOMS["sdf"]}
SHAPES = set(_GEOMS.values()) - SHAPELESS - MESHES - {_GEOMS["hfield"], _GEOMS["flex"], _GEOMS["skin"]}
NUMBERED = ("geom", "site", "flex", "skin", "tendon", "actuator")  # in the order of their numbers in segments
WHOLE = ("geom", "site", "skin")
FRUSTUM = ("center", "width", "bottom", "top", "near", "far")
GEOMS = 2_000  # initial capacity of the scene; it grows
DECORATION = mujoco.mjtCatBit.mjCAT_DECOR.value


class PixelFormat(NamedTuple):
    """A format of pixels, by mjrf's names of the format and of the draw mode."""

    pixel: str
    mode: str
    channels: int
    dtype: type


class FilamentScene:
    """Filament's scene of one model, with its render targets."""

    def __init__(self, model: mujoco.MjModel, options: mujoco.MjvOption) -> None:
        importlib.import_module("mujoco.studio")  # registers the materials
        self._mjrf = mjrf = importlib.import_module("mujoco.mjrf")
        self._model = model
        self._context = mjrf.Context(mjrf.ContextConfig(graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN))
        self._context.set_clear_color(_custom(model, "filament.clear_color", (0, 0, 0))[:3])
        resources = mjrf.ModelResources(self._context, model)
        self._scene = self._context.create_scene(mjrf.SceneParams())
        self._scene.configure_from_model(model)
        self._lights = mjrf.ModelLights(self._scene, resources)
        self._renderables = mjrf.ModelRenderables(self._scene, resources)
        self._renderables.set_options(_tendons_in_groups(options))
        self._intensities, self._headlight = fallback_lighting(model)
        self._decorations: dict[tuple[int, int], list[Any]] = defaultdict(list)  # reusable renderables of each kind
        self._meshes: dict[int, tuple[Any, ...]] = {}
        self._targets: dict[tuple[int, int, PixelFormat], tuple[Any, Any, np.ndarray]] = {}

    def update(self, data: mujoco.MjData) -> None:
        """Moves the model."""
        self._lights.update(data)
        for index, intensity in self._intensities.items():
            self._lights.get_light(index).set_intensity(intensity.candela)
            self._lights.get_light(index).set_range(intensity.range)
        self._renderables.update(data)

    def hide_all_but(self, shown: Set[tuple[int, int]]) -> None:
        """Hides the model's objects that MuJoCo would not render: those whose object type and id are not in `shown`.

        Filament respects groups but ignores some flags, and renders static and fully transparent objects regardless.
        """
        for kind in NUMBERED:
            for index in range(getattr(self._model, COUNTS[kind])):
                if (int(KINDS[kind]), index) not in shown and kind != "tendon":  # these come and go
                    for renderable in self._parts(kind, index):
                        self._scene.remove_renderable(renderable)

    def decorate(self, geoms: Iterable[mujoco.MjvGeom]) -> None:
        """Replaces the added geoms by these, which appear in colour images only, without shadows.

        Raises:
          UsageError: a geom has a type that Filament renders only as a part of the model.
        """
        used: Counter[tuple[int, int]] = Counter()
        for geom in geoms:
            if geom.type not in SHAPELESS and geom.size[0] < mujoco.mjMAXVAL:  # not a plane's bounding box
                kind = (geom.type, geom.dataid if geom.type in MESHES else -1)
                self._show(geom, kind, used[kind])
                used[kind] += 1
        for kind, made in self._decorations.items():
            for spare in made[used[kind] :]:
                self._scene.remove_renderable(spare)

    def draw(self, size: tuple[int, int], pose: CameraPose, pixel_format: PixelFormat, **flags: bool) -> np.ndarray:
        """Renders pixels `(height, width, channels)`, which the next image of that format overwrites.

        Args:
          size: width and height [pixels].
          flags: flags of mjrf.RenderRequest; those not given are on.
        """
        target, reading, pixels = self._target(*size, pixel_format)
        light, ends = self._model.vis.headlight, {f"frustum_{name}": getattr(pose.frustum, name) for name in FRUSTUM}
        request = self._mjrf.RenderRequest(
            scene=self._scene,
            target=target,
            camera=self._mjrf.Camera(
                pose.position, pose.forward, pose.up, **ends, orthographic=pose.frustum.orthographic
            ),
            viewport=self._mjrf.Rect(0, 0, *size),
            draw_mode=getattr(self._mjrf.DrawMode, f"DRAW_MODE_{pixel_format.mode}"),
            headlight=light.active != 0,
            headlight_color=light.diffuse,
            headlight_intensity=self._headlight,
            **flags,
        )
        self._context.wait_for_frame(self._context.render([request], [reading]))  # takes one reading only
        return pixels

    def _target(self, width: int, height: int, pixel_format: PixelFormat) -> tuple[Any, Any, np.ndarray]:
        """Returns a render target, the request that reads it, and the pixels that are read."""
        if (width, height, pixel_format) not in self._targets:
            pixels = np.empty((height, width, pixel_format.channels), pixel_format.dtype)
            formats = self._mjrf.PixelFormat
            target = self._context.create_render_target(
                self._mjrf.RenderTargetConfig(
                    width=width,
                    height=height,
                    color_format=getattr(formats, f"PIXEL_FORMAT_{pixel_format.pixel}"),
                    depth_format=formats.PIXEL_FORMAT_DEPTH32F,
                )
            )
            reading = self._mjrf.ReadRequest(target=target)
            reading.set_buffer(pixels)
            self._targets[width, height, pixel_format] = target, reading, pixels
        return self._targets[width, height, pixel_format]

    def _parts(self, kind: str, index: int) -> Iterable[Any]:
        """Returns the renderables of one object: a single one, or one for each part."""
        renderable = self._renderables.get_renderable
        if kind in WHOLE:
            return [renderable(KINDS[kind], index)]
        return itertools.takewhile(bool, (renderable(KINDS[kind], index, part) for part in itertools.count()))

    def _show(self, geom: mujoco.MjvGeom, kind: tuple[int, int], number: int) -> None:
        made = self._decorations[kind]
        if number == len(made):
            made.append(self._renderable(*kind))
        made[number].set_pose(geom.pos, geom.mat.ravel())
        if geom.type not in MESHES:
            made[number].set_size(geom.size)
        made[number].set_material(self._mjrf.Material(color=geom.rgba, decor=True))
        self._scene.add_renderable(made[number])

    def _renderable(self, shape: int, data: int) -> Any:
        if shape not in SHAPES | MESHES:
            name = next(name for name, value in _GEOMS.items() if value == shape)
            message = f"filament cannot render a {name} that is not part of the model"
            raise UsageError(f"{message}\n{option('renderer')} classic can")
        shadeless = self._mjrf.RenderableParams(cast_shadow=False, receive_shadow=False)
        renderable = self._context.create_renderable(shadeless)
        quality = self._model.vis.quality
        if shape in SHAPES:
            renderable.set_geom_mesh(mujoco.mjtGeom(shape), quality.numstacks, quality.numslices, quality.numquads)
        else:
            renderable.set_mesh(self._mesh(data // 2), 0, 0)  # as in MjvScene, odd ones are the convex hulls
        return renderable

    def _mesh(self, index: int) -> Any:
        """Uploads a mesh of the model with unshared vertices, since Filament does not expose its copies."""
        if index in self._meshes:
            return self._meshes[index][0]
        model, mjrf = self._model, self._mjrf
        faces = slice(model.mesh_faceadr[index], model.mesh_faceadr[index] + model.mesh_facenum[index])
        corners = model.mesh_vert[model.mesh_vertadr[index] + model.mesh_face[faces].ravel()]
        normals = model.mesh_normal[model.mesh_normaladr[index] + model.mesh_facenormal[faces].ravel()]
        usage, float3 = mjrf.VertexAttributeUsage, mjrf.VertexAttributeType.VERTEX_ATTRIBUTE_TYPE_FLOAT3
        config = mjrf.MeshConfig(
            max_vertices=len(corners),
            max_indices=len(corners),
            attributes=[
                mjrf.VertexAttribute(usage.VERTEX_ATTRIBUTE_USAGE_POSITION, float3),
                mjrf.VertexAttribute(usage.VERTEX_ATTRIBUTE_USAGE_NORMAL, float3),
            ],
            interleaved=False,
            index_type=mjrf.IndexType.INDEX_TYPE_U32,
            primitive_type=mjrf.MeshPrimitiveType.MESH_PRIMITIVE_TYPE_TRIANGLES,
        )
        content = mjrf.MeshData(compute_bounds=True)
        vertices = np.concatenate([corners, normals]).astype(np.float32).tobytes()
        indices = np.arange(len(corners), dtype=np.uint32).tobytes()
        content.set_vertices(config, vertices)
        content.set_indices(config, indices)
        mesh = self._context.create_mesh(config)
        mesh.upload(content)
        self._meshes[index] = mesh, content, vertices, indices  # kept alive: it may be read later
        return mesh


class LightIntensityAndRange(NamedTuple):
    """The intensity [cd] and the range [m] of a light."""

    candela: float
    range: float


def _tendons_in_groups(options: mujoco.MjvOption) -> mujoco.MjvOption:
    """Returns the options with hidden tendons hidden by their groups, since Filament ignores their flag."""
    filament_options = copy.copy(options)
    if not options.flags[mujoco.mjtVisFlag.mjVIS_TENDON]:
        filament_options.tendongroup[:] = 0
    return filament_options


def fallback_lighting(model: mujoco.MjModel) -> tuple[dict[int, LightIntensityAndRange], float]:
    """Returns the intensities of spot and point lights, by index, and that of the headlight [lux].

    Filament gives lights without an intensity the same number of candela, however far away they are, and a range of
    10 m: large scenes stay dark, and small ones burn out. Here a light of full diffuse colour sheds its share of
    `LIGHTS` [lux] on the surface that it lights at `qpos0`: by the inverse square law, that times its squared distance
    [cd]. Intensities that the model itself sets are unchanged.
    """
    if model.light_intensity.sum():
        return {}, 0.0
    headlight = _custom(model, "filament.fallback.head_light_intensity", (HEADLIGHT,))[0]
    if _custom(model, "filament.fallback.scene_light_intensity", ()):
        return {}, headlight

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    intensities = {}
    for light in np.flatnonzero(np.isin(model.light_type, (SPOT, POINT))).tolist():
        lux = LIGHTS / model.nlight * model.light_diffuse[light].max()
        distance = lit_distance(model, data, light)
        reach = max(float(model.light_range[light]), 5 * distance)
        intensities[light] = LightIntensityAndRange(float(lux * distance**2), reach)
    return intensities, headlight


def _custom(model: mujoco.MjModel, name: str, default: Sequence[float]) -> Sequence[float]:
    """Returns the numbers of a <custom> element of the model."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        return default
    start = model.numeric_adr[index]
    return model.numeric_data[start : start + model.numeric_size[index]].tolist()


DEPTH = PixelFormat("R32F", "DEPTH", 1, np.float32)
SEGMENTS = PixelFormat("RGB8", "SEGMENTATION_BY_ID", 3, np.uint8)


class FilamentServer:
    """A server that renders states of one model; methods and arguments are those of `FilamentRenderer`."""

    def open(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        visual: Visual,
        segmentation: SegmentationIds | None,
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

    def render(self, pose: CameraPose, views: Sequence[str]) -> CameraImages:
        """Renders the views from `pose`, without the legend, which the other process has."""
        self._pose = pose
        self._update_scene()
        seen = CameraImages(lens(pose, self._size))
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

    def _exact(self, seen: CameraImages, views: Sequence[str]) -> CameraImages:
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

    def _ids(self, segmentation: SegmentationIds) -> np.ndarray:
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
