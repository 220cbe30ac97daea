"""Camera scripts as values: what is not given changes nothing, and other processes get the same."""

import pickle
from dataclasses import replace
from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.camera.easing_and_shake import Blend, EasedNumber, Shake
from mjrun.camera.rigs.around import FreeRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import LEVEL, CameraScript, Event, FramedObject, Shot, shot_conflicts
from mjrun.camera.script_poses import CameraMotion
from mjrun.errors import UsageError
from mjrun.model.state import save

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><camera name="side" pos="0 -2 1" xyaxes="1 0 0 0 .5 1" fovy="40"/>
    <body name="box"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
)
SIZE = (64, 48)


def test_a_shot_is_that_of_its_rig_alone() -> None:
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    pose = CameraMotion(CameraScript("a", [Shot(ModelRig("side"))]), MODEL, SIZE).pose(save(MODEL, data))
    assert pose.position == pytest.approx(data.cam_xpos[0])
    assert pose.rotation == pytest.approx(data.cam_xmat[0].reshape(3, 3))
    assert pose.frustum.fovy == pytest.approx(MODEL.cam_fovy[0])


@pytest.mark.parametrize("phase", [0.0, 0.3, 1.0])
def test_a_shot_is_level_at_every_time(phase: float) -> None:
    assert LEVEL.at(phase) == 0


def test_an_event_is_the_first_of_its_kind_as_it_happens_and_must_happen() -> None:
    assert Event("speed(box) > 0.02") == Event("speed(box) > 0.02", nth=1, offset=Fraction(0), otherwise=None)


def test_a_script_is_the_same_in_another_process() -> None:
    free = FreeRig((0, 0, 0), EasedNumber.still(2.0), EasedNumber(0.0, 90.0, "cosine"), EasedNumber.still(-20.0))
    script = CameraScript(
        "around",
        [
            Shot(ModelRig("side"), until=Event("speed(box) > 1", 2, Fraction(1, 3), "end"), speed=Fraction(1, 2)),
            Shot(
                free, lasting=Fraction(2), blend=Blend("sigmoid", 0.5), fovy=EasedNumber.still(30.0), shake=Shake(0.5)
            ),
            Shot(free, roll=EasedNumber(0.0, 10.0, "linear"), fit=FramedObject("box")),
        ],
    )
    again = pickle.loads(pickle.dumps(script))
    assert again == script
    states = [save(MODEL, mujoco.MjData(MODEL))] * 3
    times, spans = [0.0, 1.0, 2.5], [(0.0, 0.5), (0.5, 2.0), (2.0, 3.0)]
    here, there = (list(CameraMotion(each, MODEL, SIZE).poses(states, times, times, spans)) for each in (script, again))
    for mine, theirs in zip(here, there, strict=True):
        assert np.array_equal(mine.position, theirs.position)
        assert np.array_equal(mine.rotation, theirs.rotation)
        assert mine.frustum == theirs.frustum


SHOT = Shot(ModelRig("side"))
BLENDED = Shot(ModelRig("side"), blend=Blend())


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
    event = replace(SHOT, until=Event("speed(box) > 1"))
    CameraScript("a", [event, replace(BLENDED, lasting=Fraction(1)), replace(SHOT, until=Fraction(3)), SHOT]).check()


@pytest.mark.parametrize("value", [True, "2", None, [1], float("nan"), float("inf"), Event("a > 1")])
def test_what_is_no_time_is_not_compared(value: object) -> None:
    assert list(shot_conflicts([{"until": 1}, {"until": value}, {"until": 2}, {}])) == []
    assert [path for path, _ in shot_conflicts([{"until": 1}, {"until": value}, {"until": 1}, {}])] == [
        ("shots", 2, "until")
    ]
