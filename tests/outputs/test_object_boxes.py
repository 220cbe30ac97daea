"""Boxes around objects, against points on the surfaces of their geoms."""

import mujoco
import numpy as np
import pytest

from mjrun.outputs.labelled_images import ObjectBox, ObjectBoxes

GEOMS = {
    "sphere": 'type="sphere" size=".3"',
    "capsule": 'type="capsule" size=".1 .3"',
    "cylinder": 'type="cylinder" size=".2 .3"',
    "ellipsoid": 'type="ellipsoid" size=".1 .2 .4"',
    "box": 'type="box" size=".1 .2 .4"',
    "mesh": 'type="mesh" mesh="m"',
}
TETRAHEDRON = "0 0 0  .5 0 0  0 .3 0  .1 .1 .7"


def surface(model: mujoco.MjModel, kind: str) -> np.ndarray:
    """Returns points on the surface of geom 0 in its frame `(n, 3)`."""
    if kind == "mesh":
        return np.array(model.mesh_vert, float)
    angles = np.linspace(0, 2 * np.pi, 721)
    heights = np.linspace(-1, 1, 201)
    size = model.geom_size[0]
    around, along = (grid.ravel() for grid in np.meshgrid(angles, heights))
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    if kind == "box":
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return corners * size
    if kind == "cylinder":
        return np.column_stack([ring * size[0], along * size[1]])
    ball = np.column_stack([ring * np.sqrt(1 - along**2)[:, None], along])
    if kind == "capsule":
        return ball * size[0] + np.sign(ball[:, 2:]) * [0, 0, size[1]]
    return ball * (size if kind == "ellipsoid" else size[0])


def test_the_box_around_a_finite_plane_is_flat() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body pos="1 2 3" euler="10 -40 60"><geom type="plane" size=".3 .2 1" pos=".1 .2 .3"/>
        <geom type="plane" size="0 0 1"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.xmat[1].reshape(3, 3), data.xpos[1]
    box = ObjectBoxes(model, [1], np.array([-1, 0]), np.ones(model.ngeom, bool)).box(0, pose, data)
    np.testing.assert_allclose([box.center, box.size], [[0.1, 0.2, 0.3], [0.6, 0.4, 0]], atol=1e-12)


@pytest.mark.parametrize("kind", GEOMS)
@pytest.mark.parametrize("child", [False, True], ids=["own", "child"])
def test_a_box_encloses_a_geom_and_is_tight_for_the_body_of_the_object(kind: str, child: bool) -> None:
    geom = f'<geom {GEOMS[kind]} pos=".1 -.2 .3" quat=".7 .3 -.5 .2"/>'
    inner = f'<body pos=".4 0 .1" euler="20 30 40"><joint/>{geom}</body>' if child else geom
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="m" vertex="{TETRAHEDRON}"/></asset><worldbody>'
        f'<geom type="plane" size="1 1 1"/><body pos="1 2 3" euler="10 -40 60">{inner}</body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.xmat[1].reshape(3, 3), data.xpos[1]
    owners = np.array([-1, *[0] * (model.nbody - 1)])
    box = ObjectBoxes(model, [1], owners, np.ones(model.ngeom, bool)).box(0, pose, data)

    geom_id = 1
    model.geom_size[0] = model.geom_size[geom_id]
    points = data.geom_xpos[geom_id] + surface(model, kind) @ data.geom_xmat[geom_id].reshape(3, 3).T
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    low, high = box.center - box.size / 2, box.center + box.size / 2
    assert (local >= low - 1e-7).all()
    assert (local <= high + 1e-7).all()
    if not child:
        np.testing.assert_allclose(local.min(axis=0), low, atol=1e-4)
        np.testing.assert_allclose(local.max(axis=0), high, atol=1e-4)


def test_invisible_geoms_and_bodies_without_geoms_have_no_box() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><geom size="1"/><geom size="5"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    owners = np.array([-1, 0])
    box = ObjectBoxes(model, [1], owners, np.array([True, False])).box(0, np.eye(4), data)
    np.testing.assert_allclose(box.size, 2)
    empty = ObjectBoxes(model, [1], owners, np.array([False, False])).box(0, np.eye(4), data)
    assert not empty.size.any()


def test_corners_are_moved_by_the_pose() -> None:
    pose = np.array([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1.0]])  # a quarter turn about z
    corners = ObjectBox(np.array([1.0, 0, 0]), np.array([2.0, 4, 6])).corners(pose)
    assert sorted(map(tuple, corners)) == sorted(
        (5 + y, 6 + x, 7 + z) for x in (0, 2) for y in (2, -2) for z in (-3, 3)
    )
