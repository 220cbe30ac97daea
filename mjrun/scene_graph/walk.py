"""The walk through a model that collects its bodies and what is fixed to them: geoms, sites, cameras, lights, skins."""

import math
from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np

from mjrun.errors import clean
from mjrun.model.names import enum_name, names, object_names
from mjrun.scene_graph import meshes
from mjrun.scene_graph.graph import CameraLens, Fact, Mesh, Node, Quaternion, SceneLight, Skin, Vector, camera_lens
from mjrun.scene_graph.materials import MaterialCache, TextureMapping, texture_pixels
from mjrun.scene_graph.visualizer_geoms import TYPES, MeshCache

GEOM, SITE = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_SITE)
FIXED = int(mujoco.mjtCamLight.mjCAMLIGHT_FIXED)
ORTHOGRAPHIC = int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)
SKYBOX = int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)
SKIN = int(mujoco.mjtGeom.mjGEOM_SKIN)
ASPECT = 16 / 9  # of cameras without a resolution
UNSCALED = (1.0, 1.0, 1.0)


class ModelWalk:
    """A walk through a model, which collects its nodes, except for what its visualizer adds frame by frame.

    Args:
      data: the model at the first frame, with positions computed.
      reach: distance from the centre of the model to the edges of infinite planes [m].

    Attributes:
      nodes: the nodes so far; first the bodies, whose indices are their ids.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, shapes: MeshCache, surfaces: MaterialCache, reach: float
    ) -> None:
        self.nodes = list[Node]()
        self._model, self._data, self._reach = model, data, reach
        self._shapes, self._surfaces = shapes, surfaces
        self._bodies = [clean(name) for name in names(model, "body")]
        for body in range(model.nbody):
            self.nodes.append(self._body(body))

    def add_geoms(self, scene: mujoco.MjvScene, hidden: mujoco.MjvScene | None = None) -> None:
        """Adds the geoms, sites and skins in MuJoCo's scene, and those that collide in a scene of hidden ones."""
        shown = set[tuple[int, int]]()
        for geom in scene.geoms[: scene.ngeom]:
            if is_attached(geom):
                shown.add((int(geom.objtype), int(geom.objid)))
                self._add_geom(geom, visible=True)
            elif int(geom.type) == SKIN:
                self._add_skin(geom)
        for geom in hidden.geoms[: hidden.ngeom] if hidden else ():
            is_new = is_attached(geom) and (int(geom.objtype), int(geom.objid)) not in shown
            if is_new and int(geom.objtype) == GEOM and self._collides(int(geom.objid)):
                self._add_geom(geom, visible=False)

    def add_cameras(self) -> None:
        """Adds the cameras of the model, those that are fixed to a body to its node."""
        model, data = self._model, self._data
        for camera, name in enumerate(names(model, "camera")):
            fixed = int(model.cam_mode[camera]) == FIXED
            if not 0 < model.cam_fovy[camera] < (math.inf if _is_orthographic(model, camera) else 180):
                continue  # it sees nothing
            self.nodes.append(
                Node(
                    name=clean(name),
                    kind="camera",
                    id=camera,
                    parent=int(model.cam_bodyid[camera]) if fixed else 0,
                    position=vector(model.cam_pos[camera] if fixed else data.cam_xpos[camera]),
                    quaternion=quaternion(
                        model.cam_quat[camera] if fixed else matrix_quaternion(data.cam_xmat[camera])
                    ),
                    moves=not fixed,
                    lens=_lens(model, camera),
                )
            )

    def add_lights(self) -> None:
        """Adds the lights of the model, those that are fixed to a body to its node."""
        model, data = self._model, self._data
        for light, name in enumerate(names(model, "light")):
            value = light_of(model, data, light)
            if value is None:
                continue
            fixed = int(model.light_mode[light]) == FIXED
            self.nodes.append(
                Node(
                    name=clean(name),
                    kind="light",
                    id=light,
                    parent=int(model.light_bodyid[light]) if fixed else 0,
                    position=vector(model.light_pos[light] if fixed else data.light_xpos[light]),
                    quaternion=quaternion(toward(model.light_dir[light] if fixed else data.light_xdir[light])),
                    moves=not fixed,
                    light=value,
                )
            )

    def facts(self) -> dict[str, Fact]:
        """Returns the facts of the scene."""
        model, light = self._model, self._model.vis.headlight
        facts: dict[str, Fact] = {"extent": float(model.stat.extent), "center": [*vector(model.stat.center)]}
        if light.active:
            facts |= {"headlight_ambient": [*vector(light.ambient)], "headlight_diffuse": [*vector(light.diffuse)]}
        skies = np.flatnonzero(model.tex_type == SKYBOX)
        if len(skies):
            pixels = texture_pixels(model, int(skies[0])).astype(float) / 255
            faces = np.array_split(pixels[..., :3], 6)  # right, left, up, down, front, back
            facts |= {f"sky_{name}": faces[side].mean(axis=(0, 1)).tolist() for name, side in (("up", 2), ("down", 3))}
        return facts

    def _body(self, body: int) -> Node:
        """Returns a body: below its parent if it is fixed to it, else below the world, with its pose there."""
        model, data = self._model, self._data
        if body == 0:
            return Node("world", "world", 0, -1)
        parent = int(model.body_parentid[body])
        facts: dict[str, Fact] = {"mass": float(model.body_mass[body]), "parent": self._bodies[parent]}
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if joints:
            facts["joints"] = [clean(name) for name in object_names(model, "joint", joints)]
        moves = bool(joints) or model.body_mocapid[body] >= 0
        return Node(
            name=self._bodies[body],
            kind="body",
            id=body,
            parent=0 if moves else parent,
            position=vector(data.xpos[body] if moves else model.body_pos[body]),
            quaternion=quaternion(data.xquat[body] if moves else model.body_quat[body]),
            moves=moves,
            facts=facts,
        )

    def _collides(self, geom: int) -> bool:
        model = self._model
        pairs = (*model.pair_geom1.tolist(), *model.pair_geom2.tolist())
        return bool(model.geom_contype[geom] or model.geom_conaffinity[geom]) or geom in pairs

    def _add_geom(self, geom: mujoco.MjvGeom, *, visible: bool) -> None:
        """Adds a geom or a site of MuJoCo's scene to its body."""
        model, index = self._model, int(geom.objid)
        mesh, scale, mapping = self._shape(geom)
        if mesh is None:
            return
        kind, prefix = ("geom", "geom") if geom.objtype == GEOM else ("site", "site")
        layer = ""
        if kind == "geom":
            collides = self._collides(index)
            layer = "both" if collides and visible else "collision" if collides else "visual"
        self.nodes.append(
            Node(
                name=clean(object_names(model, kind, [index])[0]),
                kind=kind,
                id=index,
                parent=int(getattr(model, f"{prefix}_bodyid")[index]),
                position=vector(getattr(model, f"{prefix}_pos")[index]),
                quaternion=quaternion(getattr(model, f"{prefix}_quat")[index]),
                scale=scale,
                mesh=mesh,
                material=self._surfaces.material(geom, mapping),
                visible=visible,
                layer=layer,
                facts={"type": TYPES[int(geom.type)]},
            )
        )

    def _shape(self, geom: mujoco.MjvGeom) -> tuple[Mesh | None, Vector, TextureMapping | None]:
        """Returns the mesh of a geom, which others share, its scale, and the placement of its texture."""
        x, y, z = (float(f"{side:.7g}") for side in geom.size)
        name, shared = TYPES[int(geom.type)], self._shapes
        match name:
            case "sphere" | "ellipsoid":
                mesh, scale, key = shared.named("sphere"), (x, y, z), ("sphere",)
            case "cylinder" | "box":
                mesh, scale, key = shared.named(name), (x, y, z), (name,)
            case "capsule":
                ratio = float(f"{z / x:.6g}")
                key = ("capsule", ratio)
                mesh = shared.shared(key, partial(meshes.capsule, ratio, shared.slices, shared.stacks))
                scale = (x, x, x)
            case "plane":
                key = ("plane", x, y)
                mesh, scale = shared.shared(key, partial(meshes.plane, x, y, self._reach)), UNSCALED
            case "hfield":
                key = ("hfield", int(geom.dataid))
                mesh = shared.shared(key, partial(meshes.height_field, self._model, int(geom.dataid)))
                scale = UNSCALED
            case "mesh" | "sdf":
                mesh, scale, key = shared.asset(int(geom.dataid)), UNSCALED, ("mesh", int(geom.dataid))
            case _:
                return None, UNSCALED, None
        if mesh is None:
            return None, UNSCALED, None
        is_asset = name in ("mesh", "sdf", "hfield")
        mapping = self._surfaces.mapping(geom, scale, is_asset=is_asset, has_uv=mesh.uv is not None)
        if mapping is None:
            return shared.plain(mesh), scale, None
        size = int(self._model.tex_width[mapping.texture])
        return shared.shared((key, mapping), partial(mapping.applied, mesh, size)), scale, mapping

    def _add_skin(self, geom: mujoco.MjvGeom) -> None:
        """Adds a skin, whose vertices follow the nodes of its bodies."""
        mesh, bodies, binds, joints, weights = meshes.skin_asset(self._model, int(geom.objid))
        mapping = self._surfaces.mapping(geom, UNSCALED, is_asset=True, has_uv=True) if mesh.uv is not None else None
        if mapping and mapping.kind == "uv":
            mesh = mapping.applied(mesh, 0)
        self.nodes.append(
            Node(
                name=mesh.name,
                kind="skin",
                id=int(geom.objid),
                parent=0,
                mesh=mesh,
                material=self._surfaces.material(geom, mapping),
                skin=Skin([int(body) for body in bodies], binds, joints, weights),
            )
        )


