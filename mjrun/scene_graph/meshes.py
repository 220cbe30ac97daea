"""Triangles of primitive shapes, of the assets of a model, and of its flexes and skins; segments of its tendons.

Shapes have size 1 where the scale of a node can set the size. Their texture coordinates are those of MuJoCo's classic
renderer.
"""

import copy
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.model.names import object_names
from mjrun.scene_graph.graph import Mesh

TINY = 1e-12  # length of a normal below which it has no direction
INFLUENCES = 4  # bodies that move a vertex of a skin: other programs support no more
UP = np.array([0.0, 0.0, 1.0])
ALL = mujoco.mjtCatBit.mjCAT_ALL.value
FLEX, SKIN = int(mujoco.mjtGeom.mjGEOM_FLEX), int(mujoco.mjtGeom.mjGEOM_SKIN)
CAPSULE, TENDON = int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtObj.mjOBJ_TENDON)
MOST_SEGMENTS = 10_000  # of tendons
Rgba = tuple[float, float, float, float]


def sphere(slices: int, stacks: int) -> Mesh:
    """Returns a sphere of radius 1."""
    points, normals = _arc(math.pi / 2, -math.pi / 2, stacks)
    return _revolved("sphere", points, normals, np.linspace(0, 1, stacks + 1), slices)


def capsule(half: float, slices: int, stacks: int) -> Mesh:
    """Returns a capsule of radius 1 around z, whose cylinder has the length 2 `half`."""
    count, offset = stacks // 2, np.array([0, half])
    (top, above), (bottom, below) = _arc(math.pi / 2, 0, count), _arc(0, -math.pi / 2, count)
    across, v = np.linspace(0, 1, count + 1), (0.0, 1.0)
    profile = np.concatenate([top + offset, top[-1:] + offset, bottom[:1] - offset, bottom - offset])
    normals = np.concatenate([above, above[-1:], below[:1], below])
    return _revolved("capsule", profile, normals, np.concatenate([across, v, across]), slices)


def cylinder(slices: int) -> Mesh:
    """Returns a cylinder around z of radius 1 and length 2."""
    side = _revolved("cylinder", np.array([(1, 1), (1, -1)]), np.array([(1, 0), (1, 0)]), np.array([0, 1]), slices)
    return merged("cylinder", [_disk(1, slices), side, _disk(-1, slices)])


def cone(slices: int) -> Mesh:
    """Returns a cone around z from radius 1 at 0 to its tip at 1."""
    slope = math.sqrt(0.5)
    side = _revolved("cone", np.array([(0, 1), (1, 0)]), np.full((2, 2), slope), np.array([0, 1]), slices)
    return merged("cone", [side, placed(_disk(-1, slices), (1, 1, 1), 1)])


def arrow(slices: int, head: float) -> Mesh:
    """Returns an arrow of MuJoCo along z from 0 to 1/2, with a shaft of radius 1 and a head of radius `head`."""
    shaft = placed(cylinder(slices), (1, 1, 1 / 6), 1 / 6)
    return merged("arrow", [shaft, placed(cone(slices), (head, head, 1 / 6), 1 / 3)])


def double_arrow(slices: int) -> Mesh:
    """Returns an arrow of MuJoCo along z from −1/2 to 1/2, with heads at both ends."""
    up = placed(cone(slices), (1.75, 1.75, 1 / 6), 1 / 3)
    assert up.normals is not None
    turned = np.array([1, -1, -1], np.float32)  # by 180° about x
    down = Mesh(up.name, up.positions * turned, up.normals * turned, up.faces, up.uv)
    return merged("double arrow", [placed(cylinder(slices), (1, 1, 1 / 3), 0), up, down])


def line() -> Mesh:
    """Returns a line along z from 0 to 1."""
    return Mesh("line", np.array([(0, 0, 0), (0, 0, 1)], np.float32), None, np.array([(0, 1)], np.uint32))


