"""Information of measurements against theory: projection, identifiability, and intervals of linear models."""

from dataclasses import replace

import numpy as np
import pytest

from mjrun.fitting.free_parameter import FreeParameter
from mjrun.fitting.information import (
    all_information,
    bound_reached,
    information,
    intervals,
    is_white,
    projected,
    sensitivity,
)
from mjrun.fitting.shooting_fit import SHORTEST
from mjrun.fitting.shooting_problem import STATE_SCALE, RoughMotionEstimate, Solution, with_noise
from tests.fitting.logs import NOISE, correlated
from tests.fitting.problems import THREE, segments, shooting, solved


def test_the_parameters_of_the_joint_problem_are_those_of_the_projected_one() -> None:
    solution, _ = solved()
    a, b = (np.asarray(each)[:, 0] for each in solution.sensitivities[0])
    r = np.random.default_rng(0).normal(size=len(a))
    rows = projected(replace(solution, residuals=[r[:, None]]))[0]
    short, *_ = np.linalg.lstsq(rows.jacobians, rows.residuals, rcond=None)
    joint = np.block([[a, b], [np.zeros((b.shape[1], a.shape[1])), np.eye(b.shape[1]) / STATE_SCALE]])
    full, *_ = np.linalg.lstsq(joint, np.concatenate([r, np.zeros(b.shape[1])]), rcond=None)
    np.testing.assert_allclose(short, full[: a.shape[1]], rtol=1e-3)
    np.testing.assert_allclose(information([rows]), rows.jacobians.T @ rows.jacobians)


def test_missing_samples_have_no_rows() -> None:
    solution, _ = solved()
    residuals = solution.residuals[0].copy()
    residuals[5] = np.nan
    assert len(projected(replace(solution, residuals=[residuals]))[0].residuals) == len(residuals) - 1


def unidentifiable(*texts: tuple[str, str]) -> list[tuple[str, ...]]:
    shoot, parameters = shooting(texts)
    parts = shoot.cut(segments(), 4 * SHORTEST)
    start = np.array([each.first_coordinate for each in parameters])
    look = shoot.look(parts, start, shoot.guessed(parts, None), np.array([NOISE]))
    return [each.paths for each in sensitivity([look], parameters).unidentifiable]


def test_what_shows_in_the_motion_can_be_told() -> None:
    assert unidentifiable(*THREE) == []


def test_the_gear_of_a_motor_that_is_never_driven_cannot() -> None:
    assert unidentifiable(THREE[0], ("actuator/motor.gear[0]", "0.5..2")) == [("actuator/motor.gear[0]",)]


def test_two_names_of_one_thing_cannot_be_told_apart() -> None:
    (mixed,) = unidentifiable(THREE[0], ("geom/rod.mass", "0.5..2"), ("scale:geom/*.mass", "0.5..2"))
    assert set(mixed) == {"geom/rod.mass", "scale:geom/*.mass"}


def test_a_prior_tells_what_measurements_do_not() -> None:
    assert unidentifiable(THREE[0], ("actuator/motor.gear[0]", "0.5..2~normal(1, 0.05)")) == []


def test_a_pendulum_that_swings_freely_does_not_tell_its_mass() -> None:
    """Mass, armature, damping and friction can all be scaled: the motion is the same."""
    (mixed,) = unidentifiable(*THREE, ("geom/rod.mass", "0.5..2"))
    assert set(mixed) == {"geom/rod.mass", *(path for path, _ in THREE)}


def test_messages_name_the_parameters() -> None:
    shoot, parameters = shooting((THREE[0], ("actuator/motor.gear[0]", "0.5..2")))
    parts = shoot.cut(segments(), 4 * SHORTEST)
    look = shoot.look(parts, np.array([0.5, 0.5]), shoot.guessed(parts, None), np.array([NOISE]))
    found = sensitivity([look], parameters)
    assert found.unidentifiable[0].message == "the measurements do not determine actuator/motor.gear[0]"
    assert found.effects[0] > 100
    assert found.effects[1] == pytest.approx(0, abs=1e-6)
    assert np.isinf(found.condition)


