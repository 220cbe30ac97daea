"""Noise that is correlated from sample to sample: filters of sensors leave less at high frequencies than below.

Such noise is a share of that of the sample before, plus an independent innovation: a first-order autoregression. A
model that lacks something leaves correlated residuals, too, but their innovations are not independent. Sources:
G. U. Yule, "On a method of investigating periodicities in disturbed series" (1927); G. M. Ljung, G. E. P. Box, "On a
measure of lack of fit in time series models" (1978).
"""

from collections.abc import Sequence
from typing import cast

import numpy as np

from mjrun.fitting.measurements import THIRD_DIFFERENCES, Floats

LAGS = 8  # largest distance of samples whose correlation is tested
DOUBT = 0.005  # probability that white residuals are rejected
SLOWER, SLOWEST = 16, 16  # samples per slow cosine of a chunk, and most of these cosines
CORRELATIONS = np.arange(50) / 50  # correlations of consecutive samples that are compared


def lag_products(parts: Sequence[Floats], lag: int) -> Floats:
    """Returns the sums of products of samples that are `lag` apart, `(...)`.

    Args:
      parts: consecutive samples of each chunk, `(..., n)`.
    """
    return cast(
        "Floats", np.sum([(each[..., lag:] * each[..., : max(each.shape[-1] - lag, 0)]).sum(-1) for each in parts], 0)
    )


def portmanteau(parts: Sequence[Floats]) -> Floats:
    """Returns the statistic of Ljung and Box, `(...)`: χ² of `LAGS` numbers for white samples.

    Args:
      parts: consecutive samples of each chunk, `(..., n)`.
    """
    total = np.maximum(lag_products(parts, 0), 1e-300)
    squares = [(lag_products(parts, lag) / total) ** 2 for lag in range(1, LAGS + 1)]
    return sum(each.shape[-1] for each in parts) * np.sum(squares, axis=0)


def slow_power(parts: Sequence[Floats]) -> Floats:
    """Returns the power of the slowest cosines, `(...)`: about their number for white samples.

    Args:
      parts: consecutive samples of each chunk, `(..., n)`.
    """
    from scipy import fft

    squares = [(fft.dct(each, norm="ortho")[..., : _slow(each.shape[-1])] ** 2).sum(axis=-1) for each in parts]
    variance = lag_products(parts, 0) / sum(each.shape[-1] for each in parts)
    return np.sum(squares, axis=0) / np.maximum(variance, 1e-300)


