"""Gauss-Newton steps against least squares of scipy, and motions whose derivatives mislead."""

from typing import Any

import numpy as np
import pytest

from mjrun.fitting.gauss_newton import GaussNewton, is_rough, solve_normal
from mjrun.fitting.prediction import ChunkInitialStates, ChunkRolloutInputs
from mjrun.fitting.shooting_problem import STATE_SCALE, ShootingProblem, together
from tests.fitting.box import FRICTION, box_shooting
from tests.fitting.logs import NOISE
from tests.fitting.problems import THREE, predictor_of, segments, shooting, solved


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_it_ends_where_scipy_does(loss: str) -> None:
    from scipy.optimize import least_squares

    shoot, parameters = shooting(THREE[:2])
    predictor = predictor_of(shoot)
    (part,) = shoot.cut(segments(1.0))
    guess, noise = shoot.guessed([part], None), np.array([NOISE])
    states = ChunkInitialStates(predictor.model)
    problem = ShootingProblem(predictor, parameters, states, [part], np.array([0.5, 0.5]), guess, noise, loss, False)
    (solution,) = together(predictor, [GaussNewton(problem).minimize()])

    def residuals(x: np.ndarray) -> np.ndarray:
        values = tuple(p.value(c) for p, c in zip(parameters, x[:2], strict=True))
        (rows,) = predictor.predict([ChunkRolloutInputs(part, values, states.moved(guess[0], x[2:]))])
        return np.concatenate([((rows - part.values) / noise).ravel(), x[2:] / STATE_SCALE])

    start: Any = np.concatenate([solution.coordinates, np.zeros(2)])
    bounds = ([0, 0, -np.inf, -np.inf], [1, 1, np.inf, np.inf])
    expected = least_squares(residuals, start, bounds=bounds, x_scale="jac", loss=loss, xtol=1e-12, ftol=1e-12)
    np.testing.assert_allclose(solution.coordinates, expected.x[:2], atol=2e-4)


def test_parameters_stop_at_their_bounds() -> None:
    """The true damping is below the bounds."""
    shoot, _ = shooting((("joint/hinge.damping", "0.2..1"), THREE[1]))
    (part,) = shoot.cut(segments(1.0))
    solution = shoot.solve([part], np.array([0.5, 0.5]), shoot.guessed([part], None), np.array([NOISE]))
    assert solution.coordinates[0] == 0.0
    assert 0 < solution.coordinates[1] < 1


@pytest.mark.slow
def test_problems_side_by_side_come_to_what_each_comes_to_alone() -> None:
    shoot, _ = shooting(THREE[:1])
    parts = shoot.cut(segments(0.5))
    alone = [shoot.solve(parts, np.array(x), shoot.guessed(parts, None), np.array([NOISE])) for x in ([0.4], [0.7])]
    tasks = [
        GaussNewton(shoot._problem(parts, np.array(x), shoot.guessed(parts, None), np.array([NOISE]))).minimize()
        for x in ([0.4], [0.7])
    ]
    beside = together(predictor_of(shoot), tasks)
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(one.coordinates, other.coordinates)


def test_steep_slopes_leave_normal_equations_solvable() -> None:
    """Two unknowns that residuals only tell the sum of, beside which what holds them in place is lost in rounding."""
    matrix = 1e20 * np.ones((2, 2)) + np.eye(2)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.solve(matrix, np.ones(2))
    np.testing.assert_allclose(solve_normal(matrix, 1e20 * np.ones((2, 1))).sum(), 1.0)


def test_derivatives_mislead_beside_contacts_and_not_where_motion_is_smooth() -> None:
    """A box that slides and rattles, and a pendulum, both at the true values."""
    shoot, log, noise, parameters = box_shooting()
    parts = shoot.cut([log])
    truth = np.array([parameters[0].coordinate(FRICTION)])
    states = shoot.guessed(parts, truth)
    box = shoot._problem(parts, truth, states, noise), shoot.look(parts, truth, states, noise)

    solution, _ = solved()
    smooth, _ = shooting(THREE)
    pendulum = smooth._problem(solution.chunks, solution.coordinates, solution.states, solution.noise), solution

    for one, (problem, at), rough in ((shoot, box, True), (smooth, pendulum, False)):
        (answer,) = together(predictor_of(one), [is_rough(problem, at.sensitivities)])
        assert answer == rough
