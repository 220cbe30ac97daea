"""Theorems about tessellated shapes: they are closed, face outward, and have the right volume."""

import math
from collections import Counter

import numpy as np
import pytest

from mjrun.scene_graph import shapes
from mjrun.scene_graph.graph import Mesh

SOLIDS = [
    (shapes.sphere(64, 64), 4 / 3 * math.pi),
    (shapes.capsule(1.5, 64, 64), 4 / 3 * math.pi + 3 * math.pi),
    (shapes.cylinder(64), 2 * math.pi),
    (shapes.cone(64), math.pi / 3),
    (shapes.box(), 8.0),
    (shapes.arrow(64, 1.75), math.pi / 3 + 1.75**2 * math.pi / 18),
    (shapes.double_arrow(64), 2 * math.pi / 3 + 1.75**2 * math.pi / 9),
]


def volume(mesh: Mesh) -> float:
    """Returns the enclosed volume, by the divergence theorem; positive if faces are counter-clockwise from outside."""
    a, b, c = mesh.positions[mesh.faces].astype(float).transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6)


@pytest.mark.parametrize(("mesh", "expected"), SOLIDS, ids=[mesh.name for mesh, _ in SOLIDS])
def test_the_volume_is_that_of_the_solid(mesh: Mesh, expected: float) -> None:
    assert volume(mesh) == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("mesh", [mesh for mesh, _ in SOLIDS[:5]], ids=lambda mesh: mesh.name)
def test_the_surface_is_closed(mesh: Mesh) -> None:
    _, points = np.unique(mesh.positions.round(5), axis=0, return_inverse=True)
    faces = points.ravel()[mesh.faces]
    edges = Counter((int(face[i]), int(face[(i + 1) % 3])) for face in faces for i in range(3))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


@pytest.mark.parametrize("mesh", [mesh for mesh, _ in SOLIDS], ids=lambda mesh: mesh.name)
def test_normals_have_length_one_and_the_side_of_their_faces(mesh: Mesh) -> None:
    assert mesh.normals is not None
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)
    a, b, c = mesh.positions[mesh.faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert np.einsum("fci,fi->fc", mesh.normals[mesh.faces], across).min() > 0.7


def test_a_plane_faces_upward() -> None:
    mesh = shapes.plane(2, 0, 3)
    a, b, c = mesh.positions[mesh.faces].transpose(1, 0, 2)
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0)
    assert np.ptp(mesh.positions, axis=0).tolist() == [4, 6, 0]


def test_lines_and_triangles_have_the_size_of_one() -> None:
    assert np.ptp(shapes.line().positions, axis=0).tolist() == [0, 0, 1]
    assert np.ptp(shapes.edges().positions, axis=0).tolist() == [2, 2, 2]
    assert len({tuple(sorted(pair)) for pair in shapes.edges().faces.tolist()}) == 12
    assert shapes.triangle().positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
