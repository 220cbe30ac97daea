"""Multiple shooting finds what a bare loop was simulated with."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.fit.free_parameter import free_parameters
from mjrun.fit.measurements import Segment
from mjrun.fit.prediction import Predictor
from mjrun.fit.shooting import SHORTEST, Shooting, first_noise, with_noise
from mjrun.fit.starting_states import StartingStates
from mjrun.job.simulation import Simulation
from mjrun.model import state
from tests.fit.car import CAR, SIGNALS, drive
from tests.fit.cart import TRUTH as CART_TRUTH
from tests.fit.cart import cart_log, cart_shooting
from tests.fit.logs import NOISE, NOMINAL, TRUTH, simulate
from tests.fit.problems import THREE, segments, shooting, solved


def test_without_noise_it_finds_the_truth() -> None:
    shoot, parameters = shooting(THREE)
    start = np.array([each.first_coordinate for each in parameters])
    stages = shoot.grown(segments(exact=True), start, np.array([1e-4]))
    values = [each.value(c) for each, c in zip(parameters, stages[-1].coordinates, strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=2e-4)
    assert len(stages[0].chunks) > len(stages[1].chunks) > 1
    assert len(stages[-1].chunks) == 1


def test_with_noise_it_finds_the_truth_and_the_noise() -> None:
    solution, parameters = solved()
    values = [each.value(c) for each, c in zip(parameters, solution.coordinates, strict=True)]
    assert values == pytest.approx(list(TRUTH.values()), rel=0.1)
    assert solution.noise[0] == pytest.approx(NOISE, rel=0.1)
    assert solution.cost == pytest.approx(1)


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


def test_sensitivities_of_rough_contacts_are_those_of_a_bare_loop() -> None:
    """The contacts of a car's wheels make fine differences jump: slopes over 2 % of the range are those that count."""
    simulation, noise, gear = Simulation(CAR), 1e-3, 1.2
    parameters = free_parameters((("scale:actuator/*.gear[0]", "0.3..3"),), simulation.source, SIGNALS)
    predictor = Predictor(simulation, SIGNALS, parameters)
    start = state.save(predictor.model, mujoco.MjData(predictor.model))
    shoot = Shooting(predictor, parameters, StartingStates(predictor.model, SIGNALS, start))
    angles, controls = drive(gear)
    parts = shoot.cut([Segment("log", 0.01 * np.arange(len(angles)), angles, controls)], 10**6)

    coordinate = parameters[0].coordinate(gear)
    look = shoot.look(parts, np.array([coordinate]), start[None], np.full(2, noise))
    more, less = (drive(parameters[0].value(coordinate + move))[0] for move in (0.02, -0.02))
    slope = (more - less) / 0.04 / noise
    assert np.linalg.norm(look.sensitivities[0][0][..., 0] - slope) < 0.15 * np.linalg.norm(slope)
    assert look.jitters
    jumps = with_noise(look, 2 * look.noise).jitters[0]
    np.testing.assert_allclose(2 * jumps, look.jitters[0])


def test_smooth_motions_have_no_jitter() -> None:
    assert not solved()[0].jitters


def test_the_better_of_two_starts_is_taken() -> None:
    shoot, parameters = shooting(THREE)
    truth = np.array([each.coordinate(value) for each, value in zip(parameters, TRUTH.values(), strict=True)])
    found = shoot.best_start(segments(), [np.array([0.99, 0.99, 0.99]), truth], np.array([NOISE]))
    assert found == pytest.approx(truth, abs=0.2)


def test_whole_segments_are_shot_from_other_starts_where_the_fit_is_wrong() -> None:
    """A cart that is not measured: from a solution far off, and from its start, to the truth of a bare loop."""
    log, _ = cart_log()
    shoot, _, _, parameters = cart_shooting()
    wrong, near = np.array([0.05, 0.05]), np.array([0.6, 0.4])
    parts, noise = shoot.cut([log], 10**6), np.array([1e-4])
    found = shoot.look(parts, wrong, shoot.guessed(parts, wrong), noise)
    solutions = shoot.searched(found, [near], noise)
    values = [each.value(c) for each, c in zip(parameters, solutions[-1].coordinates, strict=True)]
    assert values == pytest.approx(CART_TRUTH, rel=0.01)
    assert min(each.cost for each in solutions) == solutions[-1].cost < found.cost
    assert shoot.searched(solutions[-1], [wrong], noise) == []


def test_parameters_that_are_fixed_stay() -> None:
    shoot, _ = shooting(THREE)
    parts = shoot.cut(segments(), 100)
    fixed = np.array([0.2, 0.3, 0.4])
    solution = shoot.follow(parts, fixed, shoot.guessed(parts, None), np.array([NOISE]))
    assert solution.coordinates.tolist() == fixed.tolist()


def test_the_model_as_it_was_is_followed_although_its_values_are_beyond_the_bounds() -> None:
    shoot, _ = shooting((("joint/hinge.damping", "log:1e-3..1e-2"), ("delay:qpos/hinge", "0.1..0.2")))
    nominal: dict[str, Any] = NOMINAL
    times, angles = simulate(2.0, **nominal)
    parts = shoot.cut([Segment("log", times, angles[:, None], np.zeros((len(times), 1)))], 100)
    solution = shoot.follow(parts, None, shoot.guessed(parts, None), np.array([NOISE]))
    assert solution.cost < 1e-2


def test_a_prior_holds_what_the_data_do_not_say() -> None:
    texts = (("actuator/motor.gear[0]", "0.5..2~normal(1.3, 0.1)"), THREE[0])
    shoot, parameters = shooting(texts)
    parts = shoot.cut(segments(1.0), SHORTEST)
    solution = shoot.solve(parts, np.array([0.1, 0.5]), shoot.guessed(parts, None), np.array([NOISE]))
    assert parameters[0].value(solution.coordinates[0]) == pytest.approx(1.3, abs=1e-3)


def test_noise_shows_in_third_differences() -> None:
    assert first_noise(segments())[0] == pytest.approx(NOISE, rel=0.2)


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
