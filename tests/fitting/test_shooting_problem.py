"""Residuals, derivatives and solutions of multiple shooting: other noise and other losses, against scipy's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjrun.fitting.measurements import LogSegment
from mjrun.fitting.shooting_fit import SHORTEST
from mjrun.fitting.shooting_problem import with_noise
from tests.fitting.logs import NOISE, NOMINAL, simulate
from tests.fitting.problems import THREE, segments, shooting, solved


def test_sensitivities_are_slopes_of_the_residuals() -> None:
    shoot, parameters = shooting(THREE)
    log = segments()
    parts = shoot.cut(log, SHORTEST)
    states, noise = shoot.guessed(parts, None), np.array([NOISE])
    middle = np.full(len(parameters), 0.5)
    base = shoot.look(parts, middle, states, noise)
    step = 1e-4
    for j in range(len(parameters)):
        ends = [shoot.look(parts, middle + sign * step * np.eye(3)[j], states, noise).residuals for sign in (1, -1)]
        for chunk in range(3):
            slope = (ends[0][chunk] - ends[1][chunk]) / (2 * step)
            np.testing.assert_allclose(base.sensitivities[chunk][0][..., j], slope, rtol=1e-2, atol=0.05)


def test_parameters_that_are_fixed_stay() -> None:
    shoot, _ = shooting(THREE)
    parts = shoot.cut(segments(), 100)
    fixed = np.array([0.2, 0.3, 0.4])
    solution = shoot.follow(parts, fixed, np.array([NOISE]))
    assert solution.coordinates.tolist() == fixed.tolist()


def test_the_model_as_it_was_is_followed_although_its_values_are_beyond_the_bounds() -> None:
    shoot, _ = shooting((("joint/hinge.damping", "log:1e-3..1e-2"), ("delay:qpos/hinge", "0.1..0.2")))
    nominal: dict[str, Any] = NOMINAL
    times, angles = simulate(2.0, **nominal)
    parts = shoot.cut([LogSegment("log", times, angles[:, None], np.zeros((len(times), 1)))], 100)
    solution = shoot.follow(parts, None, np.array([NOISE]))
    assert solution.cost < 1e-2


def test_a_prior_holds_what_the_data_do_not_say() -> None:
    texts = (("actuator/motor.gear[0]", "0.5..2~normal(1.3, 0.1)"), THREE[0])
    shoot, parameters = shooting(texts)
    parts = shoot.cut(segments(1.0), SHORTEST)
    solution = shoot.solve(parts, np.array([0.1, 0.5]), shoot.guessed(parts, None), np.array([NOISE]))
    assert parameters[0].value(solution.coordinates[0]) == pytest.approx(1.3, abs=1e-3)


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
        jacobians = np.empty((3, len(squares)))
        implemented: Any = IMPLEMENTED_LOSSES[loss]
        implemented(squares, jacobians, cost_only=False)
        np.testing.assert_allclose(replace(solution, loss=loss).weights[0].ravel(), jacobians[1])
