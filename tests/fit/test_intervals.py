"""Intervals against theory, where it is exact: linear models with white noise."""

from dataclasses import replace

import numpy as np
import pytest

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.intervals import bound_reached, intervals
from mjrun.fit.solution import Solution
from tests.fit.problems import solved

LINE = FreeParameter("x", -1.0, 1.0, 0.0)


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


def test_intervals_are_as_wide_as_what_rough_motions_do() -> None:
    """Nudges that do what ±0.1 of the coordinate does move the fit as a normal distribution of that width."""
    plain = line(0)
    slopes = plain.sensitivities[0][0]
    rough = replace(plain, jitters=[np.concatenate([0.1 * slopes, -0.1 * slopes], axis=2)])
    before, after = (intervals(each, [LINE], 0.95, 0) for each in (plain, rough))
    assert before.high[0] - before.low[0] < 0.02
    wide = 2 * 1.96 * 0.1 * 2 * 1.1  # of a range of 2, and a little more as there are few blocks
    assert after.high[0] - after.low[0] == pytest.approx(wide, rel=0.1)


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
