"""Triangles of primitive shapes, of size 1 where the scale of a node can set the size.

Their texture coordinates are those of MuJoCo's classic renderer.
"""

import math
from collections.abc import Sequence

import numpy as np

from mjrun.scene_graph.graph import Mesh


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


def triangle() -> Mesh:
    """Returns the triangle between the origin and 1 on x and y, seen from above."""
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float)
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