def is_attached(geom: mujoco.MjvGeom) -> bool:
    """Returns whether a geom of MuJoCo's scene is a geom or a site of the model, which is fixed to its body."""
    return int(geom.objtype) in (GEOM, SITE) and int(geom.objid) >= 0


def vector(values: Sequence[float] | np.ndarray) -> Vector:
    """Returns three numbers as a tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def quaternion(values: Sequence[float] | np.ndarray) -> Quaternion:
    """Returns four numbers as a tuple."""
    w, x, y, z = (float(value) for value in values)
    return w, x, y, z


def matrix_quaternion(matrix: np.ndarray) -> np.ndarray:
    """Returns the quaternion `(4,)` of a rotation matrix of 9 numbers."""
    turned = np.empty(4)
    mujoco.mju_mat2Quat(turned, np.ravel(matrix))
    return turned


def toward(direction: np.ndarray) -> np.ndarray:
    """Returns the quaternion `(4,)` of a rotation that turns −z into a direction `(3,)`."""
    turned = np.empty(4)
    mujoco.mju_quatZ2Vec(turned, -np.asarray(direction, float))
    return turned


KINDS = ("directional", "point", "spot")
DAYLIGHT = 80_000.0  # illuminance of a bright surface where lights have intensities [lx]


def light_of(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> SceneLight | None:
    """Returns a light of the model; None if it is dark or only surrounds the scene.

    Lights of the classic renderer do not get weaker with distance. Here those with a place have the brightness of their
    diffuse colour on the surface that they light at first, and follow the inverse square law elsewhere.
    """
    kind = enum_name(mujoco.mjtLightType, model.light_type[index])
    color = np.clip(model.light_diffuse[index].astype(float), 0, None)
    if kind not in KINDS or not model.light_active[index] or not color.any():
        return None
    cutoff = math.radians(float(model.light_cutoff[index])) if kind == "spot" else 0.0
    if kind == "spot" and cutoff <= 0:
        return None
    lux = math.pi * float(color.max())
    if kind == "directional":
        intensity = lux
    elif model.light_intensity[index] > 0:
        intensity = math.pi * float(model.light_intensity[index]) / DAYLIGHT
    else:
        intensity = lux * lit_distance(model, data, index) ** 2
    red, green, blue = (float(part) for part in color / color.max())
    hue: Vector = (red, green, blue)
    return SceneLight(kind, hue, intensity, cutoff=cutoff)


def lit_distance(model: mujoco.MjModel, data: mujoco.MjData, light: int) -> float:
    """Returns the distance from a light to what it lights [m]: the model's centre, or what its axis hits beyond it."""
    start, body, hit = data.light_xpos[light], int(model.light_bodyid[light]), np.zeros(1, np.int32)
    centre = float(np.linalg.norm(model.stat.center - start))
    ahead = mujoco.mj_ray(model, data, start, data.light_xdir[light], None, 1, body or -1, hit)  # -1 for nothing
    return max(centre, min(ahead, 2 * (centre + model.stat.extent)))  # a floor may be hit at the horizon


def _is_orthographic(model: mujoco.MjModel, camera: int) -> bool:
    return int(model.cam_projection[camera]) == ORTHOGRAPHIC


def _lens(model: mujoco.MjModel, camera: int) -> CameraLens:
    """Returns the lens of a camera of the model."""
    view = mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, camera
    ends, sides, clip = (np.empty((2, 1), np.float32) for _ in range(3))
    mujoco.mjv_cameraFrustum(ends, sides, clip, model, view)
    (above, below), (left, right) = ends.ravel().tolist(), sides.ravel().tolist()
    if not left + right:  # without intrinsics
        width, height = (int(side) for side in model.cam_resolution[camera])
        aspect = width / height if width > 1 and height > 1 else ASPECT
        left = right = (above + below) / 2 * aspect
    near, far = clip.ravel().tolist()
    return camera_lens((-left, right), (-below, above), (near, far), orthographic=_is_orthographic(model, camera))
