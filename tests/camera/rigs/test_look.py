"""From one place at another."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.rig import ShotTime
from mjrun.errors import MjrunError
from tests.camera.rigs.posed_model import posed

points = st.tuples(*[st.floats(-3, 3)] * 3)


def at(phase: float, duration: float = 1.0) -> ShotTime:
    return ShotTime(7 + phase * duration, phase * duration, phase)


@given(points, points)
def test_a_look_is_upright_and_meets_its_target(
    eye: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    if np.linalg.norm(np.subtract(eye, target)) < 1e-3:
        return
    pose = posed(LookRig(eye, target))
    assert pose.lookat == pytest.approx(np.array(target), abs=1e-5)
    assert pose.rotation[2, 0] == pytest.approx(0, abs=1e-12)  # what is right in the picture is level
    assert pose.up[2] >= -1e-12


@pytest.mark.parametrize("height", [-2.0, 2.0])
def test_a_look_straight_up_or_down_is_defined(height: float) -> None:
    pose = posed(LookRig((1.0, 1.0, 0.0), (1.0, 1.0, height)))
    assert pose.forward == pytest.approx(np.array([0, 0, math.copysign(1, height)]))
    assert pose.rotation[:, 0] == pytest.approx(np.array([1, 0, 0]))


def test_a_look_at_where_the_camera_is_names_the_time() -> None:
    with pytest.raises(MjrunError, match=r"camera a: at 7\.5 s the camera coincides with the point that it looks at"):
        posed(LookRig((4.0, 5.0, 6.0), "box"), at(0.5))
