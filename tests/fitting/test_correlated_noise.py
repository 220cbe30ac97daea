"""Correlated noise against its covariance matrix and against scipy's filters."""

import numpy as np
import pytest
from scipy import linalg

from mjrun.fitting.correlated_noise import (
    are_white,
    correlations,
    noise_scatter,
    samples_by_signal,
    visible_share,
    whitened,
    with_correlation,
)
from mjrun.fitting.simulated_regression import _likeliest_noise, _places_of_samples
from tests.fitting.logs import correlated


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8, 0.95])
def test_the_filter_turns_the_covariance_into_the_identity(share: float) -> None:
    covariance = linalg.toeplitz(share ** np.arange(30))
    np.testing.assert_allclose(whitened(whitened(covariance, share).T, share), np.eye(30), atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8, 0.95])
def test_third_differences_see_what_the_covariance_says(share: float) -> None:
    differences = np.diff(np.eye(4), 3, axis=0)[0]
    variance = differences @ linalg.toeplitz(share ** np.arange(4)) @ differences
    assert visible_share(np.array([share]))[0] == pytest.approx(variance / 20)


def test_noise_shows_its_correlation_and_a_misfit_shows_none() -> None:
    """Of 60 logs each, hardly any is mistaken; a slow wave is a misfit, which much correlated noise alone may hide."""
    wave = 1.5 * np.sin(np.arange(240) / 20)[:, None]
    rates, middle = {}, {}
    for share in (0.0, 0.5, 0.8):
        logs = [correlated(share, (240, 2), seed) for seed in range(60)]
        found = np.array([correlations([each]) for each in logs])
        rates[share], middle[share] = found.any(axis=1).mean(), found.mean(axis=0)
        if share < 0.8:
            assert np.mean([correlations([each + wave]).any() for each in logs]) < 0.05
    assert rates[0.0] < 0.05
    assert min(rates[0.5], rates[0.8]) > 0.95
    assert middle[0.5] == pytest.approx([0.5, 0.5], abs=0.05)
    assert middle[0.8] == pytest.approx([0.8, 0.8], abs=0.05)


def test_missing_samples_are_skipped() -> None:
    """A signal with a third of the rate of another, in two chunks."""
    residuals = [correlated(0.6, (600, 2), seed) for seed in range(2)]
    for each in residuals:
        each[np.arange(600) % 3 > 0, 1] = np.nan
    assert [[len(part) for part in parts] for parts in samples_by_signal(residuals)] == [[600, 600], [200, 200]]
    assert not are_white(samples_by_signal(residuals))
    assert correlations(residuals) == pytest.approx([0.6, 0.6**3], abs=0.1)
    known = [np.isfinite(each) for each in residuals]
    flat = np.concatenate([each[mask] for each, mask in zip(residuals, known, strict=True)])
    for parts, expected in zip(_places_of_samples(known), samples_by_signal(residuals), strict=True):
        for places, samples in zip(parts, expected, strict=True):
            np.testing.assert_array_equal(flat[places], samples)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_the_likeliest_noise_is_that_of_the_log_beside_rough_simulations(share: float) -> None:
    """Simulations and the log are random sums of ten sines, 30 times as large as the noise."""
    sines = np.sin(np.outer(np.arange(1, 11), np.arange(300) / 60))
    curves = 30 * np.random.default_rng(0).normal(size=(101, 10)) @ sines
    log = curves[0] + (2 if share else 1) * correlated(share, (300,), 10)
    scale, found, gain = _likeliest_noise([curves[1:, :200] - log[:200], curves[1:, 200:] - log[200:]])
    if share:
        assert found == pytest.approx(share, abs=0.1)
        assert scale == pytest.approx(2, rel=0.25)
        assert gain > 100
    else:
        assert (scale, found, gain) == (1, 0, 0)


def test_scatter_of_gradients_is_that_of_the_covariance_of_the_noise() -> None:
    samples = np.random.default_rng(0).normal(size=(2, 30))
    np.testing.assert_allclose(whitened(with_correlation(samples, 0.9), 0.9), samples)
    covariance = linalg.toeplitz(0.9 ** np.arange(30))
    np.testing.assert_allclose(noise_scatter(samples, 0.9), samples @ covariance @ samples.T)
