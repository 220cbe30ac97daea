"""The meshes and height fields of a model as triangles."""

import mujoco
import numpy as np

from mjrun.errors import clean
from mjrun.model.names import object_names
from mjrun.scene_graph.graph import Mesh

TINY = 1e-12  # length of a normal below which it has no direction
INFLUENCES = 4  # bodies that move a vertex of a skin: other programs support no more
UP = np.array([0.0, 0.0, 1.0])


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
    halfx, halfy, top, base = model.hfield_size[index]
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
