"""Cameras in one word of a command line."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.argument import parse_camera
from mjrun.camera.easing_and_shake import EasedNumber
from mjrun.camera.pose import Pose, pose_of
from mjrun.camera.rigs.around import OrbitRig, TrackRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import Shot
from mjrun.camera.script_poses import CameraMotion
from mjrun.errors import MjrunError
from mjrun.model.state import save
from tests.cases import cases

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


def posed(text: str, phase: float = 0.0, model: mujoco.MjModel = MODEL) -> Pose:
    """The pose `phase` of the way through a shot of two seconds."""
    data = moved() if model is MODEL else mujoco.MjData(model)
    course = CameraMotion(parse_camera(text, model), model, (64, 48))
    return next(course.poses([save(model, data)], [2 * phase], [0.0], [(0.0, 2.0)]))


def shot(text: str) -> Shot:
    return parse_camera(text, MODEL).shots[0]


def track(text: str) -> TrackRig:
    rig = shot(text).rig
    assert isinstance(rig, TrackRig)
    return rig


def default() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(MODEL, camera)
    return camera


def updated(camera: mujoco.MjvCamera, model: mujoco.MjModel = MODEL) -> Pose:
    scene = mujoco.MjvScene(model, 1)
    mujoco.mjv_updateCamera(model, moved() if model is MODEL else mujoco.MjData(model), camera, scene)
    return pose_of(scene)


@pytest.mark.parametrize(("text", "height"), [("top", 3), ("1", 4), ("camera:1", 4), ("0", 3)])
def test_a_model_camera_answers_to_name_and_index(text: str, height: float) -> None:
    assert shot(text) == Shot(ModelRig(text))
    assert posed(text).position == pytest.approx(np.array([0, 0, height]))


def test_a_model_camera_wins_over_a_rig_of_the_same_name() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><camera name="orbit"/></worldbody></mujoco>')
    assert parse_camera("orbit", model).shots[0].rig == ModelRig("orbit")
    assert isinstance(parse_camera("orbit:distance=1", model).shots[0].rig, OrbitRig)


@given(phases)
def test_the_free_camera_is_mujoco_s_own_and_stands_still(phase: float) -> None:
    found, expected = posed("free", phase), updated(default())
    assert found.position == pytest.approx(expected.position, abs=1e-6)
    assert found.rotation == pytest.approx(expected.rotation, abs=1e-6)
    assert found.frustum == expected.frustum


@given(phases)
def test_an_orbit_goes_from_start_to_end_by_its_ease(phase: float) -> None:
    linear = posed("orbit:lookat=1/2/-3,distance=2,azimuth=140..240,elevation=-30..10", phase)
    assert linear.lookat == pytest.approx(np.array([1, 2, -3]))
    assert linear.distance == 2
    azimuth, elevation, _ = linear.angles
    assert azimuth % 360 == pytest.approx(140 + 100 * phase)
    assert elevation == pytest.approx(-30 + 40 * phase)
    cosine = posed("orbit:azimuth=140..240,ease=cosine", phase)
    assert cosine.angles[0] % 360 == pytest.approx(140 + 100 * (1 - np.cos(np.pi * phase)) / 2)


@given(phases)
def test_an_orbit_without_angles_goes_once_round(phase: float) -> None:
    camera, angle = default(), default().azimuth
    camera.azimuth = angle + 360 * phase
    assert posed("orbit", phase).rotation == pytest.approx(updated(camera).rotation, abs=1e-5)
    camera.azimuth = angle + 180 * (1 - np.cos(np.pi * phase))
    assert posed("orbit:ease=cosine", phase).rotation == pytest.approx(updated(camera).rotation, abs=1e-5)


@cases("text, expected")
def test_an_object_is_followed_where_it_is_now(text: str, expected: list[float]) -> None:
    assert posed(text).lookat == pytest.approx(np.array(expected))


def test_settings_that_are_not_given_stay_the_free_camera_s() -> None:
    pose, expected = posed("track:box,distance=.08"), default()
    assert pose.distance == 0.08
    assert pose.angles == pytest.approx((expected.azimuth, expected.elevation, 0))


def test_a_heading_turns_with_the_object() -> None:
    assert track("track:box,heading").heading
    assert track("track:box,heading,distance=2").distance == EasedNumber(2, 2)
    assert not track("track:box").heading


def test_an_offset_and_a_look_are_written_as_points() -> None:
    assert posed("track:box,offset=1/0/-1").lookat == pytest.approx(np.array([5, 5, 5]))
    pose = posed("look:from=0/0/9,at=tip")
    assert pose.position == pytest.approx(np.array([0, 0, 9]))
    assert pose.lookat == pytest.approx(np.array([4, 5, 6.5]))


@given(phases)
def test_roll_and_field_of_view_are_ramps_like_the_others(phase: float) -> None:
    pose = posed("orbit:azimuth=30,roll=-20..40,fovy=20..60,ease=in", phase)
    assert pose.angles[2] == pytest.approx(-20 + 60 * phase**2)
    assert pose.frustum.fovy == pytest.approx(20 + 40 * phase**2)


@pytest.mark.parametrize(
    ("text", "name"), [("top", "top"), ("orbit:lookat=box,distance=2,roll=3", "orbit:lookat=box"), ("free", "free")]
)
def test_a_script_is_called_as_its_text_begins(text: str, name: str) -> None:
    assert parse_camera(text, MODEL).name == name


@cases("text, message")
def test_a_wrong_camera_is_refused_with_what_is_right(text: str, message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        CameraMotion(parse_camera(text, MODEL), MODEL, (64, 48))
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_the_free_camera_has_no_perspective_where_the_model_says_so() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><visual><global orthographic="true"/></visual><worldbody><geom size=".1"/></worldbody></mujoco>'
    )
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    assert posed("free", model=model).frustum == updated(camera, model).frustum
    assert posed("free", model=model).frustum.orthographic
    assert posed("orbit:fovy=300", model=model).frustum.fovy == pytest.approx(300)  # metres
