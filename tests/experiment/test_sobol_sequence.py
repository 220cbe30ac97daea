"""Sobol' sequences are those of SciPy, bit for bit."""

import numpy as np
import pytest
from scipy.stats import qmc

from mjrun.experiment import sobol_sequence
from mjrun.experiment.sobol_sequence import sobol_points


@pytest.mark.parametrize(("exponent", "dimensions"), [(0, 1), (1, 2), (10, 1), (7, 3), (5, 40), (13, 2), (3, 300)])
def test_points_are_those_of_scipy(exponent: int, dimensions: int) -> None:
    made, expected = np.random.default_rng(exponent), np.random.default_rng(exponent)
    points = sobol_points(exponent, dimensions, made)
    np.testing.assert_array_equal(points, qmc.Sobol(dimensions, rng=expected).random_base2(exponent))
    assert made.integers(1000) == expected.integers(1000)


def test_scipy_draws_them_where_its_file_of_numbers_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = sobol_points(4, 3, np.random.default_rng(5))
    monkeypatch.setattr(sobol_sequence, "NUMBERS", "elsewhere.npz")
    np.testing.assert_array_equal(sobol_points(4, 3, np.random.default_rng(5)), expected)
