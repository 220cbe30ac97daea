"""Objects that MuJoCo's visualizer adds to a model frame by frame: tendons, joints, contacts, trails, ghosts, …"""

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np

from mjrun.errors import clean
from mjrun.model.names import KIND_OF, enum_members, object_name
from mjrun.scene_graph import meshes
from mjrun.scene_graph.graph import Mesh, Node, Track, Vector
from mjrun.scene_graph.materials import MaterialCache

TYPES = {value: name for name, value in enum_members(mujoco.mjtGeom).items()}
NAMED = ("tendon", "joint", "actuator")  # kinds whose objects are these items; those of others are nodes themselves
HEAD, NO_HEAD = 1.75, 1.0  # radius of the head of an arrow, by the radius of its shaft
NUMBERS = 10  # of a pose: position, quaternion, scale
MOST = 5000  # items; each is a node


class MeshCache:
    """A cache of the meshes of shapes and assets, each made once.

    Args:
      detail: factor of the number of triangles of a circle, 1 for that of the model.
    """

    def __init__(self, model: mujoco.MjModel, detail: float) -> None:
        quality = model.vis.quality
        self._model = model
        self.slices, self.stacks = (
            max(least, 2 * round(detail * count / 2))
            for least, count in ((8, quality.numslices), (4, quality.numstacks))
        )
        self._meshes: dict[object, Mesh | None] = {}

    def shared(self, key: object, make: Callable[[], Mesh | None]) -> Mesh | None:
        """Returns the mesh `key`, which is made the first time."""
        if key not in self._meshes:
            self._meshes[key] = make()
        return self._meshes[key]

    def plain(self, mesh: Mesh | None) -> Mesh | None:
        """Returns a mesh without texture coordinates."""
        if mesh is None or mesh.uv is None:
            return mesh
        return self.shared(("plain", mesh), partial(replace, mesh, uv=None))

    def asset(self, dataid: int) -> Mesh | None:
        """Returns a mesh of the model; in MuJoCo's scenes, odd numbers are convex hulls."""
        index, is_hull = divmod(dataid, 2)
        make = meshes.mesh_hull if is_hull else meshes.mesh_asset
        return self.shared(("mesh", dataid), partial(make, self._model, index))

    def named(self, name: str) -> Mesh | None:
        """Returns a shape of size 1, with texture coordinates."""
        slices = self.slices
        makers: dict[str, Callable[[], Mesh]] = {
            "sphere": partial(meshes.sphere, slices, self.stacks),
            "cylinder": partial(meshes.cylinder, slices),
            "box": meshes.box,
            "arrow": partial(meshes.arrow, slices, HEAD),
            "arrow1": partial(meshes.arrow, slices, NO_HEAD),
            "arrow2": partial(meshes.double_arrow, slices),
            "line": meshes.line,
            "linebox": meshes.edges,
        }
        return self.shared(name, makers[name])


class VisualizerGeomRecorder:
    """A recorder of the items of all frames so far, each a node under the world.

    Attributes:
      has_labels: true if there were texts, which are not nodes.
      is_full: true if there were more than `MOST`.
    """

    def __init__(self, model: mujoco.MjModel, shapes: MeshCache, surfaces: MaterialCache) -> None:
        self._model, self._shapes, self._surfaces = model, shapes, surfaces
        self._items: dict[object, _Item] = {}
        self.has_labels = self.is_full = False

    def add(self, frame: int, geoms: Iterable[mujoco.MjvGeom], layer: str = "") -> None:
        """Adds the items of a frame.

        Args:
          layer: `contactpoint` or `contactforce` for contacts; the name of a decoration; otherwise empty.
        """
        numbers = Counter[object]()
        for geom in geoms:
            name = TYPES.get(int(geom.type), "none")
            self.has_labels |= name == "label"
            if name in ("label", "none", "flex", "skin", "plane", "hfield"):
                continue
            kind = KIND_OF.get(int(geom.objtype), "")
            owner = layer, kind, int(geom.objid) if kind else -1, name, _shape(geom, name)
            number = numbers[owner]
            numbers[owner] += 1
            for part, (mesh, offset, scale) in enumerate(self._parts(geom, name)):
                key = (*owner, number, part)
                if key not in self._items:
                    if len(self._items) == MOST:
                        self.is_full = True
                        return
                    self._items[key] = _Item(self._node(geom, layer, kind, number, part, mesh))
                self._items[key].add(frame, geom, offset, scale)

    def add_lines(self, frame: int, node: Node, ends: np.ndarray, radius: float) -> None:
        """Adds cylinders between points `(n, 2, 3)`, such as the edges of a flex."""
        for number, (a, b) in enumerate(ends):
            key = (node.kind, node.id, number)
            if key not in self._items:
                if len(self._items) == MOST:
                    self.is_full = True
                    return
                self._items[key] = _Item(
                    replace(node, name=f"{node.name} {number}", mesh=self._shapes.named("cylinder"))
                )
            quaternion = np.empty(4)
            mujoco.mju_quatZ2Vec(quaternion, b - a)
            self._items[key].append(frame, (a + b) / 2, quaternion, (radius, radius, float(np.linalg.norm(b - a)) / 2))

    def nodes(self, first: int, count: int) -> Iterator[tuple[Node, Track]]:
        """Yields the node of each item with its motion.

        Args:
          first: index of the first node.
          count: the number of frames.
        """
        for number, item in enumerate(self._items.values()):
            yield item.finished(first + number, count)

    def _parts(self, geom: mujoco.MjvGeom, name: str) -> Iterator[tuple[Mesh, float, Vector]]:
        """Yields meshes, their distance along z from the position of the geom, and their scales."""
        x, y, z = (float(side) for side in geom.size)
        found: list[tuple[Mesh | None, float, Vector]]
        match name:
            case "sphere" | "ellipsoid":
                found = [(self._shapes.named("sphere"), 0.0, (x, y, z))]
            case "capsule":  # in a chain, each is rounded at one end
                found = [(self._shapes.named("cylinder"), 0.0, (x, x, z)), (self._shapes.named("sphere"), z, (x, x, x))]
            case "mesh" | "sdf":
                found = [(self._shapes.asset(int(geom.dataid)), 0.0, (1.0, 1.0, 1.0))]
            case "line":
                found = [(self._shapes.named(name), 0.0, (1.0, 1.0, z))]
            case "triangle":
                corner = _corner(geom)
                mesh = self._shapes.shared((name, corner), partial(meshes.triangle, *corner))
                found = [(mesh, 0.0, (x, x, 1.0))]
            case _:
                found = [(self._shapes.named(name), 0.0, (x, y, z))]
        for textured, offset, scale in found:
            mesh = self._shapes.plain(textured)
            if mesh is not None:
                yield mesh, offset, scale

    def _node(self, geom: mujoco.MjvGeom, layer: str, kind: str, number: int, part: int, mesh: Mesh) -> Node:
        is_contact = layer.startswith("contact")
        own = kind if kind in NAMED else "contact" if is_contact else "decoration"
        name = layer or (object_name(self._model, int(geom.objtype), int(geom.objid)) if kind else "") or own
        ending = f" {number}" + (f".{part}" if part else "")
        return Node(
            name=clean(name) + ending,
            kind=own,
            id=int(geom.objid) if own in NAMED else -1,
            parent=0,
            moves=True,
            mesh=mesh,
            material=self._surfaces.material(geom, None, two_sided=TYPES[int(geom.type)] == "triangle"),
            layer=layer if is_contact else "",
        )


