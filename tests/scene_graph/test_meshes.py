"""Theorems about the triangles of meshes and height fields, against the compiled model and MuJoCo's rays."""

import math
from collections import Counter

import mujoco
import numpy as np
import pytest

from mjrun.scene_graph import meshes
from mjrun.scene_graph.graph import Mesh
from mjrun.scene_graph.meshes import (
    LineSegments,
    SoftShapes,
    TriangleSurface,
    height_field,
    mesh_asset,
    mesh_hull,
    skin_asset,
    smooth_normals,
)
from tests.cases import mjcf

TETRAHEDRON = mjcf("tetrahedron")
HILL = """
<mujoco>
  <asset><hfield name="hill" nrow="4" ncol="5" size="1 2 .5 .1"
    elevation="0 1 2 0 0  3 1 4 2 5  1 1 1 1 1  0 2 0 2 0"/></asset>
  <worldbody><geom type="hfield" hfield="hill"/></worldbody>
</mujoco>
"""


def test_a_mesh_has_the_triangles_of_the_model_and_no_doubled_vertices() -> None:
    model = mujoco.MjModel.from_xml_string(TETRAHEDRON)
    for index in range(model.nmesh):
        mesh = mesh_asset(model, index)
        faces = slice(model.mesh_faceadr[index], model.mesh_faceadr[index] + model.mesh_facenum[index])
        corners = model.mesh_vert[model.mesh_vertadr[index] + model.mesh_face[faces]]
        assert np.array_equal(mesh.positions[mesh.faces], corners)
        assert mesh.normals is not None
        vertices = np.column_stack([mesh.positions, mesh.normals])
        assert len(np.unique(vertices, axis=0)) == len(vertices)
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)


def test_the_hull_contains_every_vertex() -> None:
    model = mujoco.MjModel.from_xml_string(TETRAHEDRON)
    hull = mesh_hull(model, 1)
    assert hull
    corners = hull.positions[hull.faces].astype(float)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    vertices = model.mesh_vert[model.mesh_vertadr[1] :][: model.mesh_vertnum[1]]
    assert np.einsum("fi,vfi->vf", outward, vertices[:, None] - corners[None, :, 0]).max() < 1e-6


def test_the_surface_of_a_height_field_is_where_rays_hit_it() -> None:
    model = mujoco.MjModel.from_xml_string(HILL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mesh, hit = height_field(model, 0), np.zeros(1, np.int32)
    tops = mesh.positions[:20]
    inside = np.abs(tops[:, :2]) < [0.99, 1.99]
    for point in tops[inside.all(axis=1)]:
        start = point.astype(float) + np.array([0, 0, 1])
        assert abs(mujoco.mj_ray(model, data, start, np.array([0, 0, -1.0]), None, 1, -1, hit) - 1) < 1e-6
    assert mesh.positions[:, 2].min() == np.float32(-0.1)
    assert np.abs(mesh.positions[:, :2]).max(axis=0).tolist() == [1, 2]
    a, b, c = mesh.positions[mesh.faces].transpose(1, 0, 2)
    low = np.array([0, 0, -0.1])
    solid = float(np.sum((a - low) * np.cross(b - low, c - low)) / 6)
    assert solid > 4 * 2 * 0.1  # its faces point outward: the base alone has this volume


SKIN = mjcf("skin")


def test_a_skin_moves_as_mujoco_draws_it() -> None:
    model = mujoco.MjModel.from_xml_string(SKIN)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.1, 0.2, 0.3, 0.6, 0.8, 0, 0, 2, 1, 0, 0.8, 0, 0.6, 0
    mujoco.mj_forward(model, data)
    scene = mujoco.MjvScene(model, 100)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), 7, scene)

    mesh, bodies, binds, joints, weights = skin_asset(model, 0)
    poses = np.tile(np.eye(4), (len(bodies), 1, 1))
    poses[:, :3, :3] = data.xmat[bodies].reshape(-1, 3, 3)
    poses[:, :3, 3] = data.xpos[bodies]
    moved = poses @ binds  # as the specification of glTF defines skinning
    points = np.column_stack([mesh.positions, np.ones(4)])
    placed = np.einsum("vj,vjab,vb->va", weights, moved[joints], points)[:, :3]
    assert np.allclose(weights.sum(axis=1), 1)
    assert np.allclose(placed, scene.skinvert.reshape(-1, 3), atol=1e-6)


def test_normals_are_averages_over_faces() -> None:
    roof = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 1)], float)
    normals = smooth_normals(roof, np.array([(0, 1, 2), (0, 3, 1)]))
    assert np.allclose(normals[2], (0, 0, 1))
    assert np.allclose(normals[0], np.array([0, 1, 1]) / np.sqrt(2), atol=1e-6)


SOLIDS = [
    (meshes.sphere(64, 64), 4 / 3 * math.pi),
    (meshes.capsule(1.5, 64, 64), 4 / 3 * math.pi + 3 * math.pi),
    (meshes.cylinder(64), 2 * math.pi),
    (meshes.cone(64), math.pi / 3),
    (meshes.box(), 8.0),
    (meshes.arrow(64, 1.75), math.pi / 3 + 1.75**2 * math.pi / 18),
    (meshes.double_arrow(64), 2 * math.pi / 3 + 1.75**2 * math.pi / 9),
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
    mesh = meshes.plane(2, 0, 3)
    a, b, c = mesh.positions[mesh.faces].transpose(1, 0, 2)
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0)
    assert np.ptp(mesh.positions, axis=0).tolist() == [4, 6, 0]