def edges() -> Mesh:
    """Returns the edges of a cube from −1 to 1."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    pairs = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    return Mesh("edges", corners, None, np.array(pairs, np.uint32))


def triangle(x: float, y: float) -> Mesh:
    """Returns the triangle between the origin, 1 on the x axis and a point `(x, y)`, seen from above."""
    positions = np.array([(0, 0, 0), (1, 0, 0), (x, y, 0)], float)
    return _mesh("triangle", positions, np.tile([0.0, 0.0, 1.0], (3, 1)), np.array([(0, 1, 2)]))


def placed(mesh: Mesh, scale: tuple[float, float, float], height: float) -> Mesh:
    """Returns a mesh that is scaled and then moved along z."""
    assert mesh.normals is not None
    normals = mesh.normals / np.array(scale)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    positions = mesh.positions * np.array(scale) + np.array([0, 0, height])
    return Mesh(mesh.name, positions.astype(np.float32), normals.astype(np.float32), mesh.faces, mesh.uv)


def merged(name: str, meshes: Sequence[Mesh]) -> Mesh:
    """Returns one mesh of several, all with texture coordinates or none."""
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    faces = [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
    positions = np.concatenate([mesh.positions for mesh in meshes])
    normals = np.concatenate([mesh.normals for mesh in meshes if mesh.normals is not None])
    coordinates = [mesh.uv for mesh in meshes if mesh.uv is not None]
    uv = np.concatenate(coordinates) if len(coordinates) == len(meshes) else None
    return Mesh(name, positions, normals, np.concatenate(faces), uv)


def box() -> Mesh:
    """Returns a cube from −1 to 1."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    positions, normals, uv = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    for axis in range(3):
        for sign in (1, -1):
            face = np.empty((4, 3))
            face[:, axis] = sign
            face[:, [(axis + 1) % 3, (axis + 2) % 3]] = corners[::sign]
            normal = np.zeros((4, 3))
            normal[:, axis] = sign
            across, down = (each for each in range(3) if each != axis)
            positions.append(face)
            normals.append(normal)
            uv.append(np.column_stack([1 + face[:, across], 1 - face[:, down]]) / 2)
    faces = np.concatenate([np.array([(0, 1, 2), (0, 2, 3)]) + 4 * side for side in range(6)])
    return _mesh("box", np.concatenate(positions), np.concatenate(normals), faces, np.concatenate(uv))


def plane(x: float, y: float, reach: float) -> Mesh:
    """Returns a rectangle in the plane z = 0, seen from above.

    Args:
      x, y: half its sides [m]; 0 for infinite ones, whose texture repeats every 2 m.
      reach: half the sides that it has where they are infinite [m].
    """
    right, top = x or reach, y or reach
    positions = np.array([(-right, -top, 0), (right, -top, 0), (right, top, 0), (-right, top, 0)])
    u = positions[:, 0] / (2 * x) + 0.5 if x else positions[:, 0] / 2
    v = 0.5 - positions[:, 1] / (2 * y) if y else -positions[:, 1] / 2
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    return _mesh("plane", positions, normals, np.array([(0, 1, 2), (0, 2, 3)]), np.column_stack([u, v]))


