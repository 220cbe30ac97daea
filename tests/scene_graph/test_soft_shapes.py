"""Shapes of flexes, skins and tendons, against closed forms and MuJoCo's own lengths and poses."""

from collections import Counter

import mujoco
import numpy as np
import pytest

from mjrun.scene_graph.meshes import LineSegments, SoftShapes, TriangleSurface


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
