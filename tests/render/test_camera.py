"""Cameras by name, and rigs that move."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import MjrunError
from mjrun.render.camera import ModelCamera, rig

MODEL = mujoco.MjModel.from_xml_string(
    """
    <mujoco>
      <worldbody>
        <camera name="top" pos="0 0 3"/>
        <camera pos="0 0 4"/>
        <body name="box" pos="1 2 3">
          <freejoint/><geom name="edge" pos=".1 0 0" size=".1"/><site name="tip" pos="0 0 .5"/>
        </body>
      </worldbody>
    </mujoco>
    """
)
phases = st.floats(0, 1)


def moved() -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qpos[:3] = [4, 5, 6]
    mujoco.mj_forward(MODEL, data)
    return data


def aimed(text: str, phase: float = 0.0) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    rig(text, MODEL).aim(camera, moved(), phase)
    return camera


def default() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    return camera


@pytest.mark.parametrize(("text", "expected"), [("top", 0), ("1", 1), ("camera:1", 1), ("0", 0)])
def test_a_model_camera_answers_to_name_and_index(text: str, expected: int) -> None:
    assert rig(text, MODEL) == ModelCamera(expected)
    camera = aimed(text)
    assert (camera.type, camera.fixedcamid) == (mujoco.mjtCamera.mjCAMERA_FIXED, expected)


@given(phases)
def test_the_free_camera_is_mujoco_s_own_and_stands_still(phase: float) -> None:
    camera, expected = aimed("free", phase), default()
    assert camera.type == mujoco.mjtCamera.mjCAMERA_FREE
    assert (camera.distance, camera.azimuth, camera.elevation) == pytest.approx(
        (expected.distance, expected.azimuth, expected.elevation)
    )
    assert camera.lookat == pytest.approx(expected.lookat)


@given(phases)
def test_an_orbit_goes_from_start_to_end_by_its_ease(phase: float) -> None:
    linear = aimed("orbit:lookat=1/2/-3,distance=2,azimuth=140..240,elevation=-30..10", phase)
    assert list(linear.lookat) == [1, 2, -3]
    assert linear.distance == 2
    assert linear.azimuth == pytest.approx(140 + 100 * phase)
    assert linear.elevation == pytest.approx(-30 + 40 * phase)
    cosine = aimed("orbit:azimuth=140..240,ease=cosine", phase)
    assert cosine.azimuth == pytest.approx(140 + 100 * (1 - np.cos(np.pi * phase)) / 2)


def test_an_orbit_without_angles_goes_once_round() -> None:
    assert aimed("orbit", 1).azimuth - aimed("orbit", 0).azimuth == pytest.approx(360)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("track:box,distance=.08,azimuth=280", [4, 5, 6]),
        ("track:edge", [4.1, 5, 6]),
        ("track:site:tip", [4, 5, 6.5]),
        ("orbit:lookat=geom:edge", [4.1, 5, 6]),
        ("free:lookat=tip", [4, 5, 6.5]),
    ],
)
def test_an_object_is_followed_where_it_is_now(text: str, expected: list[float]) -> None:
    assert aimed(text).lookat == pytest.approx(np.array(expected))


def test_settings_that_are_not_given_stay_the_free_camera_s() -> None:
    camera, expected = aimed("track:box,distance=.08"), default()
    assert camera.distance == 0.08
    assert (camera.azimuth, camera.elevation) == pytest.approx((expected.azimuth, expected.elevation))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tpo", "no camera 'tpo' (did you mean 'top'?)\ncameras: top, camera:1, free, orbit:…, track:BODY"),
        ("2", "no camera '2'"),
        ("-1", "no camera '-1'"),
        ("", "no camera ''"),
        ("orbit:azimut=3", "no setting 'azimut' in --camera orbit (did you mean 'azimuth'?)"),
        ("orbit:azimuth", "--camera orbit: write azimuth=VALUE, once"),
        ("orbit:azimuth=1,azimuth=2", "--camera orbit: write azimuth=VALUE, once"),
        ("orbit:azimuth=1..x", "--camera orbit: azimuth: '1..x' is not a number, or two as in 140..240"),
        ("orbit:azimuth=nan", "is not a number"),
        ("orbit:distance=0", "is not a positive number of metres"),
        ("orbit:distance=1..-1", "is not a positive number of metres"),
        ("orbit:lookat=bxo", "no object 'bxo' (did you mean 'box'?)\nbodies, geoms and sites: world, box, edge, tip"),
        ("orbit:lookat=1/2/inf", "is not a point x/y/z [m]"),
        ("orbit:box", "no setting 'box' in --camera orbit\nsettings: lookat, distance, azimuth, elevation, ease"),
        ("orbit:ease=cubic", "eases: linear, cosine"),
        ("track", "which object? write track:BODY"),
        ("track:", "which object? write track:BODY"),
        ("track:distance=3", "which object? write track:BODY"),
        ("track:box,lookat=tip", "no setting 'lookat' in --camera track"),
        ("track:geom:box", "no geom 'box'"),
    ],
)
def test_a_wrong_camera_is_refused_with_what_is_right(text: str, message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        rig(text, MODEL)
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_the_free_camera_has_no_perspective_where_the_model_says_so() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><visual><global orthographic="true"/></visual><worldbody><geom size=".1"/></worldbody></mujoco>'
    )
    data, camera, expected = mujoco.MjData(model), mujoco.MjvCamera(), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, expected)
    rig("free", model).aim(camera, data, 0)
    assert camera.orthographic == expected.orthographic == 1
