"""The noise of measurements, against the noise that was put into them."""

import numpy as np
import pytest

from mjrun.fit.noise import first_noise, spread_of
from tests.fit.logs import NOISE
from tests.fit.problems import segments


def test_noise_shows_in_third_differences() -> None:
    assert first_noise(segments())[0] == pytest.approx(NOISE, rel=0.2)


def test_the_spread_under_a_robust_loss_is_that_of_the_middle_half() -> None:
    values = np.random.default_rng(1).normal(3, 2, (4000, 1))
    values[::10] = 100
    assert spread_of(values, "huber")[0] == pytest.approx(2, rel=0.25)
    assert spread_of(values)[0] == pytest.approx(np.std(values))