LINE = FreeParameter("x", -1.0, 1.0, 0.0)


def white(solution: Solution) -> bool:
    parts = projected(solution)
    informations = np.array([a.T @ a for each in parts for a in np.array_split(each.jacobians, 20)])
    scores = np.array(
        [
            a.T @ r
            for each in parts
            for a, r in zip(np.array_split(each.jacobians, 20), np.array_split(each.residuals, 20), strict=True)
        ]
    )
    return is_white(solution, informations, scores, informations.sum(axis=0))


def line(seed: int, is_correlated: bool = False, uneven: bool = False) -> Solution:
    """A linear model of one parameter whose coordinate is 0.5, with noise; nothing is known of a state."""
    base, _ = solved()
    generator = np.random.default_rng(seed)
    jacobians = np.sin(np.arange(400) / 7)[:, None, None] * 100
    if uneven:  # four blocks of twenty tell nearly all
        jacobians = jacobians * np.exp(-np.arange(400) / 30)[:, None, None]
    noise = generator.normal(size=(400, 1))
    if is_correlated:  # over about five rows
        noise = np.convolve(generator.normal(size=404), np.ones(5), "valid")[:, None] / np.sqrt(5)
    estimate = float(jacobians[:, 0, 0] @ noise[:, 0] / (jacobians**2).sum())
    residuals = noise - jacobians[:, :, 0] * estimate
    chunks = base.chunks[:1]
    states = np.zeros((400, 1, 2))
    coordinates = np.array([0.5 - estimate])
    return replace(
        base, chunks=chunks, coordinates=coordinates, residuals=[residuals], sensitivities=[(jacobians, states)]
    )


def test_white_residuals_have_the_intervals_of_least_squares() -> None:
    """Standard errors of linear regression; correlated residuals have wider ones."""
    solution = line(0)
    assert white(solution)
    jacobians, residuals = solution.sensitivities[0][0][:, 0, 0], solution.residuals[0][:, 0]
    error = float(np.sqrt(residuals @ residuals / (400 - 3) / (jacobians @ jacobians)))
    known = intervals(solution, [LINE], 0.95, 0)
    assert known.high[0] - known.low[0] == pytest.approx(2 * 1.966 * error * 2, rel=0.06)
    assert np.mean([white(line(seed)) for seed in range(40)]) > 0.9
    assert not any(white(line(seed, is_correlated=True)) for seed in range(5))


def test_a_prior_counts_the_same_near_a_bound() -> None:
    """What a prior says of a coordinate is a width over a standard deviation wherever the fit has ended."""
    solution = line(0)
    linear = replace(LINE, prior=(0.0, 0.01))
    logarithmic = FreeParameter("y", 0.1, 10.0, 1.0, is_log=True, prior=(1.0, 0.5))
    for coordinate in (0.5, 0.999, 1.0):
        at = replace(solution, coordinates=np.array([coordinate]))
        plain = float(all_information(at, [LINE])[0, 0])
        assert float(all_information(at, [linear])[0, 0]) - plain == pytest.approx((2 / 0.01) ** 2)
        slope = np.log(100) * 0.1 * 100**coordinate / 0.5
        assert float(all_information(at, [logarithmic])[0, 0]) - plain == pytest.approx(slope**2)
        known = sensitivity([at], [linear])
        assert known.effects[0] == pytest.approx(np.sqrt(plain + (2 / 0.01) ** 2))


@pytest.mark.slow
@pytest.mark.parametrize(("is_correlated", "uneven"), [(False, False), (True, True)])
def test_intervals_contain_the_truth_as_often_as_they_say(is_correlated: bool, uneven: bool) -> None:
    """Of 100 intervals of 90 %, between 81 and 99 % contain the truth: chance alone leaves that about never."""
    found = [intervals(line(seed, is_correlated, uneven), [LINE], 0.9, seed) for seed in range(100)]
    hits = np.mean([each.low[0] < 0.0 < each.high[0] for each in found])
    assert 0.81 < hits < 0.99


