"""The stimulus of testspeed, against MuJoCo's Halton sequence and an explicit loop."""

import math

import mujoco
import numpy as np
import pytest

from mjrun.bench.bench import halton, noisy_controls

MODEL = """
<mujoco>
  <option timestep=".005"/>
  <worldbody>
    <body><joint name="a"/><geom size=".1"/></body>
    <body><joint name="b"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="a" ctrlrange="-1 3" ctrllimited="true"/><motor joint="b"/></actuator>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


@pytest.mark.parametrize("base", [2, 3, 4, 10, 23])
def test_the_halton_sequence_is_mujocos_bit_for_bit(base: int) -> None:
    expected = [mujoco.mju_Halton(index, base) for index in range(500)]
    assert halton(np.arange(500), base).tolist() == expected


def written_out(model: mujoco.MjModel, steps: int, std: float, rate: float, center: list[float]) -> np.ndarray:
    """Computes the controls as testspeed.cc does, number by number."""
    keep = math.exp(-model.opt.timestep / rate)
    scale = std * math.sqrt(1 - keep**2)
    result = np.zeros((steps, model.nu))
    for step in range(steps):
        for i in range(model.nu):
            low, high = model.actuator_ctrlrange[i]
            limited = bool(model.actuator_ctrllimited[i])
            half = (high - low) / 2 if limited else 1
            value = keep * result[step - 1, i] + (1 - keep) * center[i] if step else center[i]
            value += scale * half * (2 * mujoco.mju_Halton(step, i + 2) - 1)
            result[step, i] = min(max(value, low), high) if limited else value
    return result


@pytest.mark.parametrize("std", [0.01, 1.0])
def test_controls_are_those_of_testspeed_about_the_middle_of_each_range(model: mujoco.MjModel, std: float) -> None:
    expected = written_out(model, 300, std, 0.1, [1.0, 0.0])
    np.testing.assert_allclose(noisy_controls(model, 300, std, 0.1), expected, rtol=1e-13, atol=1e-15)


def test_controls_return_to_a_keyframes_and_stay_in_their_range(model: mujoco.MjModel) -> None:
    result = noisy_controls(model, 300, 1.0, 0.1, np.array([2.9, -4.0]))
    np.testing.assert_allclose(result, written_out(model, 300, 1.0, 0.1, [2.9, -4.0]), rtol=1e-13)
    assert result[:, 0].max() == 3.0
    assert result[:, 1].mean() == pytest.approx(-4.0, abs=0.2)


def test_fewer_steps_are_the_beginning_of_more(model: mujoco.MjModel) -> None:
    assert noisy_controls(model, 50).tolist() == noisy_controls(model, 80)[:50].tolist()


def test_without_a_rate_the_noise_is_new_at_every_step(model: mujoco.MjModel) -> None:
    result = noisy_controls(model, 40, 0.5, 0.0)
    assert result[:, 0] == pytest.approx(1 + 0.5 * 2 * (2 * halton(np.arange(40), 2) - 1))


def test_a_model_without_actuators_has_no_controls() -> None:
    assert noisy_controls(mujoco.MjModel.from_xml_string("<mujoco/>"), 7).shape == (7, 0)
