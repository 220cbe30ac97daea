"""Solutions of least squares: other noise, other losses, against scipy's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjrun.fitting.solution import with_noise
from tests.fitting.logs import NOISE
from tests.fitting.problems import solved


def test_other_noise_scales_residuals_and_slopes() -> None:
    solution, _ = solved()
    scaled = with_noise(solution, 2 * solution.noise)
    np.testing.assert_allclose(2 * scaled.residuals[0], solution.residuals[0])
    np.testing.assert_allclose(2 * scaled.sensitivities[0][0], solution.sensitivities[0][0])
    np.testing.assert_allclose(scaled.observed_noise, solution.observed_noise)


def test_a_robust_loss_weighs_outliers_less_and_its_noise_is_not_theirs() -> None:
    solution, _ = solved()
    residuals = [each.copy() for each in solution.residuals]
    residuals[0][::20] = 50.0
    plain = replace(solution, residuals=residuals)
    assert plain.noise_scale[0] > 5 * NOISE
    assert {float(each) for each in plain.weights[0].ravel()} == {1.0}
    for loss in ("soft_l1", "huber", "cauchy"):
        robust = replace(plain, loss=loss)
        assert robust.noise_scale[0] == pytest.approx(NOISE, rel=0.2)
        assert robust.weights[0][0, 0] < 0.03
        assert robust.weights[0][1, 0] > 0.1


def test_weights_are_slopes_of_the_loss() -> None:
    """Those of scipy: d rho(z) / dz of z, the squared residual."""
    from scipy.optimize._lsq.least_squares import IMPLEMENTED_LOSSES

    solution, _ = solved()
    squares = solution.residuals[0].ravel() ** 2
    for loss in ("soft_l1", "huber", "cauchy"):
        slopes = np.empty((3, len(squares)))
        implemented: Any = IMPLEMENTED_LOSSES[loss]
        implemented(squares, slopes, cost_only=False)
        np.testing.assert_allclose(replace(solution, loss=loss).weights[0].ravel(), slopes[1])
