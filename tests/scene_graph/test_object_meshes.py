"""Meshes of objects: in the frame of the object, wherever it is, of everything that belongs to it."""

import mujoco
import numpy as np
import pytest

from mjrun.scene_graph.object_meshes import ObjectMesh, object_meshes

MODEL = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
  <body name="arm" pos="1 2 3" euler="10 20 30"><freejoint/>
    <geom type="box" size=".1 .2 .3" rgba="1 0 .2 1"/>
    <body pos="0 0 .3"><joint name="hinge" axis="0 1 0"/><geom type="box" size=".01 .01 .5" pos="0 0 .5"/></body></body>
  <body name="empty"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".001" dim="2" pos="0 0 2"/>
  </worldbody></mujoco>"""


def meshes(angle: float) -> tuple[list[ObjectMesh | None], mujoco.MjModel]:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.joint("hinge").qpos = angle
    roots = [model.body(name).id for name in ("arm", "empty")] + [int(model.flex_vertbodyid[0])]
    owners = np.full(model.nbody, -1)
    owners[roots[0] : roots[0] + 2], owners[roots[1]], owners[roots[2] :] = 0, 1, 2
    return object_meshes(model, data, roots, owners), model


@pytest.mark.parametrize("angle", [0.0, np.pi / 2])
def test_the_mesh_of_an_object_has_all_its_bodies_in_its_frame(angle: float) -> None:
    (arm, empty, cloth), _ = meshes(angle)
    assert empty is None
    assert arm is not None
    high, low = ([0.1, 0.2, 1.3], [-0.1, -0.2, -0.3]) if angle == 0 else ([1, 0.2, 0.31], [-0.1, -0.2, -0.3])
    np.testing.assert_allclose(arm.positions.max(axis=0), high, atol=1e-6)
    np.testing.assert_allclose(arm.positions.min(axis=0), low, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(arm.normals, axis=1), 1, atol=1e-6)
    assert arm.colors[0].tolist() == [255, 0, 51]
    corners = arm.positions[arm.faces]
    signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert signed == pytest.approx(0.2 * 0.4 * 0.6 + 0.02 * 0.02)  # faces are counter-clockwise from outside
    assert cloth is not None
    np.testing.assert_allclose(np.ptp(cloth.positions, axis=0), [0.2, 0.2, 0.002], atol=1e-6)


def test_the_diameter_is_the_largest_distance_of_two_vertices() -> None:
    random = np.random.default_rng(1)
    for scale in ([1, 1, 1], [3, 1, 0.1], [0, 0, 0]):
        points = random.normal(size=(40, 3)) * scale
        mesh = ObjectMesh(points, points, points, np.zeros((0, 3), int))
        expected = np.linalg.norm(points[:, None] - points, axis=2).max()
        assert mesh.diameter == pytest.approx(expected)
