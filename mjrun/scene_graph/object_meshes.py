"""Meshes of objects: everything visible of a body and its descendants, in the frame of the body."""

from collections.abc import Sequence
from functools import reduce

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.fields import flex_owners, skin_owners
from mjrun.scene_graph.graph import Material, Mesh, Node, Skin
from mjrun.scene_graph.meshes import unit
from mjrun.scene_graph.recorder import SceneContentSettings, compute_poses, record_scene

OPAQUE_WHITE = (1.0, 1.0, 1.0, 1.0)
BLOCK = 1000  # points whose distances are computed at once


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """The triangles of an object.

    Attributes:
      positions: vertices in the frame of the object `(n, 3)` [m].
      normals: `(n, 3)`, of length 1.
      colors: `(n, 3)` uint8.
      faces: indices of the vertices `(m, 3)`.
    """

    positions: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    faces: np.ndarray

    @property
    def diameter(self) -> float:
        """The largest distance between two vertices [m]."""
        points = np.unique(self.positions, axis=0)
        radii = np.linalg.norm(points - (points.min(axis=0) + points.max(axis=0)) / 2, axis=1)
        least = np.linalg.norm(points - points[radii.argmax()], axis=1).max()
        outer = points[radii >= least - radii.max()]  # all others are nearer to every point
        blocks = (outer[first : first + BLOCK, None] - outer for first in range(0, len(outer), BLOCK))
        return reduce(max, (float(np.linalg.norm(block, axis=2).max()) for block in blocks), 0.0)


def object_meshes(
    model: mujoco.MjModel, data: mujoco.MjData, roots: Sequence[int], owners: np.ndarray
) -> list[ObjectMesh | None]:
    """Returns the mesh of each object at an instant; None for one without visible surfaces.

    Args:
      data: the state of the model; its positions are computed.
      roots: the body of each object.
      owners: the object that each body belongs to `(nbody,)`, −1 for none.
    """
    compute_poses(model, data)
    nodes = record_scene(model, [data], [0.0], SceneContentSettings(mujoco.MjvOption()))[0].nodes
    poses = list[np.ndarray]()
    for node in nodes:
        pose: np.ndarray = _matrix(node) if node.parent < 0 else poses[node.parent] @ _matrix(node)
        poses.append(pose)
    by_id = np.append(owners, -1)
    bodies = {"flex": flex_owners(model), "skin": skin_owners(model)}
    parts: list[list[ObjectMesh]] = [[] for _ in roots]
    for node, pose in zip(nodes, poses, strict=True):
        mesh = node.mesh
        if mesh is None or mesh.normals is None:
            continue
        owner = int(by_id[bodies[node.kind][node.id] if node.kind in bodies else node.parent])
        if owner >= 0:
            frame: np.ndarray = np.linalg.inv(poses[roots[owner]])
            moves: np.ndarray = frame @ (_skinning(node.skin, poses) if node.skin else pose[None])
            parts[owner].append(_moved(mesh, moves, node.material))
    return [_merged(each) for each in parts]


def _matrix(node: Node) -> np.ndarray:
    """Returns the transformation `(4, 4)` from a node to its parent."""
    matrix, rotation = np.eye(4), np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.array(node.quaternion))
    matrix[:3, :3], matrix[:3, 3] = rotation.reshape(3, 3) * node.scale, node.position
    return matrix


def _skinning(skin: Skin, poses: Sequence[np.ndarray]) -> np.ndarray:
    """Returns the transformation of each vertex of a skin to the world `(n, 4, 4)`; `poses` are those of the nodes."""
    bones = np.array([poses[body] for body in skin.nodes]) @ skin.binds
    moves: np.ndarray = (skin.weights[..., None, None] * bones[skin.joints]).sum(axis=1)
    return moves


def _moved(mesh: Mesh, moves: np.ndarray, material: Material | None) -> ObjectMesh:
    """Returns a mesh whose vertices are moved by one transformation, or by one each, `(n, 4, 4)`."""
    assert mesh.normals is not None
    turns = moves[:, :3, :3]
    positions = (turns @ mesh.positions[..., None].astype(float))[..., 0] + moves[:, :3, 3]
    normals = (np.linalg.inv(turns).swapaxes(1, 2) @ mesh.normals[..., None])[..., 0]
    color = np.array((material.rgba if material else OPAQUE_WHITE)[:3])
    if material and material.texture:
        color = color * material.texture.pixels[..., :3].mean(axis=(0, 1)) / 255
    colors = np.broadcast_to((255 * np.clip(color, 0, 1)).round().astype(np.uint8), positions.shape)
    return ObjectMesh(positions, unit(normals), colors, mesh.faces)


def _merged(parts: Sequence[ObjectMesh]) -> ObjectMesh | None:
    if not parts:
        return None
    starts = np.cumsum([0, *(len(part.positions) for part in parts)])
    faces = [part.faces.astype(np.int64) + start for part, start in zip(parts, starts, strict=False)]
    return ObjectMesh(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colors for part in parts]),
        np.concatenate(faces),
    )
