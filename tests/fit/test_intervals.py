"""Intervals against theory, where it is exact: linear models with white noise."""

from dataclasses import replace

import numpy as np
import pytest

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.identifiability import sensitivity
from mjrun.fit.intervals import bound_reached, intervals, is_white
from mjrun.fit.projection import all_information, projected
from mjrun.fit.solution import Solution
from tests.fit.problems import solved

LINE = FreeParameter("x", -1.0, 1.0, 0.0)


def white(solution: Solution) -> bool:
    parts = projected(solution)
    informations = np.array([a.T @ a for each in parts for a in np.array_split(each.slopes, 20)])
    scores = np.array(
        [
            a.T @ r
            for each in parts
            for a, r in zip(np.array_split(each.slopes, 20), np.array_split(each.residuals, 20), strict=True)
        ]
    )
    return is_white(solution, informations, scores, informations.sum(axis=0))


def line(seed: int, correlated: bool = False, uneven: bool = False) -> Solution:
    """A linear model of one parameter whose coordinate is 0.5, with noise; nothing is known of a state."""
    base, _ = solved()
    generator = np.random.default_rng(seed)
    slopes = np.sin(np.arange(400) / 7)[:, None, None] * 100
    if uneven:  # four blocks of twenty tell nearly all
        slopes = slopes * np.exp(-np.arange(400) / 30)[:, None, None]
    noise = generator.normal(size=(400, 1))
    if correlated:  # over about five rows
        noise = np.convolve(generator.normal(size=404), np.ones(5), "valid")[:, None] / np.sqrt(5)
    estimate = float(slopes[:, 0, 0] @ noise[:, 0] / (slopes**2).sum())
    residuals = noise - slopes[:, :, 0] * estimate
    chunks = base.chunks[:1]
    states = np.zeros((400, 1, 2))
    coordinates = np.array([0.5 - estimate])
    return replace(
        base, chunks=chunks, coordinates=coordinates, residuals=[residuals], sensitivities=[(slopes, states)]
    )


def test_intervals_are_as_wide_as_searches_end_apart() -> None:
    """Of eight ends at ±0.1 of the coordinate, Student's t with eight degrees of freedom: 2.306 times 0.1 of 2."""
    plain = line(0)
    rough = replace(plain, ends=[plain.coordinates + move for move in (0.1, -0.1) * 4])
    before, after = (intervals(each, [LINE], 0.95, 0) for each in (plain, rough))
    assert before.high[0] - before.low[0] < 0.02
    assert after.high[0] - after.low[0] == pytest.approx(2 * 2.306 * 0.1 * 2, rel=0.1)


def test_white_residuals_have_the_intervals_of_least_squares() -> None:
    """Standard errors of linear regression; correlated residuals have wider ones."""
    solution = line(0)
    assert white(solution)
    slopes, residuals = solution.sensitivities[0][0][:, 0, 0], solution.residuals[0][:, 0]
    error = float(np.sqrt(residuals @ residuals / (400 - 3) / (slopes @ slopes)))
    known = intervals(solution, [LINE], 0.95, 0)
    assert known.high[0] - known.low[0] == pytest.approx(2 * 1.966 * error * 2, rel=0.06)
    assert np.mean([white(line(seed)) for seed in range(40)]) > 0.9
    assert not any(white(line(seed, correlated=True)) for seed in range(5))


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
@pytest.mark.parametrize(("correlated", "uneven"), [(False, False), (True, False), (False, True), (True, True)])
def test_intervals_contain_the_truth_as_often_as_they_say(correlated: bool, uneven: bool) -> None:
    """Of 200 intervals of 90 %, between 83 and 97 % contain the truth: chance alone leaves that about never."""
    found = [intervals(line(seed, correlated, uneven), [LINE], 0.9, seed) for seed in range(200)]
    hits = np.mean([each.low[0] < 0.0 < each.high[0] for each in found])
    assert 0.83 < hits < 0.97


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
