"""Medians and their intervals, against the binomial distribution by hand, and against their coverage."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.bench.statistics import coverage, median_interval, ratio_interval, summarized

SAMPLES = st.lists(st.floats(1e-9, 1e3), min_size=1, max_size=60)


@pytest.mark.parametrize(("n", "k"), [(1, 1), (5, 1), (5, 2), (8, 3), (10, 4)])
def test_the_coverage_is_the_share_of_all_coin_tosses_that_leave_the_median_inside(n: int, k: int) -> None:
    # Each sample lies below the true median or above it, like a coin.
    inside = sum(k <= sum(toss) <= n - k for toss in product((0, 1), repeat=n))
    assert coverage(n, k) * 2**n == inside


@pytest.mark.parametrize(
    ("n", "ranks"),
    # Tables of order statistics that enclose the median at 95 %, as of Le Boudec, Performance Evaluation, appendix A.
    [(5, None), (6, (1, 6)), (8, (1, 8)), (9, (2, 8)), (15, (4, 12)), (20, (6, 15)), (31, (10, 22)), (50, (18, 33))],
)
def test_the_interval_at_95_percent_lies_between_the_ranks_that_tables_give(
    n: int, ranks: tuple[int, int] | None
) -> None:
    result = median_interval(range(n, 0, -1))
    assert (result and (result.low, result.high)) == ranks


@given(SAMPLES)
def test_an_interval_holds_the_median_covers_enough_and_is_the_narrowest_that_does(samples: list[float]) -> None:
    result, n = median_interval(samples), len(samples)
    if result is None:
        assert n < 6
        return
    assert result.low <= np.median(samples) <= result.high
    k = next(k for k in range(1, n) if coverage(n, k) == result.confidence)
    assert coverage(n, k) >= 0.95 > coverage(n, k + 1)


def test_so_many_intervals_hold_the_true_median_as_they_say() -> None:
    rng = np.random.default_rng(1)
    draws = rng.lognormal(size=(4000, 9))  # whose median is 1
    result = [median_interval(draw) for draw in draws]
    held = np.mean([one is not None and one.low <= 1 <= one.high for one in result])
    assert held == pytest.approx(float(coverage(9, 2)), abs=0.015)


def test_the_spread_may_be_that_of_finer_samples() -> None:
    result = summarized([3.0, 1.0, 2.0], range(101))
    assert (result.n, result.median, result.min, result.p5, result.p95) == (3, 2.0, 1.0, 5.0, 95.0)
    assert (result.low, result.high, result.confidence) == (None, None, None)
    assert result.samples == [3.0, 1.0, 2.0]


def test_percentiles_are_those_of_the_samples_else() -> None:
    result = summarized(np.arange(21.0).tolist())
    assert (result.p5, result.p95) == (1.0, 19.0)
    assert result.low is not None


def test_a_ratio_is_between_the_quotients_of_the_ends_of_two_intervals() -> None:
    samples, base = [float(v) for v in range(20, 27)], [float(v) for v in range(10, 17)]
    result = ratio_interval(samples, base)
    assert result is not None
    assert (result.low, result.high) == (20 / 16, 26 / 10)
    assert result.confidence == pytest.approx(1 - 2 * 2 / 2**7)


@pytest.mark.parametrize(("n", "m"), [(6, 50), (50, 6)])
def test_too_few_samples_of_either_give_no_ratio(n: int, m: int) -> None:
    assert ratio_interval([1.0] * n, [1.0] * m) is None
    assert ratio_interval([1.0] * max(7, n), [1.0] * max(7, m)) is not None


def test_at_least_95_percent_of_ratios_hold_the_true_one() -> None:
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(1000):
        result = ratio_interval((1.3 * rng.lognormal(size=12)).tolist(), rng.lognormal(size=15).tolist())
        assert result is not None
        held += result.low <= 1.3 <= result.high
    assert held >= 950
