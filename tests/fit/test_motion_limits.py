"""Limits of joints and actuators."""

import mujoco
import numpy as np
import pytest

from mjrun.fit.motion_limits import MotionLimits

MODEL = """<mujoco><worldbody>
<body name="floating"><freejoint name="root"/><geom size=".1"/>
  <body><joint name="hinge" range="-90 90"/><geom size=".1"/>
    <body><joint name="slide" type="slide" actuatorfrcrange="-7 7"/><geom size=".1"/></body></body></body>
</worldbody>
<actuator><motor name="strong" joint="slide"/><motor name="weak" joint="hinge" forcerange="-2 2"/></actuator>
</mujoco>"""


@pytest.fixture
def limits() -> MotionLimits:
    return MotionLimits(mujoco.MjModel.from_xml_string(MODEL), 3.0)


def test_what_is_limited_is_what_the_model_says(limits: MotionLimits) -> None:
    half = np.pi / 2
    expected = {
        "qpos/hinge": (-half, half),
        "qpos/slide": (-np.inf, np.inf),
        "qvel/hinge": (-3, 3),
        "qvel/slide": (-3, 3),
        "actuator_force/weak": (-2, 2),
        "qfrc_actuator/slide": (-7, 7),
    }
    assert [column.name for column in limits.columns] == list(expected)
    np.testing.assert_allclose(np.column_stack([limits.low, limits.high]), list(expected.values()))
    assert [column.name for column in limits.columns[limits.positions]] == ["qpos/hinge", "qpos/slide"]


def test_what_is_beyond_is_named(limits: MotionLimits) -> None:
    rows = np.zeros((5, 6))
    assert limits.violation(rows) is None
    rows[:, 1] = 1e6  # nothing limits the slide's position
    assert limits.violation(rows) is None
    rows[3, 2] = -3.5
    assert limits.violation(rows) == "qvel/hinge comes to -3.5, where -3 … 3 rad/s is its range"
    rows[3, 2], rows[2, 4] = 0, 2.0  # a force that is clipped
    assert str(limits.violation(rows)).startswith("actuator_force/weak comes to 2, where")
    rows[4, 0] = np.nan
    assert limits.violation(rows) == "the simulation becomes unstable"


def test_without_a_speed_limit_any_speed_will_do() -> None:
    limits = MotionLimits(mujoco.MjModel.from_xml_string(MODEL), None)
    rows = np.zeros((5, 6))
    rows[:, 2:4] = 1e3
    assert limits.violation(rows) is None
