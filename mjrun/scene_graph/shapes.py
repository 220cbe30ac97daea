"""Triangles of primitive shapes, of size 1 where the scale of a node can set the size."""

import math

import numpy as np

from mjrun.scene_graph.graph import Mesh


def sphere(slices: int, stacks: int) -> Mesh:
    """Returns a sphere of radius 1."""
    return _revolved("sphere", *_arc(math.pi / 2, -math.pi / 2, stacks), slices)


def capsule(half: float, slices: int, stacks: int) -> Mesh:
    """Returns a capsule of radius 1 around z, whose cylinder has the length 2 `half`."""
    (top, above), (bottom, below) = _arc(math.pi / 2, 0, stacks // 2), _arc(0, -math.pi / 2, stacks // 2)
    offset = np.array([0, half])
    profile = np.concatenate([top + offset, bottom - offset])
    return _revolved("capsule", profile, np.concatenate([above, below]), slices)


def cylinder(slices: int) -> Mesh:
    """Returns a cylinder around z of radius 1 and length 2."""
    profile = np.array([(0, 1), (1, 1), (1, 1), (1, -1), (1, -1), (0, -1)], float)
    normals = np.array([(0, 1), (0, 1), (1, 0), (1, 0), (0, -1), (0, -1)], float)
    return _revolved("cylinder", profile, normals, slices)


def cone(slices: int) -> Mesh:
    """Returns a cone around z from radius 1 at 0 to its tip at 1."""
    slope = math.sqrt(0.5)
    profile = np.array([(0, 1), (1, 0), (1, 0), (0, 0)], float)
    normals = np.array([(slope, slope), (slope, slope), (0, -1), (0, -1)], float)
    return _revolved("cone", profile, normals, slices)


def box() -> Mesh:
    """Returns a cube from −1 to 1."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    positions, normals = list[np.ndarray](), list[np.ndarray]()
    for axis in range(3):
        for sign in (1, -1):
            face = np.empty((4, 3))
            face[:, axis] = sign
            face[:, [(axis + 1) % 3, (axis + 2) % 3]] = corners[::sign]
            normal = np.zeros((4, 3))
            normal[:, axis] = sign
            positions.append(face)
            normals.append(normal)
    faces = np.concatenate([np.array([(0, 1, 2), (0, 2, 3)]) + 4 * side for side in range(6)])
    return _mesh("box", np.concatenate(positions), np.concatenate(normals), faces)


def plane(halfx: float, halfy: float) -> Mesh:
    """Returns a rectangle in the plane z = 0, seen from above."""
    positions = np.array([(-halfx, -halfy, 0), (halfx, -halfy, 0), (halfx, halfy, 0), (-halfx, halfy, 0)])
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    return _mesh("plane", positions, normals, np.array([(0, 1, 2), (0, 2, 3)]))


def _arc(start: float, end: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (radius, height) on a circle of radius 1 between two latitudes [rad], and their normals."""
    latitudes = np.linspace(start, end, count + 1)
    points = np.column_stack([np.cos(latitudes), np.sin(latitudes)])
    points[np.abs(points) < 1e-15] = 0  # the poles are on the axis
    return points, points.copy()


def _revolved(name: str, profile: np.ndarray, normals: np.ndarray, slices: int) -> Mesh:
    """Returns the surface of revolution around z of a profile (radius, height) `(n, 2)` from top to bottom."""
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
    return _mesh(name, points, turned(normals).reshape(-1, 3), faces[is_visible])


def _mesh(name: str, positions: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> Mesh:
    """Returns a mesh without the vertices that no face uses."""
    used, inverse = np.unique(faces, return_inverse=True)
    return Mesh(
        name,
        positions[used].astype(np.float32),
        normals[used].astype(np.float32),
        inverse.reshape(faces.shape).astype(np.uint32),
    )
