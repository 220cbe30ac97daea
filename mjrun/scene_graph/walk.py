"""The walk through a model that collects what is visible in it."""

import math
from collections.abc import Callable, Sequence
from functools import partial

import mujoco
import numpy as np

from mjrun.errors import clean
from mjrun.model.names import enum_members, enum_name, names, object_name
from mjrun.scene_graph import assets, shapes
from mjrun.scene_graph.graph import (
    CameraLens,
    Fact,
    Light,
    Material,
    Mesh,
    Node,
    Quaternion,
    SceneGraph,
    Vector,
)

GEOM, SITE = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_SITE)
TYPES = {value: name for name, value in enum_members(mujoco.mjtGeom).items()}
ALL = mujoco.mjtCatBit.mjCAT_ALL.value
FIXED_CAMERA, FIXED_LIGHT = int(mujoco.mjtCamLight.mjCAMLIGHT_FIXED), int(mujoco.mjtCamLight.mjCAMLIGHT_FIXED)
INFINITE = 5.0  # extents of the model from the centre to the edge of an infinite plane


def scene_graph(model: mujoco.MjModel, data: mujoco.MjData, options: mujoco.MjvOption, detail: int = 1) -> SceneGraph:
    """Collects the bodies of a model, and the visible geoms and sites, cameras and lights on them.

    Args:
      data: the model at the first frame, with positions computed.
      options: flags and groups of MuJoCo's visualizer.
      detail: factor of the number of triangles of a circle, 1 for MuJoCo's usual number.
    """
    walk = _Walk(model, data, detail)
    for body in range(model.nbody):
        walk.add_body(body)
    scene = mujoco.MjvScene(model, 2 * (model.ngeom + model.nsite) + 1000)
    mujoco.mjv_updateScene(model, data, options, None, mujoco.MjvCamera(), ALL, scene)
    for geom in scene.geoms[: scene.ngeom]:
        walk.add_geom(geom)
    for camera in range(model.ncam):
        walk.add_camera(camera)
    for light in range(model.nlight):
        walk.add_light(light)
    return SceneGraph(walk.nodes)


