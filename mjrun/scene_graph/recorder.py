"""The scene of a model with its motion, collected from the data of each frame."""

import copy
import math
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean, option
from mjrun.model.mujoco_globals import collected_warnings, warn_again
from mjrun.model.names import enum_members, object_names
from mjrun.scene_graph.graph import Deformation, Mesh, Node, SceneGraph, SceneMotion, Track
from mjrun.scene_graph.materials import MaterialCache, TextureMapping
from mjrun.scene_graph.meshes import unique_rows, unit
from mjrun.scene_graph.visualizer_geoms import MeshCache, VisualizerGeomRecorder, flex_ends
from mjrun.scene_graph.walk import SKIN, UNSCALED, ModelWalk, is_attached, matrix_quaternion, toward

ALL = mujoco.mjtCatBit.mjCAT_ALL.value
DECOR = mujoco.mjtCatBit.mjCAT_DECOR.value
FLEX = int(mujoco.mjtGeom.mjGEOM_FLEX)
FLAGS = enum_members(mujoco.mjtVisFlag)
CONTACTS = ("contactpoint", "contactforce")
# Flags whose objects depend on contacts, forces and sensors.
OF_FORCES = (*CONTACTS, "contactsplit", "constraint", "pertforce", "island", "rangefinder")
RANGEFINDER = int(mujoco.mjtSensor.mjSENS_RANGEFINDER)
NONE = (int(mujoco.mjtFrame.mjFRAME_NONE), int(mujoco.mjtLabel.mjLABEL_NONE))
SPILL = 2**24  # bytes of positions in memory; more go to disk
INFINITE = 5.0  # extents of the model from its centre to the edges of infinite planes, at least
VERTICES = 50_000_000  # positions of the vertices of a flex, summed over frames
SHAPES_OF_FLEX = 600  # shapes of a flex between which its vertices move linearly

Adder = Callable[[mujoco.MjvScene, int], None]


@dataclass(frozen=True)
class SceneContentSettings:
    """Settings of the contents of a scene.

    Attributes:
      options: flags and groups of MuJoCo's visualizer.
      decorations: functions that add geoms to MuJoCo's scene at a frame, by name.
      room: the maximum number of geoms that they add.
      hidden: true if the scene includes geoms that collide and are not visible.
      detail: factor of the number of triangles of a circle, 1 for that of the model.
    """

    options: mujoco.MjvOption
    decorations: Sequence[tuple[str, Adder]] = ()
    room: int = 0
    hidden: bool = False
    detail: float = 1.0

    def needs_forces(self, model: mujoco.MjModel) -> bool:
        """Returns whether contacts, forces and sensors must be computed for it, rather than positions alone."""
        flags = {name for name in OF_FORCES if self.options.flags[FLAGS[name]]}
        if not np.any(model.sensor_type == RANGEFINDER):
            flags.discard("rangefinder")
        shows_contacts = {int(self.options.frame), int(self.options.label)} & {
            int(mujoco.mjtFrame.mjFRAME_CONTACT),
            int(mujoco.mjtLabel.mjLABEL_CONTACTPOINT),
            int(mujoco.mjtLabel.mjLABEL_CONTACTFORCE),
        }
        return bool(flags) or bool(shows_contacts)


def record_scene(
    model: mujoco.MjModel, instants: Iterable[mujoco.MjData], times: Sequence[float], request: SceneContentSettings
) -> tuple[SceneGraph, SceneMotion]:
    """Collects the scene of a model and its motion.

    Args:
      instants: the data of each frame, at least one: positions, and forces if the request needs them; read in turn.
      times: the time of each frame in the file [s].
    """
    recorder = _Recorder(model, len(times), request)
    for frame, data in enumerate(instants):
        recorder.add(frame, data)
    return recorder.finished(np.asarray(times, float))