def _arc(start: float, end: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (radius, height) on a circle of radius 1 between two latitudes [rad], and their normals."""
    latitudes = np.linspace(start, end, count + 1)
    points = np.column_stack([np.cos(latitudes), np.sin(latitudes)])
    points[np.abs(points) < 1e-15] = 0  # the poles are on the axis
    return points, points.copy()


def _disk(side: int, slices: int) -> Mesh:
    """Returns the disk at one end of a cylinder, 1 or −1."""
    profile = np.array([(0, side), (1, side)][::side])
    disk = _revolved("disk", profile, np.array([(0, side)] * 2), np.zeros(2), slices)
    return Mesh("disk", disk.positions, disk.normals, disk.faces, 0.5 + 0.5 * disk.positions[:, :2])


def _revolved(name: str, profile: np.ndarray, normals: np.ndarray, v: np.ndarray, slices: int) -> Mesh:
    """Returns the surface of revolution around z of a profile (radius, height) `(n, 2)` from top to bottom.

    Args:
      normals: the normals of the profile `(n, 2)`.
      v: its second texture coordinate `(n,)`; the first one goes around.
    """
    angles = np.linspace(0, 2 * math.pi, slices + 1)
    turns = np.column_stack([np.cos(angles), np.sin(angles)])
    turns[-1] = turns[0]

    def turned(values: np.ndarray) -> np.ndarray:
        around = values[:, None, :1] * turns
        return np.concatenate([around, np.broadcast_to(values[:, None, 1:], (*around.shape[:2], 1))], axis=2)

    rows = np.arange(len(profile) - 1)[:, None] * (slices + 1)
    first = (rows + np.arange(slices)).ravel()
    below = first + slices + 1
    upper = np.column_stack([first, below, below + 1])
    lower = np.column_stack([first, below + 1, first + 1])
    points = turned(profile).reshape(-1, 3)
    faces = np.concatenate([upper, lower])
    edges = points[faces[:, 1:]] - points[faces[:, :1]]
    is_visible = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 1e-12  # none of those at the poles
    uv = np.stack(np.meshgrid(np.linspace(0, 1, slices + 1), v), axis=-1).reshape(-1, 2)
    return _mesh(name, points, turned(normals).reshape(-1, 3), faces[is_visible], uv)


def _mesh(
    name: str, positions: np.ndarray, normals: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None
) -> Mesh:
    """Returns a mesh without the vertices that no face uses."""
    used, inverse = np.unique(faces, return_inverse=True)
    return Mesh(
        name,
        positions[used].astype(np.float32),
        normals[used].astype(np.float32),
        inverse.reshape(faces.shape).astype(np.uint32),
        None if uv is None else uv[used].astype(np.float32),
    )


def mesh_asset(model: mujoco.MjModel, index: int) -> Mesh:
    """Returns a mesh of the model; corners that share position, normal and texture coordinates share a vertex."""
    faces = slice(model.mesh_faceadr[index], model.mesh_faceadr[index] + model.mesh_facenum[index])
    corners = [model.mesh_face[faces].ravel(), model.mesh_facenormal[faces].ravel()]
    start = model.mesh_texcoordadr[index]
    if start >= 0:
        corners.append(model.mesh_facetexcoord[faces].ravel())
    combinations = np.column_stack(corners)
    first, inverse = unique_rows(combinations)
    vertices = combinations[first]
    uv = None
    if start >= 0:
        uv = model.mesh_texcoord[start : start + model.mesh_texcoordnum[index]][vertices[:, 2]]
    return Mesh(
        _name(model, "mesh", index),
        model.mesh_vert[model.mesh_vertadr[index] + vertices[:, 0]].astype(np.float32),
        unit(model.mesh_normal[model.mesh_normaladr[index] + vertices[:, 1]]),
        inverse.reshape(-1, 3).astype(np.uint32),
        None if uv is None else uv.astype(np.float32),
    )


def mesh_hull(model: mujoco.MjModel, index: int) -> Mesh | None:
    """Returns the convex hull of a mesh with flat faces; None if MuJoCo has not computed it."""
    start = model.mesh_graphadr[index]
    if start < 0:
        return None
    numvert, numface = model.mesh_graph[start : start + 2]
    first = start + 2 + 3 * numvert + 3 * numface  # after the counts, two arrays of vertices, and the edges
    faces = model.mesh_graph[first : first + 3 * numface].reshape(-1, 3)
    return flat(f"{_name(model, 'mesh', index)} hull", model.mesh_vert[model.mesh_vertadr[index] + faces])


def height_field(model: mujoco.MjModel, index: int) -> Mesh:
    """Returns the surface of a height field, with its sides and its base."""
    rows, columns = int(model.hfield_nrow[index]), int(model.hfield_ncol[index])
    halfx, halfy, top, base = map(float, model.hfield_size[index])
    start = model.hfield_adr[index]
    heights = top * model.hfield_data[start : start + rows * columns].reshape(rows, columns).astype(float)
    x, y = np.meshgrid(np.linspace(-halfx, halfx, columns), np.linspace(-halfy, halfy, rows))
    points = np.stack([x, y, heights], axis=-1)

    slopey, slopex = np.gradient(heights, 2 * halfy / (rows - 1), 2 * halfx / (columns - 1))
    normals = unit(np.stack([-slopex, -slopey, np.ones_like(heights)], axis=-1).reshape(-1, 3))
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + 1, corner + columns + 1]),
            np.column_stack([corner, corner + columns + 1, corner + columns]),
        ]
    )
    walls = [points[0], points[:, -1], points[-1, ::-1], points[::-1, 0]]
    sides = flat("side", np.concatenate([_wall(edge, -base) for edge in walls] + [_floor(halfx, halfy, -base)]))
    return Mesh(
        _name(model, "hfield", index),
        np.concatenate([points.reshape(-1, 3).astype(np.float32), sides.positions]),
        np.concatenate([normals, np.asarray(sides.normals)]),
        np.concatenate([faces.astype(np.uint32), sides.faces + np.uint32(rows * columns)]),
    )


def skin_asset(model: mujoco.MjModel, index: int) -> tuple[Mesh, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns a skin where it is bound to its bodies, with its binding.

    Returns:
      The mesh; the ids of the bodies `(k,)`; the transformations from the mesh to each `(k, 4, 4)`; and the bodies of
      each vertex that move it most, as indices, with their shares, `(n, 4)` both.
    """
    vertices = slice(model.skin_vertadr[index], model.skin_vertadr[index] + model.skin_vertnum[index])
    faces = model.skin_face[model.skin_faceadr[index] :][: model.skin_facenum[index]].astype(np.uint32)
    positions = model.skin_vert[vertices].astype(float)
    normals = smooth_normals(positions, faces)
    start = model.skin_texcoordadr[index]
    uv = None if start < 0 else model.skin_texcoord[start : start + len(positions)].astype(np.float32)
    inflated = positions + float(model.skin_inflate[index]) * normals
    mesh = Mesh(_name(model, "skin", index), inflated.astype(np.float32), normals, faces, uv)

    bones = range(model.skin_boneadr[index], model.skin_boneadr[index] + model.skin_bonenum[index])
    binds, shares = np.empty((len(bones), 4, 4)), np.zeros((len(positions), len(bones)))
    for row, bone in enumerate(bones):
        bind, rotation = np.eye(4), np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.skin_bonebindquat[bone].astype(float))
        bind[:3, :3], bind[:3, 3] = rotation.reshape(3, 3), model.skin_bonebindpos[bone]
        binds[row] = np.linalg.inv(bind)
        part = slice(model.skin_bonevertadr[bone], model.skin_bonevertadr[bone] + model.skin_bonevertnum[bone])
        np.add.at(shares[:, row], model.skin_bonevertid[part], model.skin_bonevertweight[part])
    shares = np.pad(shares, ((0, 0), (0, max(0, INFLUENCES - len(bones)))))
    joints = np.argsort(-shares, axis=1, kind="stable")[:, :INFLUENCES]
    weights = np.take_along_axis(shares, joints, axis=1)
    joints[weights == 0] = 0
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), TINY)
    return mesh, model.skin_bonebodyid[bones.start : bones.stop], binds, joints, weights


