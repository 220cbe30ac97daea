"""Theorems about described keyframes: what they say lies out of range, MuJoCo limits."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.model.info import ModelDescription


def test_keyframes_name_what_is_outside_its_range(mixed: ModelDescription) -> None:
    fine, far = mixed.keyframes
    assert (fine.name, fine.time, fine.finite, fine.outside) == ("fine", 0, True, ())
    assert (far.name, far.time, far.finite) == ("far", 2, True)
    assert far.outside == ("qpos/ball", "qpos/hinge", "ctrl/m", "act/actuator:3")


BALL = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/><worldbody><body><joint type="ball"
    range="0 1" limited="true"/><geom size="1"/></body></worldbody><keyframe><key/></keyframe></mujoco>""")


@given(angle=st.floats(-6, 6), axis=st.sampled_from([(1, 0, 0), (0, 0.6, 0.8)]))
def test_a_ball_is_outside_where_mujoco_limits_it(angle: float, axis: tuple[float, ...]) -> None:
    mujoco.mju_axisAngle2Quat(BALL.key_qpos[0], np.array(axis, float), angle)
    data = mujoco.MjData(BALL)
    mujoco.mj_resetDataKeyframe(BALL, data, 0)
    mujoco.mj_forward(BALL, data)
    distance = 1 - abs(math.remainder(angle, 2 * math.pi))
    if abs(distance) > 1e-6:
        assert bool(ModelDescription(BALL).keyframes[0].outside) == bool(data.nefc) == (distance < 0)


@pytest.mark.parametrize("field", ["key_qpos", "key_qvel", "key_ctrl", "key_act", "key_mpos"])
def test_a_number_that_is_not_finite_is_found_in_any_part_of_a_keyframe(field: str, mixed_xml: str) -> None:
    model = mujoco.MjModel.from_xml_string(mixed_xml.replace('ctrl="5"', ""))
    getattr(model, field)[1, 0] = math.nan
    assert [key.finite for key in ModelDescription(model).keyframes] == [True, False]