def test_lines_and_triangles_have_the_size_of_one() -> None:
    assert np.ptp(meshes.line().positions, axis=0).tolist() == [0, 0, 1]
    assert np.ptp(meshes.edges().positions, axis=0).tolist() == [2, 2, 2]
    assert len({tuple(sorted(pair)) for pair in meshes.edges().faces.tolist()}) == 12
    assert meshes.triangle(0, 1).positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def shapes(xml: str, steps: int = 0, **options: int) -> tuple[mujoco.MjData, list[TriangleSurface | LineSegments]]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    data, option = mujoco.MjData(model), mujoco.MjvOption()
    for name, value in options.items():
        getattr(option, name)[:] = value
    mujoco.mj_step(model, data, steps)
    mujoco.mj_forward(model, data)
    assert SoftShapes.exist_in(model)
    return data, SoftShapes(model, option).at(data)


CLOTH = """<worldbody><flexcomp name="cloth" type="grid" dim="2" count="3 4 1" spacing=".1 .1 .1" radius=".001"
  rgba=".1 .2 .3 1" pos="0 0 1"/></worldbody>"""
JELLY = CLOTH.replace('dim="2" count="3 4 1"', 'dim="3" count="3 3 4"')


def test_a_cloth_has_the_area_of_its_grid_and_its_colour() -> None:
    data, (cloth,) = shapes(CLOTH)
    assert isinstance(cloth, TriangleSurface)
    a, b, c = cloth.points[cloth.faces].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(0.2 * 0.3)
    assert cloth.rgba == pytest.approx((0.1, 0.2, 0.3, 1))
    later, (fallen,) = shapes(CLOTH, 50)
    assert isinstance(fallen, TriangleSurface)
    assert fallen.points.tolist() == later.flexvert_xpos.tolist() != data.flexvert_xpos.tolist()


def test_a_solid_has_a_closed_surface_around_its_volume() -> None:
    _, (jelly,) = shapes(JELLY)
    assert isinstance(jelly, TriangleSurface)
    sides = Counter(tuple(face[[i, (i + 1) % 3]].tolist()) for face in jelly.faces for i in range(3))
    assert all(sides[second, first] == count == 1 for (first, second), count in sides.items())
    a, b, c = jelly.points[jelly.faces].transpose(1, 0, 2)
    assert abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6) == pytest.approx(0.2 * 0.2 * 0.3)


def test_a_cable_of_edges_is_segments() -> None:
    xml = CLOTH.replace('type="grid" dim="2" count="3 4 1"', 'type="grid" dim="1" count="5 1 1"')
    _, (cable,) = shapes(xml)
    assert isinstance(cable, LineSegments)
    assert np.linalg.norm(cable.ends[:, 1] - cable.ends[:, 0], axis=1) == pytest.approx([0.1] * 4)
    assert cable.width == pytest.approx(0.002)


def test_a_skin_follows_its_bone() -> None:
    xml = """<worldbody><body name="b" pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>
    <deformable><skin name="s" rgba="1 0 0 1" vertex="0 0 0 .1 0 0 0 .1 0" face="0 1 2"><bone body="b" bindpos="0 0 0"
      bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>"""
    data, (skin,) = shapes(xml, 50)
    assert isinstance(skin, TriangleSurface)
    local = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    expected = data.body("b").xpos + local @ data.body("b").xmat.reshape(3, 3).T
    assert skin.points == pytest.approx(expected, abs=1e-6)
    assert skin.faces.tolist() == [[0, 1, 2]]


ROPE = """<worldbody><site name="a" pos="-.5 0 1"/>
  <geom name="roll" type="cylinder" size=".1 .2" zaxis="0 1 0" pos="0 0 1.05"/>
  <body pos=".5 0 1"><joint axis="0 1 0"/><geom size=".05"/><site name="b" pos="0 0 -.2"/></body></worldbody>
  <tendon><spatial name="rope" width=".004" rgba="0 1 0 1"><site site="a"/><geom geom="roll"/><site site="b"/></spatial>
  </tendon>"""


def test_a_rope_is_as_long_as_its_tendon_and_ends_at_its_sites() -> None:
    data, (rope,) = shapes(ROPE, 20)
    assert isinstance(rope, LineSegments)
    lengths = np.linalg.norm(rope.ends[:, 1] - rope.ends[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(data.ten_length[0], rel=0.01)
    for site in data.site_xpos:
        assert np.abs(rope.ends.reshape(-1, 3) - site).max(axis=1).min() < 1e-6
    assert [rope.width, *rope.rgba] == pytest.approx([0.008, 0, 1, 0, 1])


def test_hidden_groups_have_no_shapes() -> None:
    assert shapes(CLOTH, flexgroup=0)[1] == []
    assert shapes(ROPE, tendongroup=0)[1] == []
