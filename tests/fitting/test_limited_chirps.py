"""Chirps: their ranges and frequencies, and the limits of motions."""

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.fitting.excitation import FREQUENCIES, MotionLimits, chirps, control_room

TIMES = np.arange(0, 20, 0.002)
MODEL = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" range="-60 90"/><geom size=".1"/></body></worldbody>
<actuator><motor name="a" joint="j" ctrlrange="-2 3"/><position name="b" joint="j" kp="5" gear="2"/>{more}</actuator>
</mujoco>"""


def test_they_stay_within_their_reach_and_come_and_go() -> None:
    middle, reach = np.array([1.0, -2.0]), np.array([0.5, 3.0])
    for seed in range(20):
        controls = chirps(TIMES, middle, reach, np.random.default_rng(seed))
        assert (np.abs(controls - middle) <= reach).all()
        np.testing.assert_allclose(controls[[0, -1]], [middle, middle], atol=1e-12)
        assert np.ptp(controls[:, 1]) > 0.3 * 3.0


def test_frequencies_sweep_within_what_they_may() -> None:
    """Zero crossings of a sine of growing or falling frequency: half a period apart."""
    for seed in range(20):
        wave = chirps(TIMES, np.zeros(1), np.ones(1), np.random.default_rng(seed))[1:-1, 0]
        crossings = TIMES[2:-1][np.diff(np.sign(wave)) != 0]
        rates = 0.5 / np.diff(crossings)
        assert rates.max(initial=1.0) < 1.05 * FREQUENCIES[1]
        if len(rates) > 20:  # frequencies go one way
            thirds = [part.mean() for part in np.array_split(rates, 3)]
            assert thirds in (sorted(thirds), sorted(thirds, reverse=True))


def test_the_same_seed_gives_the_same_chirps() -> None:
    one, other = (chirps(TIMES, np.zeros(3), np.ones(3), np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_the_room_is_that_of_the_control_or_of_the_joint_of_a_servo() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(more=""))
    middle, reach = control_room(model, np.array([1.0, 10.0]))
    np.testing.assert_allclose(middle, [1.0, np.pi / 6])  # 10 is beyond the joint: the middle of its range
    np.testing.assert_allclose(reach, [2.0, 5 * np.pi / 6])


def test_a_control_that_nothing_limits_is_refused() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(more='<motor name="free" joint="j"/>'))
    with pytest.raises(UsageError, match=r"ctrl/free has no limits.*\n.*actuator/free\.ctrlrange"):
        control_room(model, np.zeros(3))


LIMITED = """<mujoco><worldbody>
<body name="floating"><freejoint name="root"/><geom size=".1"/>
  <body><joint name="hinge" range="-90 90"/><geom size=".1"/>
    <body><joint name="slide" type="slide" actuatorfrcrange="-7 7"/><geom size=".1"/></body></body></body>
</worldbody>
<actuator><motor name="strong" joint="slide"/><motor name="weak" joint="hinge" forcerange="-2 2"/></actuator>
</mujoco>"""


@pytest.fixture
def limits() -> MotionLimits:
    return MotionLimits(mujoco.MjModel.from_xml_string(LIMITED), 3.0)


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
    assert limits.violation(rows) == "qvel/hinge reaches -3.5, beyond its range -3 … 3 rad/s"
    rows[3, 2], rows[2, 4] = 0, 2.0  # a force that is clipped
    assert str(limits.violation(rows)).startswith("actuator_force/weak reaches 2, beyond")
    rows[4, 0] = np.nan
    assert limits.violation(rows) == "the simulation becomes unstable"


def test_without_a_speed_limit_any_speed_will_do() -> None:
    limits = MotionLimits(mujoco.MjModel.from_xml_string(LIMITED), None)
    rows = np.zeros((5, 6))
    rows[:, 2:4] = 1e3
    assert limits.violation(rows) is None


def test_the_room_of_a_servo_is_that_of_its_joint_after_an_actuator_with_several_controls() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="ball" type="ball" range="0 1"/><geom size=".1"/></body>
        <body pos="1 0 0"><joint name="j" range="-30 90"/><geom size=".1"/></body></worldbody><actuator>
        <orientation joint="ball" ctrlrange="-1 1"/><position joint="j" gear="2"/></actuator></mujoco>"""
    )
    middle, reach = control_room(model, np.full(model.nu, 10.0))
    assert (middle[-1], reach[-1]) == pytest.approx((np.pi / 3, 2 * np.pi / 3))
