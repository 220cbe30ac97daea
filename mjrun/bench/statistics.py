"""Medians of timings and their confidence intervals, for any distribution."""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from mjrun.dataclass import dataclass

CONFIDENCE = 0.95


@dataclass(frozen=True)
class IntervalWithCoverage:
    """A confidence interval, and the probability that an interval computed this way contains the true value."""

    low: float
    high: float
    confidence: float


@dataclass(frozen=True)
class SampleStatistics:
    """Statistics of repeated measurements; wall times are in seconds.

    Attributes:
      n: number of samples.
      median: median of the samples.
      low, high, confidence: interval for the true median, and its coverage; None if `n` is too small for one.
      min: smallest sample.
      p5, p95: 5th and 95th percentile of the samples, or of finer samples where a field says so.
      samples: samples in chronological order.
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
    """Summarizes `samples`; percentiles are those of `finer` samples if there are any."""
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
    """Returns the middle sample, or the mean of the two in the middle."""
    return float(np.median(samples))


def median_interval(samples: Sequence[float], confidence: float = CONFIDENCE) -> IntervalWithCoverage | None:
    """Returns the interval between two order statistics that contains the true median with at least `confidence`.

    The number of samples below the true median is binomial (n, 1/2) whatever the distribution, if the samples are
    independent and it is continuous; so the k-th smallest and the k-th largest enclose it with probability
    1 - 2 P(B < k): David & Nagaraja, Order Statistics, 3rd ed., 7.1. The narrowest such interval is used.

    Returns:
      The interval; None if even the smallest and the largest sample do not reach `confidence`, as with fewer than 6
      samples for 95 %.
    """
    ordered, narrowest = sorted(samples), None

    for k in range(1, len(ordered) // 2 + 1):
        covered = coverage(len(ordered), k)
        if covered < confidence:
            break
        narrowest = IntervalWithCoverage(float(ordered[k - 1]), float(ordered[-k]), float(covered))

    return narrowest


def coverage(n: int, k: int) -> Fraction:
    """Returns the probability that the k-th smallest and k-th largest of `n` samples enclose the true median."""
    return 1 - Fraction(2 * sum(math.comb(n, below) for below in range(k)), 2**n)


def ratio_interval(
    samples: Sequence[float], base: Sequence[float], confidence: float = CONFIDENCE
) -> IntervalWithCoverage | None:
    """Returns an interval for the ratio of the true medians of `samples` and `base`, both positive.

    Order statistics enclose each median at a confidence of (1 + `confidence`) / 2. Both intervals hold at the same time
    with a probability of at least `confidence` (Bonferroni), and so does the quotient of their ends, for any
    distributions.

    Returns:
      The interval; None if either has too few samples: fewer than 7 for 95 %.
    """
    each = 1 - (1 - confidence) / 2
    numerator, denominator = median_interval(samples, each), median_interval(base, each)
    if numerator is None or denominator is None:
        return None
    low, high = numerator.low / denominator.high, numerator.high / denominator.low
    return IntervalWithCoverage(low, high, numerator.confidence + denominator.confidence - 1)
