"""Degrees are suspected where the numbers show them, and nowhere else."""

import mujoco
import numpy as np
import pytest

from mjrun.fitting.measurements import degree_remarks

TIMES: np.ndarray = np.arange(200) * 0.01
ANGLES = 0.6 * np.sin(5 * TIMES)
RATES = 3 * np.cos(5 * TIMES)


def model(attributes: str) -> mujoco.MjModel:
    joint = f'<joint name="knee" {attributes}/><geom size=".1"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body>{joint}</body></worldbody></mujoco>")


def remarks(attributes: str, **signals: np.ndarray) -> list[str]:
    return [*degree_remarks(model(attributes), TIMES, {f"{name}/knee": each for name, each in signals.items()})]


def test_degrees_beyond_the_limits_of_a_joint_are_suspected() -> None:
    (remark,) = remarks('range="-40 40"', qpos=np.degrees(ANGLES))
    assert "qpos/knee reaches 34.4 rad, and the joint is limited to 0.698 rad" in remark
    assert "'qpos/knee=qpos/knee*pi/180'" in remark


def test_degrees_that_contradict_the_measured_velocity_are_suspected() -> None:
    noise = np.random.default_rng(0).normal(0, 0.05, len(TIMES))
    (remark,) = remarks("", qpos=np.degrees(ANGLES) + noise, qvel=RATES)
    assert "qpos/knee changes 57 times as fast as qvel/knee says" in remark


@pytest.mark.parametrize(
    ("attributes", "signals"),
    [
        ('range="-40 40"', {"qpos": ANGLES, "qvel": RATES}),
        ('range="-10 10"', {"qpos": ANGLES}),  # beyond its limits, in either unit
        ("", {"qpos": 100 * TIMES, "qvel": np.full(len(TIMES), 100.0)}),  # a wheel
        ("", {"qpos": np.degrees(ANGLES)}),  # nothing contradicts it
        ("", {"qpos": np.zeros(len(TIMES)), "qvel": np.zeros(len(TIMES))}),
        ("", {"qpos": np.full(len(TIMES), np.nan)}),
        ('type="slide" range="-0.5 0.5"', {"qpos": np.degrees(ANGLES), "qvel": RATES}),
    ],
)
def test_nothing_else_is_suspected(attributes: str, signals: dict[str, np.ndarray]) -> None:
    assert remarks(attributes, **signals) == []