def smooth_normals(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns the normals of vertices `(n, 3)` float32, averaged over their faces by area."""
    a, b, c = positions[faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    sums = np.zeros(positions.shape)
    for corner in range(3):
        np.add.at(sums, faces[:, corner], across)
    return unit(sums)


def flat(name: str, triangles: np.ndarray) -> Mesh:
    """Returns a mesh of separate triangles `(n, 3, 3)`, each with its own normal."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return Mesh(
        name,
        triangles.reshape(-1, 3).astype(np.float32),
        np.repeat(unit(normals), 3, axis=0),
        np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3),
    )


def unique_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the index of the first row of each kind, and the kind of each row, as `np.unique` does, but faster."""
    rows = np.ascontiguousarray(rows + np.zeros(1, rows.dtype))  # −0 becomes 0
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return first, inverse


def unit(vectors: np.ndarray) -> np.ndarray:
    """Returns vectors `(n, 3)` as float32 of length 1; those without a direction point upward."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > TINY, vectors / np.maximum(lengths, TINY), UP).astype(np.float32)


def _wall(edge: np.ndarray, bottom: float) -> np.ndarray:
    """Returns the triangles of a wall from an edge `(n, 3)`, counter-clockwise around the field, to its bottom."""
    low = edge * [1, 1, 0] + [0, 0, bottom]
    left = np.stack([low[:-1], low[1:], edge[1:]], axis=1)
    return np.concatenate([left, np.stack([low[:-1], edge[1:], edge[:-1]], axis=1)])


def _floor(halfx: float, halfy: float, bottom: float) -> np.ndarray:
    a, b, c, d = (
        np.array([x, y, bottom]) for x, y in ((-halfx, -halfy), (halfx, -halfy), (halfx, halfy), (-halfx, halfy))
    )
    return np.array([(a, c, b), (a, d, c)])