class _Recorder:
    """The scene so far."""

    def __init__(self, model: mujoco.MjModel, count: int, request: SceneContentSettings) -> None:
        self._model, self._request, self._count = model, request, count
        self._shapes, self._surfaces = MeshCache(model, request.detail), MaterialCache(model)
        self._items = VisualizerGeomRecorder(model, self._shapes, self._surfaces)
        self._options = _without_contacts(request.options)
        self._scene = mujoco.MjvScene(model, 2 * (model.ngeom + model.nsite) + 1000 + request.room)
        self._has_items = False
        self._flexes: dict[int, _FlexRecorder] = {}
        self._remarks = list[str]()

    def add(self, frame: int, data: mujoco.MjData) -> None:
        """Adds a frame."""
        if frame == 0:
            self._begin(data)
        self._record_poses(frame, data)
        if self._has_items:
            if frame:
                self._update(data, self._options, ALL)
            self._add_items(frame)
        self._add_contacts(frame, data)

    def finished(self, times: np.ndarray) -> tuple[SceneGraph, SceneMotion]:
        """Returns the scene and its motion."""
        walk = self._walk
        first, tracks, deformations = len(walk.nodes), list[Track](), list[Deformation]()
        for node, track in self._items.nodes(first, self._count):
            walk.nodes.append(node)
            tracks.append(track)
        for flex in self._flexes.values():
            if made := flex.finished(len(walk.nodes)):
                walk.nodes.append(made[0])
                deformations.append(made[1])
            elif flex.remark:
                self._remarks.append(flex.remark)
        if all(node.mesh is None for node in walk.nodes):
            self._remarks.append(
                f"the scene is empty: no geom is in a visible group; {option('geomgroup')} shows others"
            )
        if self._items.has_labels:
            self._remarks.append("names of objects are not drawn: the nodes of the file have them")
        if self._items.is_full:
            self._remarks.append("the scene has too many tendons, contacts or decorations; some are left out")
        graph = SceneGraph(walk.nodes, self._remarks, walk.facts())
        return graph, SceneMotion(times, self._moving, self._positions, self._quaternions, tracks, deformations)

    def _begin(self, data: mujoco.MjData) -> None:
        """Adds everything that is fixed to bodies."""
        model, request = self._model, self._request
        distances = np.linalg.norm(data.xpos - model.stat.center, axis=1)
        reach = max(INFINITE * float(model.stat.extent), 2 * float(distances.max(initial=0)))
        self._walk = ModelWalk(model, data, self._shapes, self._surfaces, reach)
        hidden = None
        if request.hidden:
            everything = copy.copy(request.options)
            everything.geomgroup[:] = 1
            self._update(data, everything, ALL)
            hidden = self._scene
            self._scene = mujoco.MjvScene(model, hidden.maxgeom)
        self._update(data, self._options, ALL)
        self._walk.add_geoms(self._scene, hidden)
        self._walk.add_cameras()
        self._walk.add_lights()
        others = [
            geom for geom in self._scene.geoms[: self._scene.ngeom] if not is_attached(geom) and int(geom.type) != SKIN
        ]
        changed = self._options.flags != mujoco.MjvOption().flags
        frame_and_label = (int(self._options.frame), int(self._options.label))
        self._has_items = bool(others or np.any(changed) or request.decorations or frame_and_label != NONE)
        self._has_items |= bool(np.any(model.sensor_type == RANGEFINDER))

        nodes = self._walk.nodes
        self._moving = [index for index, node in enumerate(nodes) if node.moves]
        self._positions = _numbers((self._count, len(self._moving), 3))
        self._quaternions = _numbers((self._count, len(self._moving), 4))
        self._columns = {
            kind: [column for column, index in enumerate(self._moving) if nodes[index].kind == kind]
            for kind in ("body", "camera", "light")
        }
        self._ids = {kind: [nodes[self._moving[i]].id for i in columns] for kind, columns in self._columns.items()}

    def _record_poses(self, frame: int, data: mujoco.MjData) -> None:
        columns, ids = self._columns, self._ids
        positions, quaternions = self._positions[frame], self._quaternions[frame]
        positions[columns["body"]] = data.xpos[ids["body"]]
        quaternions[columns["body"]] = data.xquat[ids["body"]]
        positions[columns["camera"]] = data.cam_xpos[ids["camera"]]
        positions[columns["light"]] = data.light_xpos[ids["light"]]
        for column, camera in zip(columns["camera"], ids["camera"], strict=True):
            quaternions[column] = matrix_quaternion(data.cam_xmat[camera])
        for column, light in zip(columns["light"], ids["light"], strict=True):
            quaternions[column] = toward(data.light_xdir[light])

    def _add_items(self, frame: int) -> None:
        """Adds what the visualizer has added to its scene, and decorations."""
        scene = self._scene
        geoms = [geom for geom in scene.geoms[: scene.ngeom] if not is_attached(geom)]
        self._items.add(frame, geoms)
        for geom in geoms:
            if int(geom.type) == FLEX:
                self._add_flex(frame, geom)
        for name, add in self._request.decorations:
            before = scene.ngeom
            add(scene, frame)
            self._items.add(frame, scene.geoms[before : scene.ngeom], name)

    def _add_flex(self, frame: int, geom: mujoco.MjvGeom) -> None:
        index, scene = int(geom.objid), self._scene
        if index not in self._flexes:
            name = clean(object_names(self._model, "flex", [index])[0])
            has_uv = int(geom.texcoord) > 0
            mapping = self._surfaces.mapping(geom, UNSCALED, is_asset=True, has_uv=True) if has_uv else None
            material = self._surfaces.material(geom, mapping)
            node = Node(name, "flex", index, 0, moves=True, material=material)
            self._flexes[index] = _FlexRecorder(node, self._count, mapping)
        if scene.flexfaceused[index]:
            self._flexes[index].add(frame, scene)
        elif scene.flexedgeopt and geom.size[0] > 0:
            self._items.add_lines(frame, self._flexes[index].node, flex_ends(scene, index), float(geom.size[0]))

    def _add_contacts(self, frame: int, data: mujoco.MjData) -> None:
        """Adds contacts and their forces, each in a layer."""
        for name in CONTACTS:
            if not self._request.options.flags[FLAGS[name]]:
                continue
            options = copy.copy(self._request.options)
            options.flags[:] = 0
            for flag in (name, "contactsplit"):
                options.flags[FLAGS[flag]] = self._request.options.flags[FLAGS[flag]]
            options.frame, options.label = NONE
            self._update(data, options, DECOR)
            self._items.add(frame, self._scene.geoms[: self._scene.ngeom], name)

    def _update(self, data: mujoco.MjData, options: mujoco.MjvOption, categories: int) -> None:
        """Updates MuJoCo's scene, which grows until everything fits."""
        while True:
            with collected_warnings() as texts:
                mujoco.mjv_updateScene(self._model, data, options, None, mujoco.MjvCamera(), categories, self._scene)
            if self._scene.ngeom + self._request.room < self._scene.maxgeom:
                break
            self._scene = mujoco.MjvScene(self._model, 2 * self._scene.maxgeom)
        warn_again(texts)  # except of an earlier, smaller scene