def _slow(count: int) -> int:
    return min(count // SLOWER, SLOWEST)


def whitened(samples: Floats, correlation: float) -> Floats:
    """Returns independent numbers of the same variance, from noise with this correlation of consecutive samples.

    Args:
      samples: consecutive samples, `(..., n)`.
    """
    left = (samples[..., 1:] - correlation * samples[..., :-1]) / np.sqrt(1 - correlation**2)
    return np.concatenate([samples[..., :1], left], axis=-1)


def with_correlation(samples: Floats, correlation: float) -> Floats:
    """Returns noise with this correlation of consecutive samples, from independent numbers of the same variance.

    Args:
      samples: consecutive samples, `(..., n)`.
    """
    from scipy import signal

    innovations = np.sqrt(1 - correlation**2) * samples
    innovations[..., :1] = samples[..., :1]
    return signal.lfilter([1.0], [1.0, -correlation], innovations)


def noise_scatter(derivatives: Floats, correlation: float) -> Floats:
    """Returns the covariance of the gradients that noise with this correlation and a variance of 1 has, `(p, p)`.

    Args:
      derivatives: derivatives of consecutive samples, `(p, n)`.
    """
    from scipy import signal

    earlier, later = (signal.lfilter([1.0], [1.0, -correlation], derivatives[:, ::way])[:, ::way] for way in (1, -1))
    return (earlier + later - derivatives) @ derivatives.T


def visible_share(correlations: Floats) -> Floats:
    """Returns the share of the variance of noise with these correlations that its third differences show.

    With the correlations ρ, ρ², ρ³ of samples that are 1, 2, 3 apart, third differences have the variance
    20 − 30ρ + 12ρ² − 2ρ³, and those of white noise 20.
    """
    return 1 - 1.5 * correlations + 0.6 * correlations**2 - 0.1 * correlations**3


def visible_noise(residuals: Sequence[Floats]) -> Floats:
    """Returns the standard deviation of white noise with the third differences of residuals, `(signals,)`.

    It is infinite where too few samples are measured.

    Args:
      residuals: residuals of each chunk, `(n, signals)`; NaN where nothing was measured.
    """
    differences = [np.concatenate([np.diff(each, 3) for each in parts]) for parts in samples_by_signal(residuals)]
    return np.array([np.sqrt((each**2).mean() / THIRD_DIFFERENCES) if len(each) else np.inf for each in differences])


def samples_by_signal(residuals: Sequence[Floats]) -> list[list[Floats]]:
    """Returns the samples of each signal in each chunk, without those that are missing.

    Args:
      residuals: residuals of each chunk, `(n, signals)`; NaN where nothing was measured.
    """
    return [
        [column[np.isfinite(column)] for column in columns] for columns in zip(*(r.T for r in residuals), strict=True)
    ]


def are_white(signals: Sequence[Sequence[Floats]]) -> bool:
    """Tests whether samples that are up to `LAGS` apart are uncorrelated.

    Args:
      signals: samples of each signal in each chunk.
    """
    from scipy import special

    statistic = sum(float(portmanteau(parts)) for parts in signals)
    return statistic < float(special.chdtri(LAGS * len(signals), DOUBT))


def correlations(residuals: Sequence[Floats]) -> Floats:
    """Returns the correlation of consecutive samples of each signal, `(signals,)`, if residuals are correlated noise.

    Returns zeros if they are white, if innovations are correlated as well, and if slow cosines exceed the noise that
    the other ones show: a slow misfit can be as correlated as noise.

    Args:
      residuals: residuals of each chunk, `(n, signals)`; NaN where nothing was measured.
    """
    from scipy import special

    signals = samples_by_signal(residuals)
    likeliest, gains = np.transpose([_likeliest(each) for each in signals])
    innovations = [
        [whitened(each, correlation)[1:] for each in parts]
        for parts, correlation in zip(signals, likeliest, strict=True)
    ]
    statistic = sum(float(portmanteau(parts)) for parts in innovations)
    is_noise = (
        not are_white(signals)
        and statistic < special.chdtri((LAGS - 1) * len(signals), DOUBT)
        and gains.sum() < special.chdtri(len(signals), DOUBT)
    )
    return likeliest if is_noise else np.zeros_like(likeliest)


def _likeliest(parts: Sequence[Floats]) -> tuple[float, float]:
    """Returns the likeliest correlation of consecutive samples, and how much likelier slow cosines of any size are.

    The second number is twice the difference of logarithmic likelihoods. Source: P. Whittle, "Estimation and
    information in stationary time series" (1953).
    """
    from scipy import fft

    squares = np.concatenate([fft.dct(each, norm="ortho") ** 2 for each in parts])
    turns = np.concatenate([np.cos(np.pi * np.arange(len(each)) / len(each)) for each in parts])
    is_slow = np.concatenate([np.arange(len(each)) < _slow(len(each)) for each in parts])
    powers = (1 - CORRELATIONS**2)[:, None] / (1 - 2 * CORRELATIONS[:, None] * turns + CORRELATIONS[:, None] ** 2)
    ratios = squares / powers
    levels = np.log(powers).sum(axis=1)
    alike = len(squares) * np.log(np.maximum(ratios.mean(axis=1), 1e-300)) + levels
    apart = levels + sum(
        each.sum() * np.log(np.maximum(ratios[:, each].mean(axis=1), 1e-300))
        for each in (is_slow, ~is_slow)
        if each.any()
    )
    return float(CORRELATIONS[alike.argmin()]), float(alike.min() - apart.min())