def _name(model: mujoco.MjModel, kind: str, index: int) -> str:
    return clean(object_names(model, kind, [index])[0])


@dataclass(frozen=True, eq=False)
class TriangleSurface:
    """A surface of triangles.

    Attributes:
      points: vertices in the world, `(n, 3)` [m].
      faces: indices of the vertices, `(m, 3)`.
      rgba: colour and opacity, from 0 to 1.
    """

    points: np.ndarray
    faces: np.ndarray
    rgba: Rgba


@dataclass(frozen=True, eq=False)
class LineSegments:
    """Thick straight lines.

    Attributes:
      ends: both ends of each line in the world, `(n, 2, 3)` [m].
      width: diameter of the lines [m].
      rgba: colour and opacity, from 0 to 1.
    """

    ends: np.ndarray
    width: float
    rgba: Rgba


class SoftShapes:
    """The flexes, skins and tendons of a model that MuJoCo's visualizer shows with these options."""

    def __init__(self, model: mujoco.MjModel, options: mujoco.MjvOption) -> None:
        self._model = model
        self._options = copy.copy(options)
        self._options.geomgroup[:] = self._options.sitegroup[:] = 0
        self._scene = mujoco.MjvScene(model, MOST_SEGMENTS)
        self._camera = mujoco.MjvCamera()

    @staticmethod
    def exist_in(model: mujoco.MjModel) -> bool:
        """Returns whether a model has such objects, visible or not."""
        return model.nflex + model.nskin + model.ntendon > 0

    def at(self, data: mujoco.MjData) -> list[TriangleSurface | LineSegments]:
        """Returns the shapes of an instant, whose positions are computed."""
        scene = self._scene
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, ALL, scene)
        shapes = list[TriangleSurface | LineSegments]()
        tendons: dict[int, list[mujoco.MjvGeom]] = {}
        for geom in scene.geoms[: scene.ngeom]:
            if geom.type == FLEX:
                shapes.append(self._flex(data, int(geom.objid), _rgba(geom)))
            elif geom.type == SKIN:
                shapes.append(self._skin(int(geom.objid), _rgba(geom)))
            elif geom.objtype == TENDON and geom.type == CAPSULE:
                tendons.setdefault(int(geom.objid), []).append(geom)
        return [*shapes, *map(_tendon, tendons.values())]

    def _flex(self, data: mujoco.MjData, flex: int, rgba: Rgba) -> TriangleSurface | LineSegments:
        model = self._model
        start = model.flex_vertadr[flex]
        points = data.flexvert_xpos[start : start + model.flex_vertnum[flex]].copy()
        if model.flex_dim[flex] == 1:
            first = model.flex_edgeadr[flex]
            edges = model.flex_edge[first : first + model.flex_edgenum[flex]]
            return LineSegments(points[edges], 2 * float(model.flex_radius[flex]), rgba)
        if model.flex_dim[flex] == 2:
            first, count, vertices = model.flex_elemdataadr[flex], model.flex_elemnum[flex], model.flex_elem
        else:
            first, count, vertices = model.flex_shelldataadr[flex], model.flex_shellnum[flex], model.flex_shell
        return TriangleSurface(points, vertices[first : first + 3 * count].reshape(-1, 3), rgba)

    def _skin(self, skin: int, rgba: Rgba) -> TriangleSurface:
        model = self._model
        start, first = model.skin_vertadr[skin], model.skin_faceadr[skin]
        points = self._scene.skinvert.reshape(-1, 3)[start : start + model.skin_vertnum[skin]].copy()
        return TriangleSurface(points, model.skin_face[first : first + model.skin_facenum[skin]], rgba)


def _tendon(geoms: Sequence[mujoco.MjvGeom]) -> LineSegments:
    """Returns the segments that the visualizer draws as capsules."""
    centers = np.array([geom.pos for geom in geoms])
    halves = np.array([geom.size[2] * geom.mat[:, 2] for geom in geoms])
    ends = np.stack([centers - halves, centers + halves], axis=1)
    return LineSegments(ends, 2 * float(geoms[0].size[0]), _rgba(geoms[0]))


def _rgba(geom: mujoco.MjvGeom) -> Rgba:
    red, green, blue, opacity = (float(part) for part in geom.rgba)
    return red, green, blue, opacity
