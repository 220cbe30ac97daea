"""Verdicts on fits against models whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from mjrun.fitting.fit import all_at_bounds, improvement, misfit
from mjrun.fitting.measurements import first_noise
from mjrun.fitting.shooting_problem import RoughMotionEstimate, Solution, UnmodelledEffect
from mjrun.model.table_column import Column
from tests.fitting.problems import solved

SIGNAL = Column("qpos/hinge", "rad")


def with_residuals(residuals: np.ndarray) -> Solution:
    return replace(solved()[0], residuals=[residuals])


def noise(seed: int) -> np.ndarray:
    base, _ = solved()
    return np.random.default_rng(seed).normal(size=base.residuals[0].shape)


def test_reduced_chi_square_is_that_of_the_noise_that_is_known() -> None:
    solution = with_residuals(noise(0))
    fit = misfit(solution, solution.noise, ())
    assert fit.reduced == pytest.approx(1, abs=0.25)
    assert fit.warning() is None
    doubled = misfit(solution, solution.noise / 2, ())
    assert doubled.reduced == pytest.approx(4 * fit.reduced)
    assert doubled.ratios == pytest.approx(2 * fit.ratios)
    assert f"reduced χ² {doubled.reduced:.3g}" in (doubled.warning() or "")
    for probability, warned in ((0.5, False), (0.001, True)):
        rough = replace(solution, estimate=RoughMotionEstimate(np.full((9, 3), 0.5), probability))
        residuals = misfit(rough, solution.noise / 2, ())
        assert ("contacts" in (residuals.warning() or "")) == warned
        assert ("contacts alone" in (residuals.remark() or "")) == (not warned)
    assert misfit(rough, solution.noise, ()).remark() is None
    lacking = replace(
        rough, estimate=RoughMotionEstimate(np.full((9, 3), 0.5), 0.5, UnmodelledEffect("add:x", 0.2, 5.0))
    )
    for noise_size in (solution.noise, solution.noise / 2):
        assert "add:x=0..0.8" in (misfit(lacking, noise_size, ()).warning() or "")
        assert misfit(lacking, noise_size, ()).remark() is None
    assert "contacts" not in (doubled.warning() or "")
    assert "joint/*.damping" in (doubled.warning() or "")
    assert "huber" in (doubled.warning() or "")
    assert "huber" not in (misfit(replace(solution, loss="cauchy"), solution.noise / 2, ()).warning() or "huber")


@pytest.mark.parametrize("loss", ["linear", "huber"])
@pytest.mark.parametrize("size", [16, 40, 240])
def test_noise_alone_is_hardly_ever_beyond_the_noise_however_short_a_log_is(size: int, loss: str) -> None:
    base, accused = replace(solved()[0], loss=loss), 0
    for seed in range(200):
        white, times = noise(seed)[:size], np.linspace(-1, 1, size)
        smooth = np.polynomial.polynomial.polyvander(times, base.unknowns - 1)
        left = white - smooth @ np.linalg.lstsq(smooth, white)[0]  # as after a fit
        seen = first_noise([white]) * base.noise
        accused += misfit(replace(base, residuals=[left]), seen, ()).is_beyond_noise
    assert accused <= 2


def test_signals_with_few_samples_decide_how_much_chance_explains() -> None:
    base, limits = solved()[0], list[float]()
    chunk = base.chunks[0]
    for count in (len(noise(0)), 20):
        both = np.concatenate([noise(0), noise(1)], axis=1)
        both[count:, 1] = np.nan
        chunks = [replace(chunk, segment=replace(chunk.segment, values=np.repeat(chunk.segment.values, 2, axis=1)))]
        solution = replace(base, chunks=chunks, residuals=[both], noise=np.repeat(base.noise, 2))
        limits.append(misfit(solution, solution.noise, ()).limit)
    assert limits[0] == pytest.approx(1.4, abs=0.1)
    assert limits[1] > 2


def test_noise_that_is_correlated_is_no_misfit_unless_its_size_is_known() -> None:
    """Third differences of this noise show about an eighth of its variance."""
    solution = with_residuals(signal.lfilter([0.6], [1, -0.8], noise(3), axis=0))
    (residuals,) = solution.residuals
    seen = np.std(np.diff(residuals, 3, axis=0)) / np.sqrt(20) * solution.noise
    fit = misfit(solution, seen, ())
    assert fit.warning() is None
    assert fit.reduced == pytest.approx(1, abs=0.4)
    assert any("correlated" in each for each in fit.remarks())
    known = misfit(solution, seen, (), {0})
    assert known.reduced > 4
    assert known.warning()
    assert not known.remarks()
    slow = 3 * np.sin(np.arange(len(residuals)) / 20)[:, None]
    assert misfit(with_residuals(noise(3) + slow), solution.noise, ()).warning()


def test_rounding_of_simulations_is_no_noise_of_an_exact_log() -> None:
    """It is correlated, as errors of each step are carried into the next."""
    solution = with_residuals(1e-10 * signal.lfilter([0.6], [1, -0.8], noise(3), axis=0))
    fit = misfit(solution, np.full_like(solution.noise, 1e-7), ())
    assert not fit.remarks()
    assert fit.reduced < 1e-6


def test_high_frequencies_of_the_motion_hide_no_misfit() -> None:
    """Of a log under random controls, these are far above its noise."""
    white, estimated = noise(3), 100 * solved()[0].noise
    slow = 10 * np.sin(np.arange(len(white)) / 20)[:, None]
    assert misfit(with_residuals(white), estimated, ()).warning() is None
    assert misfit(with_residuals(white + slow), estimated, ()).warning()
    assert misfit(with_residuals(white + slow), estimated, (), {0}).warning() is None


def test_residuals_that_filtered_noise_leaves_as_well_are_not_said_to_be_a_lack() -> None:
    """High frequencies do not show how large the mean of five samples of white noise is."""
    solution = with_residuals(signal.lfilter(np.full(5, 5**-0.5), [1], noise(3), axis=0))
    warning = misfit(solution, solution.noise, ()).warning() or ""
    assert "or the log has slow noise" in warning
    assert "if the log has slow noise, set" in warning
    assert misfit(solution, solution.noise, (), {0}).warning() is None

    outliers = noise(3)
    outliers[::40] *= 20
    for white, known in ((outliers, ()), (noise(3), {0})):
        warning = misfit(with_residuals(white), solution.noise / 2, (), known).warning() or ""
        assert "the model lacks something, and" in warning
        assert "slow noise" not in warning


def test_residuals_far_beyond_the_noise_are_refused_where_they_are_a_part_of_the_signal() -> None:
    solution = with_residuals(noise(0))
    spread = float(np.std(solution.chunks[0].values))
    wrong = with_residuals(0.5 * spread / solution.noise * noise(0))
    assert "times its noise" in (misfit(wrong, solution.noise, ()).refusal([SIGNAL]) or "")
    for probability, is_refused in ((0.5, False), (0.001, True)):
        rough = replace(wrong, estimate=RoughMotionEstimate(np.full((9, 3), 0.5), probability))
        assert bool(misfit(rough, solution.noise, ()).refusal([SIGNAL])) == is_refused
    amount = float(np.sqrt(np.mean(wrong.residuals[0] ** 2)) * solution.noise[0])
    for tiny in (solution.noise, 1e-9 * solution.noise):
        expected = f"by {amount:.3g} rad, {amount / tiny[0]:.3g} times its noise"
        assert expected in (misfit(wrong, tiny, ()).refusal([SIGNAL]) or "")
    small = solution.noise / 100  # so that residuals are far beyond it, and a small part of the signal
    assert misfit(solution, small, ()).refusal([SIGNAL]) is None


def test_all_parameters_at_bounds_are_refused_and_one_of_two_is_not() -> None:
    assert "a at its low bound" in (all_at_bounds(["a", "b"], np.array([0.0, 1.0])) or "")
    assert all_at_bounds(["a", "b"], np.array([0.0, 0.5])) is None


def test_an_improvement_is_certain_if_chance_does_not_make_it() -> None:
    """Of models that differ from the truth by less than noise shows, hardly any seems better; by more, all do."""
    certain = {}
    for size in (0.02, 2.0):
        wrong = size * np.sin(np.arange(len(noise(0))) / 9)[:, None]
        pairs = [(with_residuals(noise(seed) + wrong), with_residuals(noise(seed))) for seed in range(40)]
        certain[size] = np.mean([improvement(before, after).is_certain for before, after in pairs])
        assert np.mean([improvement(after, before).is_certain for before, after in pairs]) < 0.1
    assert certain[0.02] < 0.1
    assert certain[2.0] == 1


@pytest.mark.parametrize("size", [3.0, 300.0])
def test_a_robust_loss_does_not_hide_an_improvement_behind_outliers(size: float) -> None:
    """Outliers of both models, and large errors of the first, count as little in the uncertainty as in the gain."""
    r = noise(0)
    r[::25] += 50
    wrong = size * np.sin(np.arange(len(r)) / 9)[:, None]
    before, after = (replace(with_residuals(each), loss="huber") for each in (r + wrong, r))
    assert improvement(before, after).is_certain
    assert not improvement(after, before).is_certain


def test_measurements_are_silent_where_both_models_predict_the_same() -> None:
    same = with_residuals(noise(0))
    assert improvement(same, with_residuals(noise(0) + 1e-3)).is_silent
    assert not improvement(with_residuals(noise(0) + 5), same).is_silent


@pytest.mark.parametrize("size", [0.5, 1e-6])
def test_measurements_are_silent_where_both_models_predict_them_closer_than_the_noise(size: float) -> None:
    """At a limit of a joint, both may predict a rest ever more exactly, and differ by more than their errors."""
    for factor in (1.1, 1.5):
        gained = improvement(with_residuals(factor * size * noise(1)), with_residuals(size * noise(2)))
        assert gained.difference > gained.after
        assert gained.is_silent
        assert not gained.is_certain
