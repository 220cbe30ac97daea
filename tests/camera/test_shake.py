"""The shake of a hand-held camera."""

import numpy as np
import pytest

from mjrun.camera.shake import Shake, ShakeNoise


def tremble(shake: Shake, rate: float = 40, count: int = 40_000) -> np.ndarray:
    noise = ShakeNoise(shake)
    return np.array([noise.at(k / rate) for k in range(count)])


def test_a_tremor_has_the_deviation_and_the_band_that_it_promises() -> None:
    angles = tremble(Shake(angle=0.7, frequency=2.0, seed=3))
    assert angles.std(axis=0) == pytest.approx([0.7, 0.7], rel=0.02)
    assert angles.mean(axis=0) == pytest.approx([0, 0], abs=0.01)
    power = np.abs(np.fft.rfft(angles[:, 0] * np.hanning(len(angles)))) ** 2
    hertz = np.fft.rfftfreq(len(angles), 1 / 40)
    assert power[(hertz > 0.99) & (hertz < 3.01)].sum() > 0.9999 * power.sum()
    assert abs(np.corrcoef(angles.T)[0, 1]) < 0.05


def test_a_tremor_depends_on_seed_and_time_alone() -> None:
    one, other = ShakeNoise(Shake(seed=1)), ShakeNoise(Shake(seed=2))
    forward = [one.at(t) for t in (0.0, 0.5, 1.0)]
    backward = [ShakeNoise(Shake(seed=1)).at(t) for t in (1.0, 0.5, 0.0)]
    assert np.array_equal(forward, backward[::-1])
    assert not np.allclose(one.at(0.5), other.at(0.5))