def test_they_contain_the_truth_as_often_if_noise_is_so_slow_that_a_fit_follows_it() -> None:
    """Such noise is correlated by 0.95, and residuals less; blocks of a twentieth of the log are too short for it."""
    base, parameters = solved()
    (of_coordinates, of_states), hits = base.sensitivities[0], list[bool]()
    design = np.column_stack([of_coordinates[:, 0], of_states[:, 0]])
    for seed in range(40):
        noise = correlated(0.95, base.residuals[0].shape, seed)
        moves = np.linalg.lstsq(design, -noise[:, 0], rcond=None)[0]
        ends = 0.5 + moves[: len(parameters)]
        solution = replace(base, coordinates=ends, residuals=[noise + (design @ moves)[:, None]])
        known = intervals(with_noise(solution, solution.observed_noise), parameters, 0.95, seed)
        hits += [low <= p.value(0.5) <= high for p, low, high in zip(parameters, known.low, known.high, strict=True)]
    assert np.mean(hits) > 0.93


def test_they_widen_with_confidence() -> None:
    wide, narrow = (intervals(line(0), [LINE], confidence, 0) for confidence in (0.99, 0.5))
    assert wide.low[0] < narrow.low[0] < narrow.high[0] < wide.high[0]


def test_they_stay_within_bounds_and_say_which_is_reached() -> None:
    solution = replace(line(0), coordinates=np.array([0.9999]))
    assert intervals(solution, [LINE], 0.95, 0).high[0] <= 1.0
    assert [bound_reached(c) for c in (0.0, 0.5, 0.9999)] == ["low", "", "high"]


def test_parameters_that_stand_in_for_each_other_are_correlated() -> None:
    solution, parameters = solved()
    found = intervals(solution, parameters, 0.95, 0)
    assert found.correlation.shape == (3, 3)
    np.testing.assert_allclose(np.diag(found.correlation), 1)
    assert found.correlation[0, 2] < -0.9  # damping and friction both brake


def test_the_same_seed_gives_the_same_intervals() -> None:
    solution, parameters = solved()
    assert intervals(solution, parameters, 0.95, 3).low == intervals(solution, parameters, 0.95, 3).low


def test_what_only_a_combination_determines_extends_to_the_bounds() -> None:
    """If data determine the sum of two coordinates, 0.6, each may be from 0 to 0.6, and their correlation is −1."""
    solution = line(0)
    states = solution.sensitivities[0][1]
    twice = np.repeat(solution.sensitivities[0][0], 2, axis=2)
    both = replace(solution, coordinates=np.array([0.2, 0.4]), sensitivities=[(twice, states)])
    found = intervals(both, [LINE, replace(LINE, path="y")], 0.95, 0)
    np.testing.assert_allclose(found.low, -1.0, atol=0.02)
    np.testing.assert_allclose(found.high, 0.2, atol=0.02)
    assert found.correlation[0, 1] == pytest.approx(-1, abs=0.01)


def test_draws_tell_what_the_range_does_not() -> None:
    """Normal draws have the inverse of their covariance as information, less that of the range; uniform ones have none.

    Intervals are quantiles of the draws, and contain the solution.
    """
    solution, parameters = solved()
    generator = np.random.default_rng(0)
    covariance = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    normal = generator.multivariate_normal([0.4, 0.6], covariance, 20_000)
    draws = np.column_stack([normal, generator.uniform(size=20_000)])
    drawn = replace(solution, coordinates=np.array([0.4, 0.9, 0.5]), estimate=RoughMotionEstimate(draws, 0.5))

    matrix = all_information(drawn, parameters)
    np.testing.assert_allclose(matrix[:2, :2], np.linalg.inv(covariance) - 12 * np.eye(2), rtol=0.05)
    (missing,) = sensitivity([drawn], parameters).unidentifiable
    assert missing.paths == (parameters[2].path,)

    known = intervals(drawn, parameters, 0.95, 0)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    assert known.low[0] == pytest.approx(parameters[0].value(low[0]))
    assert known.high[0] == pytest.approx(parameters[0].value(high[0]))
    assert known.high[1] == pytest.approx(parameters[1].value(0.9))  # beyond all draws
