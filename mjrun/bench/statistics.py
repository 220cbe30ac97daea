"""Medians of timings and their confidence intervals, whatever the distribution."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

CONFIDENCE = 0.95


@dataclass(frozen=True)
class ConfidenceInterval:
    """An interval, and the probability that an interval so computed contains the true value."""

    low: float
    high: float
    confidence: float


@dataclass(frozen=True)
class SampleStatistics:
    """Statistics of repeated measurements; wall times are in seconds.

    Attributes:
      n: number of samples.
      median: of the samples.
      low, high, confidence: an interval for the true median, and its coverage; None when `n` is too small for one.
      min: the smallest sample.
      p5, p95: 5th and 95th percentile of the samples, or of finer samples where the field that holds this says so.
      samples: in order of time.
    """

    n: int
    median: float
    low: float | None
    high: float | None
    confidence: float | None
    min: float
    p5: float
    p95: float
    samples: Sequence[float]


def summarized(samples: Sequence[float], finer: Sequence[float] | None = None) -> SampleStatistics:
    """The statistics of `samples`; percentiles are those of `finer` samples where there are some."""
    interval = median_interval(samples)
    p5, p95 = np.percentile(samples if finer is None else finer, [5, 95])
    return SampleStatistics(
        n=len(samples),
        median=median(samples),
        low=interval and interval.low,
        high=interval and interval.high,
        confidence=interval and interval.confidence,
        min=float(min(samples)),
        p5=float(p5),
        p95=float(p95),
        samples=[float(sample) for sample in samples],
    )


def median(samples: Sequence[float]) -> float:
    """The middle sample, or the mean of the two in the middle."""
    return float(np.median(samples))


def median_interval(samples: Sequence[float], confidence: float = CONFIDENCE) -> ConfidenceInterval | None:
    """The interval between two order statistics that holds the true median with at least this `confidence`.

    The number of samples below the true median is binomial (n, 1/2) whatever the distribution, if the samples are
    independent and it is continuous; so the k-th smallest and the k-th largest enclose it with probability
    1 - 2 P(B < k): David & Nagaraja, Order Statistics, 3rd ed., 7.1. The narrowest such interval is taken.

    Returns:
      None when even the smallest and the largest sample do not reach `confidence`: fewer than 6 samples for 95 %.
    """
    ordered, narrowest = sorted(samples), None

    for k in range(1, len(ordered) // 2 + 1):
        covered = coverage(len(ordered), k)
        if covered < confidence:
            break
        narrowest = ConfidenceInterval(float(ordered[k - 1]), float(ordered[-k]), float(covered))

    return narrowest


def coverage(n: int, k: int) -> Fraction:
    """The probability that the k-th smallest and the k-th largest of `n` samples enclose the true median."""
    return 1 - Fraction(2 * sum(math.comb(n, below) for below in range(k)), 2**n)


def ratio_interval(
    samples: Sequence[float], base: Sequence[float], confidence: float = CONFIDENCE
) -> ConfidenceInterval | None:
    """An interval for the ratio of the true medians, of `samples` to `base`; both positive.

    Each median is enclosed by order statistics at a confidence of (1 + `confidence`) / 2. Both intervals hold at once
    with a probability of at least `confidence` (Bonferroni), and so does the quotient of their ends, whatever the
    distributions.

    Returns:
      None when there are too few samples of either: fewer than 7 for 95 %.
    """
    each = 1 - (1 - confidence) / 2
    numerator, denominator = median_interval(samples, each), median_interval(base, each)
    if numerator is None or denominator is None:
        return None
    low, high = numerator.low / denominator.high, numerator.high / denominator.low
    return ConfidenceInterval(low, high, numerator.confidence + denominator.confidence - 1)
