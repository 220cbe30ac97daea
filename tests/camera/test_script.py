"""Camera scripts as values: what is not given changes nothing, and other processes get the same."""

import pickle
from dataclasses import replace
from fractions import Fraction

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.pose import CameraPose, pose_of
from mjrun.camera.rigs.free_camera import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.rig import EasedNumber, Shake, ShotBlend
from mjrun.camera.script import LEVEL, CameraScript, ConditionEvent, FramedObject, Shot, parse_camera, shot_conflicts
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import MjrunError, UsageError
from mjrun.model.state import save
from tests.cases import cases, mjcf

SIDE_CAMERA = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><camera name="side" pos="0 -2 1" xyaxes="1 0 0 0 .5 1" fovy="40"/>
    <body name="box"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
)
SIZE = (64, 48)


def test_a_shot_is_that_of_its_rig_alone() -> None:
    data = mujoco.MjData(SIDE_CAMERA)
    mujoco.mj_forward(SIDE_CAMERA, data)
    pose = BoundCameraScript(CameraScript("a", [Shot(ModelRig("side"))]), SIDE_CAMERA, SIZE).pose(
        save(SIDE_CAMERA, data)
    )
    assert pose.position == pytest.approx(data.cam_xpos[0])
    assert pose.rotation == pytest.approx(data.cam_xmat[0].reshape(3, 3))
    assert pose.frustum.fovy == pytest.approx(SIDE_CAMERA.cam_fovy[0])


def test_a_camera_that_is_called_like_a_rig_is_listed_once() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><camera name="track"/></worldbody></mujoco>')
    with pytest.raises(UsageError, match=r"cameras: track, auto, free, orbit, look$"):
        parse_camera("top", model)


@pytest.mark.parametrize("phase", [0.0, 0.3, 1.0])
def test_a_shot_is_level_at_every_time(phase: float) -> None:
    assert LEVEL.at(phase) == 0


def test_an_event_is_the_first_of_its_kind_as_it_happens_and_must_happen() -> None:
    assert ConditionEvent("speed(box) > 0.02") == ConditionEvent(
        "speed(box) > 0.02", nth=1, offset=Fraction(0), otherwise=None
    )


def test_a_script_is_the_same_in_another_process() -> None:
    free = FreeRig((0, 0, 0), EasedNumber.still(2.0), EasedNumber(0.0, 90.0, "cosine"), EasedNumber.still(-20.0))
    script = CameraScript(
        "around",
        [
            Shot(
                ModelRig("side"), until=ConditionEvent("speed(box) > 1", 2, Fraction(1, 3), "end"), speed=Fraction(1, 2)
            ),
            Shot(
                free,
                lasting=Fraction(2),
                blend=ShotBlend("sigmoid", 0.5),
                fovy=EasedNumber.still(30.0),
                shake=Shake(0.5),
            ),
            Shot(free, roll=EasedNumber(0.0, 10.0, "linear"), fit=FramedObject("box")),
        ],
    )
    again = pickle.loads(pickle.dumps(script))
    assert again == script
    states = [save(SIDE_CAMERA, mujoco.MjData(SIDE_CAMERA))] * 3
    times, spans = [0.0, 1.0, 2.5], [(0.0, 0.5), (0.5, 2.0), (2.0, 3.0)]
    here, there = (
        list(BoundCameraScript(each, SIDE_CAMERA, SIZE).poses(states, times, times, spans)) for each in (script, again)
    )
    for mine, theirs in zip(here, there, strict=True):
        assert np.array_equal(mine.position, theirs.position)
        assert np.array_equal(mine.rotation, theirs.rotation)
        assert mine.frustum == theirs.frustum


SHOT = Shot(ModelRig("side"))
BLENDED = Shot(ModelRig("side"), blend=ShotBlend())


@pytest.mark.parametrize(
    ("shots", "message", "path"),
    [
        ([], "camera a: shots: expected at least one shot", ("shots",)),
        ([BLENDED], "camera a: shot 1: blend: the first shot has no previous shot", ("shots", 0, "blend")),
        ([SHOT, SHOT], "camera a: shot 1: the end of this shot is missing", ("shots", 0)),
        (
            [Shot(ModelRig("side"), until=Fraction(1), lasting=Fraction(2))],
            "camera a: shot 1: duration: a shot ends by until or after a duration, not both",
            ("shots", 0, "duration"),
        ),
        (
            [replace(SHOT, lasting=Fraction(2)), replace(SHOT, until=Fraction(2)), SHOT],
            "camera a: shot 2: until: expected a time later than 2, when the shot begins",
            ("shots", 1, "until"),
        ),
    ],
)
def test_shots_that_do_not_go_together_are_refused_as_in_a_document(
    shots: list[Shot], message: str, path: tuple[str | int, ...]
) -> None:
    with pytest.raises(UsageError) as caught:
        CameraScript("a", shots).check()
    assert str(caught.value).startswith(message)
    assert caught.value.path == path


def test_shots_that_go_together_are_accepted() -> None:
    event = replace(SHOT, until=ConditionEvent("speed(box) > 1"))
    CameraScript("a", [event, replace(BLENDED, lasting=Fraction(1)), replace(SHOT, until=Fraction(3)), SHOT]).check()


@pytest.mark.parametrize("value", [True, "2", None, [1], float("nan"), float("inf"), ConditionEvent("a > 1")])
def test_what_is_no_time_is_not_compared(value: object) -> None:
    assert list(shot_conflicts([{"until": 1}, {"until": value}, {"until": 2}, {}])) == []
    assert [path for path, _ in shot_conflicts([{"until": 1}, {"until": value}, {"until": 1}, {}])] == [
        ("shots", 2, "until")
    ]


MODEL = mujoco.MjModel.from_xml_string(mjcf("camera_script"))
phases = st.floats(0, 1)


def moved() -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qpos[:3] = [4, 5, 6]
    mujoco.mj_forward(MODEL, data)
    return data


def posed(text: str, phase: float = 0.0, model: mujoco.MjModel = MODEL) -> CameraPose:
    """The pose `phase` of the way through a shot of two seconds."""
    data = moved() if model is MODEL else mujoco.MjData(model)
    course = BoundCameraScript(parse_camera(text, model), model, (64, 48))
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


def updated(camera: mujoco.MjvCamera, model: mujoco.MjModel = MODEL) -> CameraPose:
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
        BoundCameraScript(parse_camera(text, MODEL), MODEL, (64, 48))
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