class _Item:
    """The poses of an item at the frames at which it exists."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._frames, self._rows = array("q"), array("d")

    def add(self, frame: int, geom: mujoco.MjvGeom, offset: float, scale: Vector) -> None:
        """Adds the pose of a geom at a frame."""
        matrix, quaternion = np.array(geom.mat, float), np.empty(4)
        if TYPES[int(geom.type)] == "triangle":  # its first two axes are its sides, at any angle
            matrix[:, 1] = np.cross(matrix[:, 2], matrix[:, 0])
        mujoco.mju_mat2Quat(quaternion, matrix.ravel())
        self.append(frame, np.asarray(geom.pos, float) + offset * matrix[:, 2], quaternion, scale)

    def append(self, frame: int, position: np.ndarray, quaternion: np.ndarray, scale: Vector) -> None:
        """Adds a pose at a frame."""
        self._frames.append(frame)
        self._rows.extend((*position.tolist(), *quaternion.tolist(), *scale))

    def finished(self, index: int, count: int) -> tuple[Node, Track]:
        """Returns the node, whose index is given, and its motion in `count` frames."""
        frames, rows = np.array(self._frames), np.array(self._rows).reshape(-1, NUMBERS)
        smooth = len(frames) == count
        if not smooth:
            frames, rows = _with_absences(frames, rows, count)
        changes = np.flatnonzero(np.any(rows[1:] != rows[:-1], axis=1)) + 1
        if not smooth or not len(changes):
            kept = np.concatenate([[0], changes])
            frames, rows = frames[kept], rows[kept]
        positions, quaternions, scales = rows[:, :3], rows[:, 3:7], rows[:, 7:]
        node = replace(
            self._node,
            position=tuple(positions[0].tolist()),
            quaternion=tuple(quaternions[0].tolist()),
            scale=tuple(scales[0].tolist()),
        )
        return node, Track(index, frames, positions, quaternions, scales, smooth)


def _shape(geom: mujoco.MjvGeom, name: str) -> object:
    """Returns what distinguishes the mesh of a geom from those of others of its type `name`."""
    if name in ("mesh", "sdf"):
        return int(geom.dataid)
    return _corner(geom) if name == "triangle" else -1


def _corner(geom: mujoco.MjvGeom) -> tuple[float, float]:
    """Returns the third corner of a triangle whose first ones are 0 and 1 on the x axis, and whose normal is z."""
    sides = np.asarray(geom.mat, float)
    ratio = float(geom.size[1] / geom.size[0]) if geom.size[0] else 0.0
    across = np.cross(sides[:, 2], sides[:, 0])
    right, up = (ratio * float(sides[:, 1] @ axis) for axis in (sides[:, 0], across))
    return round(right, 5), round(up, 5)


def _with_absences(frames: np.ndarray, rows: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns frames and rows with rows of size 0 where an item is absent."""
    absent = np.setdiff1d(np.concatenate([[0], frames[:-1] + 1, frames[-1:] + 1]), frames)
    absent = absent[absent < count]
    before = np.maximum(np.searchsorted(frames, absent) - 1, 0)
    gone = rows[before].copy()
    gone[:, 7:] = 0
    order = np.argsort(np.concatenate([frames, absent]), kind="stable")
    return np.concatenate([frames, absent])[order], np.concatenate([rows, gone])[order]


def flex_ends(scene: mujoco.MjvScene, flex: int) -> np.ndarray:
    """Returns the ends of the edges of a flex, `(n, 2, 3)`."""
    edges = scene.flexedge.reshape(-1, 2)[scene.flexedgeadr[flex] :][: scene.flexedgenum[flex]]
    points = scene.flexvert.reshape(-1, 3)[scene.flexvertadr[flex] :][: scene.flexvertnum[flex]]
    return np.asarray(points, float)[edges]