class _Walk:
    """The nodes of a model that are collected so far, and the meshes and materials that they share."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, detail: int) -> None:
        self.nodes = list[Node]()
        self._model, self._data = model, data
        quality = model.vis.quality
        self._slices, self._stacks = (
            max(4, 2 * detail * count // 2) for count in (quality.numslices, quality.numstacks)
        )
        self._meshes: dict[object, Mesh | None] = {}
        self._materials: dict[object, Material] = {}
        self._bodies = names(model, "body")

    def add_body(self, body: int) -> None:
        """Adds a body: below its parent if it is fixed to it, else below the world, with its pose there."""
        model, data = self._model, self._data
        if body == 0:
            self.nodes.append(Node("world", "world", 0, -1))
            return
        moves = bool(model.body_dofnum[body] or model.body_mocapid[body] >= 0)
        facts: dict[str, Fact] = {
            "mass": float(model.body_mass[body]),
            "parent": clean(self._bodies[model.body_parentid[body]]),
        }
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if joints:
            facts["joints"] = [clean(object_name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or "") for joint in joints]
        parent = 0 if moves else int(model.body_parentid[body])
        position, quaternion = (
            (data.xpos[body], data.xquat[body]) if moves else (model.body_pos[body], model.body_quat[body])
        )
        self.nodes.append(
            Node(
                name=clean(self._bodies[body]),
                kind="body",
                id=body,
                parent=parent,
                position=vector(position),
                quaternion=quaternion_of(quaternion),
                moves=moves,
                facts=facts,
            )
        )

    def add_geom(self, geom: mujoco.MjvGeom) -> None:
        """Adds a geom or a site of MuJoCo's scene to its body."""
        model, index = self._model, int(geom.objid)
        if geom.objtype not in (GEOM, SITE) or index < 0:
            return
        kind = "geom" if geom.objtype == GEOM else "site"
        mesh, scale = self._shape(geom)
        if mesh is None:
            return
        body, position, quaternion = (
            (model.geom_bodyid[index], model.geom_pos[index], model.geom_quat[index])
            if kind == "geom"
            else (model.site_bodyid[index], model.site_pos[index], model.site_quat[index])
        )
        facts: dict[str, Fact] = {"type": TYPES[int(geom.type)]}
        layer = ""
        if kind == "geom":
            collides = bool(model.geom_contype[index] or model.geom_conaffinity[index])
            layer = "collision" if collides else "visual"
            facts["group"] = int(model.geom_group[index])
        self.nodes.append(
            Node(
                name=clean(object_name(model, geom.objtype, index) or ""),
                kind=kind,
                id=index,
                parent=int(body),
                position=vector(position),
                quaternion=quaternion_of(quaternion),
                scale=scale,
                mesh=mesh,
                material=self._material(geom),
                layer=layer,
                facts=facts,
            )
        )

    def add_camera(self, camera: int) -> None:
        """Adds a camera, to its body if it is fixed to it."""
        model, data = self._model, self._data
        fixed = int(model.cam_mode[camera]) == FIXED_CAMERA
        orthographic = int(model.cam_projection[camera]) == int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)
        fovy = float(model.cam_fovy[camera])
        width, height = (int(side) for side in model.cam_resolution[camera])
        extent = model.stat.extent
        lens = CameraLens(
            fovy=fovy if orthographic else math.radians(fovy),
            aspect=width / height if width > 1 and height > 1 else 16 / 9,
            near=float(model.vis.map.znear * extent),
            far=float(model.vis.map.zfar * extent),
            orthographic=orthographic,
        )
        quaternion = model.cam_quat[camera] if fixed else matrix_quaternion(data.cam_xmat[camera])
        self.nodes.append(
            Node(
                name=clean(object_name(model, mujoco.mjtObj.mjOBJ_CAMERA, camera) or ""),
                kind="camera",
                id=camera,
                parent=int(model.cam_bodyid[camera]) if fixed else 0,
                position=vector(model.cam_pos[camera] if fixed else data.cam_xpos[camera]),
                quaternion=quaternion_of(quaternion),
                moves=not fixed,
                lens=lens,
            )
        )

    def add_light(self, light: int) -> None:
        """Adds a light, to its body if it is fixed to it."""
        model, data = self._model, self._data
        if not model.light_active[light]:
            return
        kind = enum_name(mujoco.mjtLightType, model.light_type[light])
        if kind not in ("directional", "point", "spot"):
            return
        fixed = int(model.light_mode[light]) == FIXED_LIGHT
        color = vector(model.light_diffuse[light])
        brightest = max(color)
        if not brightest > 0:
            return
        value = Light(
            kind=kind,
            color=vector(np.array(color) / brightest),
            intensity=math.pi * brightest,
            cutoff=math.radians(float(model.light_cutoff[light])) if kind == "spot" else 0.0,
        )
        direction = model.light_dir[light] if fixed else data.light_xdir[light]
        self.nodes.append(
            Node(
                name=clean(object_name(model, mujoco.mjtObj.mjOBJ_LIGHT, light) or ""),
                kind="light",
                id=light,
                parent=int(model.light_bodyid[light]) if fixed else 0,
                position=vector(model.light_pos[light] if fixed else data.light_xpos[light]),
                quaternion=quaternion_of(toward(direction)),
                moves=not fixed,
                light=value,
            )
        )

    def _shape(self, geom: mujoco.MjvGeom) -> tuple[Mesh | None, Vector]:
        """Returns the mesh of a geom, which others share, and its scale."""
        x, y, z = vector(geom.size)
        slices, stacks = self._slices, self._stacks
        match TYPES.get(int(geom.type)):
            case "sphere" | "ellipsoid":
                return self._shared("sphere", partial(shapes.sphere, slices, stacks)), (x, y, z)
            case "capsule":
                ratio = float(f"{z / x:.6g}")
                return self._shared(("capsule", ratio), partial(shapes.capsule, ratio, slices, stacks)), (x, x, x)
            case "cylinder":
                return self._shared("cylinder", partial(shapes.cylinder, slices)), (x, y, z)
            case "box":
                return self._shared("box", shapes.box), (x, y, z)
            case "plane":
                far = INFINITE * float(self._model.stat.extent)
                sides = (x or far, y or far)
                return self._shared(("plane", sides), partial(shapes.plane, *sides)), (1.0, 1.0, 1.0)
            case "hfield":
                index = int(geom.dataid)
                return self._shared(("hfield", index), partial(assets.height_field, self._model, index)), (
                    1.0,
                    1.0,
                    1.0,
                )
            case "mesh" | "sdf" if geom.dataid >= 0:
                index, is_hull = divmod(int(geom.dataid), 2)
                make = assets.mesh_hull if is_hull else assets.mesh_asset
                return self._shared(("mesh", index, is_hull), partial(make, self._model, index)), (1.0, 1.0, 1.0)
            case _:
                return None, (1.0, 1.0, 1.0)

    def _shared(self, key: object, make: Callable[[], Mesh | None]) -> Mesh | None:
        if key not in self._meshes:
            self._meshes[key] = make()
        return self._meshes[key]

    def _material(self, geom: mujoco.MjvGeom) -> Material:
        model, index = self._model, int(geom.matid)
        rgba = tuple(float(f"{part:.6g}") for part in geom.rgba)
        name = clean(object_name(model, mujoco.mjtObj.mjOBJ_MATERIAL, index) or "") if index >= 0 else "color"
        metallic = float(model.mat_metallic[index]) if index >= 0 else -1.0
        roughness = float(model.mat_roughness[index]) if index >= 0 else -1.0
        made = Material(
            name=name,
            rgba=(rgba[0], rgba[1], rgba[2], rgba[3]),
            metallic=max(metallic, 0.0),
            roughness=roughness if roughness >= 0 else 1.0 - 0.5 * float(geom.shininess),
            emission=float(geom.emission),
        )
        return self._materials.setdefault(made, made)


def vector(values: Sequence[float] | np.ndarray) -> Vector:
    """Returns three numbers as a tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def quaternion_of(values: Sequence[float] | np.ndarray) -> Quaternion:
    """Returns a quaternion as a tuple."""
    w, x, y, z = (float(value) for value in values)
    return w, x, y, z


def matrix_quaternion(matrix: np.ndarray) -> np.ndarray:
    """Returns the quaternion `(4,)` of a rotation matrix of 9 numbers."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ravel(matrix))
    return quaternion


def toward(direction: np.ndarray) -> np.ndarray:
    """Returns a rotation, as a quaternion `(4,)`, that turns −z into a direction `(3,)`."""
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, -np.asarray(direction, float))
    return quaternion