class _FlexRecorder:
    """The shapes of a flex so far, with the triangles that MuJoCo draws.

    Attributes:
      node: its node, without its mesh.
      remark: the reason why it is left out, or an empty text.
    """

    def __init__(self, node: Node, count: int, mapping: TextureMapping | None) -> None:
        self.node, self.remark = node, ""
        self._mapping, self._uv = mapping, np.empty((0, 2), np.float32)
        self._stride = -(-count // SHAPES_OF_FLEX)
        self._count = count
        self._frames, self._positions, self._normals = list[int](), list[np.ndarray](), list[np.ndarray]()
        self._first, self._faces = np.empty(0, int), np.empty((0, 3), np.uint32)

    def add(self, frame: int, scene: mujoco.MjvScene) -> None:
        """Adds the shape at a frame, unless it is between two that are kept."""
        index = self.node.id
        corners = slice(3 * scene.flexfaceadr[index], 3 * (scene.flexfaceadr[index] + scene.flexfaceused[index]))
        positions = scene.flexface.reshape(-1, 3)[corners]
        normals = scene.flexnormal.reshape(-1, 3)[corners]
        if frame == 0:
            parts = [positions, normals]
            if self._mapping:
                self._uv = scene.flextexcoord.reshape(-1, 2)[corners]
                parts.append(self._uv)
            vertices = np.concatenate(parts, axis=1)
            self._first, faces = unique_rows(vertices)
            self._uv = self._uv[self._first] if self._mapping else self._uv
            self._faces = faces.reshape(-1, 3).astype(np.uint32)
            shapes = -(-self._count // self._stride)
            if shapes * len(self._first) > VERTICES:
                self.remark = f"flex {self.node.name} has too many vertices, and is left out"
        is_last = frame == self._count - 1
        if not self.remark and (frame % self._stride == 0 or is_last):
            self._frames.append(frame)
            self._positions.append(positions[self._first].copy())
            self._normals.append(unit(normals[self._first]))

    def finished(self, index: int) -> tuple[Node, Deformation] | None:
        """Returns the node, whose index is given, and the motion of its vertices; None without vertices."""
        if not self._frames:
            return None
        uv = self._uv if self._mapping else None
        mesh = Mesh(self.node.name, self._positions[0], self._normals[0], self._faces, uv)
        if self._mapping:
            mesh = self._mapping.applied(mesh, 0)
        shapes = np.array(self._positions), np.array(self._normals)
        return replace(self.node, mesh=mesh, moves=False), Deformation(index, np.array(self._frames), *shapes)


def compute_poses(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Computes the poses of everything that a scene without contacts and forces shows."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_flex(model, data)
    mujoco.mj_tendon(model, data)
    mujoco.mj_transmission(model, data)


def _numbers(shape: tuple[int, ...]) -> np.ndarray:
    """Returns an array to be filled, on the disk if it is large."""
    if 8 * math.prod(shape) <= SPILL:
        return np.empty(shape)
    with tempfile.TemporaryFile() as file:
        return np.memmap(file, np.float64, "w+", shape=shape)


def _without_contacts(options: mujoco.MjvOption) -> mujoco.MjvOption:
    made = copy.copy(options)
    for name in CONTACTS:
        made.flags[FLAGS[name]] = 0
    return made
