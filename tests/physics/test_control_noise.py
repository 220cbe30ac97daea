"""Noise on controls: its statistics, and that it does not depend on where one begins."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.physics.control_noise import BLOCK, ControlNoise


@pytest.mark.parametrize("smooth", [0.0, 0.05])
@given(first=st.integers(0, 3 * BLOCK), count=st.integers(0, 2 * BLOCK))
def test_noise_is_the_same_wherever_one_begins(smooth: float, first: int, count: int) -> None:
    whole = ControlNoise(2.0, smooth, 5, 0.002, 3).rows(0, 5 * BLOCK)
    noise = ControlNoise(2.0, smooth, 5, 0.002, 3)
    assert np.array_equal(noise.rows(first, count), whole[first : first + count])
    assert np.array_equal(noise.rows(0, 10), whole[:10])


@pytest.mark.parametrize("smooth", [0.0, 0.02])
def test_noise_has_its_deviation_and_its_memory(smooth: float) -> None:
    rows = ControlNoise(0.5, smooth, 1, 0.002, 40).rows(0, 20_000)
    keep = math.exp(-0.002 / smooth) if smooth else 0.0
    assert rows.std() == pytest.approx(0.5, rel=0.02)
    assert rows.mean() == pytest.approx(0, abs=0.01)
    assert rows[0].std() == pytest.approx(0.5, rel=0.5)
    for lag in (1, 5):
        assert (rows[lag:] * rows[:-lag]).mean() / 0.25 == pytest.approx(keep**lag, abs=0.02)
    across = np.corrcoef(rows.T)[~np.eye(40, dtype=bool)]
    assert abs(across).max() < (0.1 if smooth else 0.04)
