"""Filament's scene of a model: renderables that are moved, lights, and render targets.

The only module that uses `mujoco.mjrf`, which aborts the process where others raise. To be used in one thread.
"""

import copy
import importlib
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence, Set
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.camera.pose import Pose
from mjrun.errors import UsageError, option
from mjrun.model.names import COUNTS, KINDS, enum_members

SPOT, POINT = mujoco.mjtLightType.mjLIGHT_SPOT.value, mujoco.mjtLightType.mjLIGHT_POINT.value
# Of Filament, for models made for the classic renderer, whose lights have no intensity.
LIGHTS, HEADLIGHT = 80_000.0, 40_000.0  # [lux] of all lights together, and of the headlight
_GEOMS = enum_members(mujoco.mjtGeom)
SHAPELESS, MESHES = {_GEOMS["label"], _GEOMS["none"]}, {_GEOMS["mesh"], _GEOMS["sdf"]}
SHAPES = set(_GEOMS.values()) - SHAPELESS - MESHES - {_GEOMS["hfield"], _GEOMS["flex"], _GEOMS["skin"]}
NUMBERED = ("geom", "site", "flex", "skin", "tendon", "actuator")  # in the order of their numbers in segments
WHOLE = ("geom", "site", "skin")
FRUSTUM = ("center", "width", "bottom", "top", "near", "far")


class PixelFormat(NamedTuple):
    """The format of pixels, by mjrf's names of the format and of the draw mode."""

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
        self._intensities, self._headlight = _lighting(model)
        self._decorations: dict[tuple[int, int], list[Any]] = defaultdict(list)  # of each kind, to be used again
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
        """Hides things of the model, but for those of `shown`, as type of object and id, which MuJoCo would draw.

        Filament has an eye on groups, and none on static things, on what is wholly transparent, on some flags.
        """
        for kind in NUMBERED:
            for index in range(getattr(self._model, COUNTS[kind])):
                if (int(KINDS[kind]), index) not in shown and kind != "tendon":  # these come and go
                    for thing in self._parts(kind, index):
                        self._scene.remove_renderable(thing)

    def decorate(self, geoms: Iterable[mujoco.MjvGeom]) -> None:
        """Shows these geoms and no others beside the model, in colour pictures only, without shadows.

        Raises:
          UsageError: one is of a kind that Filament gets from the model alone.
        """
        used: Counter[tuple[int, int]] = Counter()
        for geom in geoms:
            if geom.type not in SHAPELESS and geom.size[0] < mujoco.mjMAXVAL:  # a plane's bounding box
                kind = (geom.type, geom.dataid if geom.type in MESHES else -1)
                self._show(geom, kind, used[kind])
                used[kind] += 1
        for kind, made in self._decorations.items():
            for spare in made[used[kind] :]:
                self._scene.remove_renderable(spare)

    def draw(self, size: tuple[int, int], pose: Pose, pixel_format: PixelFormat, **flags: bool) -> np.ndarray:
        """The pixels `(height, width, channels)`, which the next picture of that format overwrites.

        Args:
          flags: of mjrf.RenderRequest; what is not mentioned is on.
        """
        target, reading, pixels = self._target(*size, pixel_format)
        light = self._model.vis.headlight
        request = self._mjrf.RenderRequest(
            scene=self._scene,
            target=target,
            camera=self._seen_from(pose),
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
        """What is drawn into, how it is read, and where to."""
        if (width, height, pixel_format) not in self._targets:
            pixels, formats = (
                np.empty((height, width, pixel_format.channels), pixel_format.dtype),
                self._mjrf.PixelFormat,
            )
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

    def _seen_from(self, pose: Pose) -> Any:
        """The pose as mjrf's camera."""
        ends = {f"frustum_{name}": getattr(pose.frustum, name) for name in FRUSTUM}
        return self._mjrf.Camera(pose.position, pose.forward, pose.up, **ends, orthographic=pose.frustum.orthographic)

    def _parts(self, kind: str, index: int) -> Iterable[Any]:
        """What Filament draws of one thing: all of it, or part by part."""
        found = self._renderables.get_renderable
        if kind in WHOLE:
            return [found(KINDS[kind], index)]
        return itertools.takewhile(bool, (found(KINDS[kind], index, part) for part in itertools.count()))

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
            message = f"filament cannot draw a {name} that is not the model's own"
            raise UsageError(f"{message}\n{option('renderer')} classic can")
        found = self._context.create_renderable(self._mjrf.RenderableParams(cast_shadow=False, receive_shadow=False))
        quality = self._model.vis.quality
        if shape in SHAPES:
            found.set_geom_mesh(mujoco.mjtGeom(shape), quality.numstacks, quality.numslices, quality.numquads)
        else:
            found.set_mesh(self._mesh(data // 2), 0, 0)  # as in MjvScene, odd ones are the convex hulls
        return found

    def _mesh(self, index: int) -> Any:
        """A mesh of the model, each corner of each face a vertex of its own; Filament's copies cannot be had."""
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
        self._meshes[index] = mesh, content, vertices, indices  # it may be read later
        return mesh


class LightIntensity(NamedTuple):
    """What a light is set to: intensity [cd], and range [m]."""

    candela: float
    range: float


def _tendons_in_groups(options: mujoco.MjvOption) -> mujoco.MjvOption:
    """The same options, with the flag of tendons, which Filament forgets, said by their groups."""
    found = copy.copy(options)
    if not options.flags[mujoco.mjtVisFlag.mjVIS_TENDON]:
        found.tendongroup[:] = 0
    return found


def _lighting(model: mujoco.MjModel) -> tuple[dict[int, LightIntensity], float]:
    """What to set lights to, by index, and the intensity of the headlight [lux].

    Lights without intensity get the same number of candela from Filament, however far off they are, and reach 10 m:
    large scenes stay dark, and small ones burn out. Here they bring those lux to what they shine on at `qpos0`.
    What the model says is left as it is.
    """
    if model.light_intensity.sum():
        return {}, 0.0
    headlight = _custom(model, "filament.fallback.head_light_intensity", (HEADLIGHT,))[0]
    if _custom(model, "filament.fallback.scene_light_intensity", ()):
        return {}, headlight
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lamps = {}
    for light in np.flatnonzero(np.isin(model.light_type, (SPOT, POINT))):
        lux = LIGHTS / model.nlight * model.light_diffuse[light].max()
        throw = _throw(model, data, int(light))
        lamps[int(light)] = LightIntensity(float(lux * throw**2), max(float(model.light_range[light]), 5 * throw))
    return lamps, headlight


def _throw(model: mujoco.MjModel, data: mujoco.MjData, light: int) -> float:
    """How far from a light what it shines on is [m]: the middle of the model, or what its axis meets beyond."""
    start, body, met = data.light_xpos[light], int(model.light_bodyid[light]), np.zeros(1, np.int32)
    middle = float(np.linalg.norm(model.stat.center - start))
    ahead = mujoco.mj_ray(model, data, start, data.light_xdir[light], None, 1, body or -1, met)  # -1 for nothing
    return max(middle, min(ahead, 2 * (middle + model.stat.extent)))  # a floor may be met at the horizon


def _custom(model: mujoco.MjModel, name: str, default: Sequence[float]) -> Sequence[float]:
    """The numbers of a <custom> element of the model."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        return default
    start = model.numeric_adr[index]
    return model.numeric_data[start : start + model.numeric_size[index]].tolist()
