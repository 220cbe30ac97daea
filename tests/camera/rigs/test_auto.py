"""The camera that keeps the whole motion in view, against projections of every corner in every frame."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjrun.camera.pose import CameraPose, lens
from mjrun.camera.rigs.auto import FARTHEST, AutoRig
from mjrun.camera.rigs.rig import MujocoCameras
from mjrun.camera.script import LEVEL, CameraScript, EasedNumber, Shot
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.camera.targets import object_bounds
from mjrun.model.state import save

SIZE = (160, 90)
MODEL = """<mujoco><option gravity="0 0 0"/><visual><global azimuth="35" elevation="-20" {view}/></visual>
  <worldbody><geom type="plane" size="0 0 1"/><geom size=".1" pos="9 9 0"/>
    <body name="all"><freejoint/><geom type="box" size=".2 .1 .1"/>
      <geom size="7" rgba="1 1 1 0"/><geom size="7" group="3"/>
      <body name="arm" pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".05"/></body>
    </body></worldbody></mujoco>"""


def compiled(view: str = "") -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(MODEL.format(view=view))
    model.stat.extent, model.stat.center = 1, 0
    return model


def states_of(model: mujoco.MjModel, way: tuple[float, float, float], count: int = 5) -> list[np.ndarray]:
    """Returns states on a straight way of the body while the arm turns."""
    data = mujoco.MjData(model)
    states = list[np.ndarray]()
    for share in np.linspace(0, 1, count):
        data.qpos[:3], data.qpos[7] = share * np.array(way), 3 * share
        states.append(save(model, data))
    return states


def framed(
    model: mujoco.MjModel,
    states: list[np.ndarray],
    fovy: EasedNumber | None = None,
    rig: AutoRig | None = None,
    *,
    is_framed: bool = False,
    roll: EasedNumber = LEVEL,
) -> tuple[list[CameraPose], list[str]]:
    """Returns the pose for each state, and the remarks."""
    shot = Shot(rig or AutoRig(), fovy=fovy, roll=roll)
    motion = BoundCameraScript(CameraScript("auto", (shot,)), model, SIZE, is_framed=is_framed)
    times = np.arange(len(states), dtype=float).tolist()
    spans = [(0.0, times[-1])]
    remarks = motion.aim_at_motion(states, times, spans)
    return list(motion.poses(states, times, times, spans)), remarks


def pixels(model: mujoco.MjModel, state: np.ndarray, pose: CameraPose) -> np.ndarray:
    """Projects the corners of the moving geoms that are visible `(n, 2)`."""
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_kinematics(model, data)
    bounds = object_bounds("all", model)
    shown = model.geom_size[bounds.ids, 0] < 7
    bounds = replace(bounds, ids=bounds.ids[shown], corners=bounds.corners[shown])
    camera = lens(pose, SIZE)
    local = (np.linalg.inv(camera.pose) @ np.column_stack([points := bounds.points(data), np.ones(len(points))]).T)[:3]
    scale = local[2] if camera.perspective else np.ones_like(local[2])
    assert ((local[2] > camera.near) & (local[2] < camera.far)).all()
    return np.column_stack([camera.fx * local[0] / scale + camera.cx, camera.fy * local[1] / scale + camera.cy])


@pytest.mark.parametrize("way", [(1.5, 1, 1), (0, -1.5, 0), (0.5, 0.5, -1.5), (-1.5, -1, 0.3)])
@pytest.mark.parametrize(
    ("view", "fovy"),
    [("", None), ("", EasedNumber(60, 35)), ('orthographic="true" fovy="1.2"', None)],
    ids=["perspective", "changing", "orthographic"],
)
def test_every_corner_stays_in_view_of_a_still_camera(
    way: tuple[float, float, float], view: str, fovy: EasedNumber | None
) -> None:
    model = compiled(view)
    states = states_of(model, way)
    poses, remarks = framed(model, states, fovy)
    found = np.concatenate([pixels(model, state, pose) for state, pose in zip(states, poses, strict=True)])
    assert (found >= 0).all()
    assert (found <= SIZE).all()
    assert len({pose.position.tobytes() for pose in poses}) == 1
    assert len(remarks) == 1
    assert "whole motion" in remarks[0]


@pytest.mark.parametrize(
    "roll", [EasedNumber.still(90), EasedNumber.still(-37), EasedNumber(20, 160), EasedNumber(0, -900)]
)
@pytest.mark.parametrize("view", ["", 'orthographic="true" fovy="1.2"'])
@pytest.mark.parametrize("is_framed", [False, True])
def test_every_corner_stays_in_view_of_a_camera_that_rolls(roll: EasedNumber, view: str, is_framed: bool) -> None:
    model = compiled(view)
    model.geom_pos[1] = 0, 0, 0  # within the box
    for way in ((0.6, -0.5, 0), (0.1, 0.2, 0.6)):
        states = states_of(model, way, count=97)
        poses, _ = framed(model, states, is_framed=is_framed, roll=roll)
        assert poses[-1].angles[2] == pytest.approx((roll.end + 180) % 360 - 180, abs=1e-6)
        for state, pose in zip(states, poses, strict=True):
            found = pixels(model, state, pose)
            assert ((found >= 0) & (found <= SIZE)).all()


@pytest.mark.parametrize("way", [(0, 1.6, 0), (1.4, 1.4, -0.2), (2, 3, -1)])
@pytest.mark.parametrize("view", ["", 'orthographic="true" fovy="1.2"'])
def test_the_far_plane_is_beyond_the_motion(way: tuple[float, float, float], view: str) -> None:
    model = compiled(view)
    model.vis.map.zfar = 1.8
    states = states_of(model, way)
    for state, pose in zip(states, framed(model, states)[0], strict=True):
        found = pixels(model, state, pose)
        assert ((found >= 0) & (found <= SIZE)).all()


def test_a_motion_that_mujoco_shows_whole_is_seen_by_its_camera() -> None:
    model = compiled()
    cameras = MujocoCameras(model)
    expected = cameras.pose(cameras.data, cameras.free)
    poses, remarks = framed(model, states_of(model, (0.1, 0, 0)))
    assert not remarks
    for pose in poses:
        np.testing.assert_allclose(pose.position, expected.position, atol=1e-6)
        np.testing.assert_allclose(pose.rotation, expected.rotation, atol=1e-6)


def test_the_camera_follows_the_centre_of_mass_of_what_moves_far_away() -> None:
    model = compiled()
    states = states_of(model, (30, -4, -12))
    poses, remarks = framed(model, states)
    data = mujoco.MjData(model)
    centers = list[np.ndarray]()
    for state, pose in zip(states, poses, strict=True):
        found = pixels(model, state, pose)
        assert (found >= 0).all()
        assert (found <= SIZE).all()
        mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        centers.append(data.subtree_com[1].copy())
    ways = [pose.position - poses[0].position for pose in poses]
    np.testing.assert_allclose(ways, np.array(centers) - centers[0], atol=1e-12)
    assert "follows" in remarks[0]


def test_the_camera_stays_within_reach_of_things_that_fly_apart() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody>"
        + "".join('<body><joint type="slide" axis="1 0 0"/><geom size=".1"/></body>' for _ in range(2))
        + "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    states = list[np.ndarray]()
    for way in (0.0, 50.0):
        data.qpos[:] = way, -way
        states.append(save(model, data))
    poses, _ = framed(model, states)
    cameras = MujocoCameras(model)
    assert poses[1].distance == pytest.approx(FARTHEST * cameras.free.distance)


@pytest.mark.parametrize("way", [(0, 0, 0), (1.5, 1, 1), (30, -4, -12)])
def test_the_camera_of_a_bare_model_is_as_close_as_a_margin_allows(way: tuple[float, float, float]) -> None:
    model = compiled()
    model.geom_pos[1] = 0, 0, 0  # a part that does not move, within the box
    states = states_of(model, way)
    poses, remarks = framed(model, states, is_framed=True)
    found = np.concatenate([pixels(model, state, pose) for state, pose in zip(states, poses, strict=True)])
    places = found / SIZE
    assert ((places >= 0) & (places <= 1)).all()
    filled = (places.max(axis=0) - places.min(axis=0)).max()
    assert filled > 0.7
    assert len(remarks) == (way[0] > 9)


def test_the_camera_of_a_bare_model_also_shows_what_does_not_move() -> None:
    still = '<geom name="post" type="capsule" fromto="0 0 0 0 0 1" size=".05"/><body><joint/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{still}</worldbody></mujoco>")
    (pose,), _ = framed(model, [save(model, mujoco.MjData(model))], is_framed=True)
    camera = lens(pose, SIZE)
    _, y, z = (np.linalg.inv(camera.pose) @ [[0, 0], [0, 0], [-0.05, 1.05], [1, 1]])[:3]
    top, bottom = sorted(camera.fy * y / z + camera.cy)
    assert 0 <= top < 0.2 * SIZE[1]
    assert 0.8 * SIZE[1] < bottom <= SIZE[1]
    assert pose.angles == pytest.approx((140, -20, 0))


def test_directions_can_be_chosen() -> None:
    model = compiled()
    states = states_of(model, (1.2, 0, 0))
    poses, _ = framed(model, states, rig=AutoRig(azimuth=90, elevation=-10))
    assert poses[0].angles == pytest.approx((90, -10, 0))
    for state, pose in zip(states, poses, strict=True):
        found = pixels(model, state, pose)
        assert ((found >= 0) & (found <= SIZE)).all()


def test_vertices_of_flexes_are_in_view() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".2 .2 .2" mass="1" radius=".01"/>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    states = [save(model, data)]
    data.qpos[0::3] += 1.5
    states.append(save(model, data))
    poses, remarks = framed(model, states)
    assert remarks
    for state, pose in zip(states, poses, strict=True):
        mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(model, data)
        local = (data.flexvert_xpos - pose.position) @ pose.rotation
        half = -local[:, 2] * np.tan(np.radians(model.vis.global_.fovy) / 2)
        assert (abs(local[:, 1]) <= half).all()
        assert (abs(local[:, 0]) <= half * SIZE[0] / SIZE[1]).all()


def test_a_model_in_which_nothing_moves_is_seen_by_mujocos_camera() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size=".1"/></worldbody></mujoco>')
    poses, remarks = framed(model, [save(model, mujoco.MjData(model))])
    cameras = MujocoCameras(model)
    np.testing.assert_allclose(poses[0].position, cameras.pose(cameras.data, cameras.free).position, atol=1e-6)
    assert not remarks
