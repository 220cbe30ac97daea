"""Intervals against scipy, published examples, and their coverage."""

import tracemalloc

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from mjrun.experiment.statistics import (
    NO_INTERVAL,
    Interval,
    doubt,
    enough_cases,
    group_means,
    interquartile_mean,
    iqm_difference_interval,
    iqm_interval,
    mean_interval,
    median_interval,
    paired_share_interval,
    share,
    summarized,
    wilson_interval,
)

LEVELS = st.sampled_from([0.8, 0.9, 0.95, 0.99])


def ends(interval: Interval) -> tuple[float, float]:
    assert interval.low is not None
    assert interval.high is not None
    return interval.low, interval.high


def rounding(values: np.ndarray, *ends: float) -> float:
    """Returns a bound on rounding errors in computations with numbers as large as these."""
    return 1e-11 * max(1.0, *np.abs(values), *map(abs, ends))


def test_means_of_groups_are_those_of_each_group_alone() -> None:
    generator = np.random.default_rng(3)
    values, groups = generator.normal(5, 2, 60), np.repeat([0, 2, 3, 4], [1, 20, 9, 30])
    values[[25, 40]] = np.nan, np.inf
    made = group_means(values, groups, 5, 0.9)
    for group in range(5):
        alone = values[(groups == group) & np.isfinite(values)]
        expected = mean_interval(alone, 0.9) if len(alone) > 1 else Interval(np.nan, np.nan)
        mean = alone.mean() if len(alone) else np.nan
        assert made.count[group] == len(alone)
        np.testing.assert_allclose(
            [made.mean[group], made.low[group], made.high[group]], [mean, *ends(expected)], rtol=1e-12
        )


@given(st.integers(1, 400).flatmap(lambda of: st.tuples(st.integers(0, of), st.just(of))), LEVELS)
def test_the_interval_of_a_share_is_wilsons(counts: tuple[int, int], confidence: float) -> None:
    count, of = counts
    expected = scipy.stats.binomtest(count, of).proportion_ci(confidence, method="wilson")
    result = wilson_interval(count, of, confidence)
    assert (result.low, result.high) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert share([True] * count + [False] * (of - count), confidence).interval == result


def test_a_share_of_all_or_none_reaches_the_end() -> None:
    assert wilson_interval(0, 7).low == 0
    assert wilson_interval(7, 7).high == 1


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=60), LEVELS)
def test_the_interval_of_a_mean_is_students(values: list[float], confidence: float) -> None:
    numbers = np.array(values)
    spread = scipy.stats.sem(numbers)
    result = mean_interval(numbers, confidence)
    if spread == 0:
        assert result == Interval(numbers.mean(), numbers.mean())
        return
    expected = scipy.stats.t.interval(confidence, len(numbers) - 1, numbers.mean(), spread)
    assert (result.low, result.high) == pytest.approx(expected, rel=1e-9, abs=rounding(numbers, *expected))


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=80, unique=True), LEVELS)
def test_the_interval_of_a_median_is_that_of_the_quantile_test(values: list[float], confidence: float) -> None:
    expected = scipy.stats.quantile_test(values, p=0.5).confidence_interval(confidence)
    result = median_interval(np.array(values), confidence)
    if np.isnan(expected.low) or np.isnan(expected.high):
        assert result == Interval(None, None)
    else:
        assert (result.low, result.high) == (expected.low, expected.high)


def paired(both: int, first: int, second: int, neither: int) -> tuple[np.ndarray, np.ndarray]:
    counts = [both, first, second, neither]
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        # Fagerland, Lydersen, Laake, Statistics in Medicine 33 (2014) 2850: Newcombe's square-and-add interval.
        ((1, 1, 7, 12), (-0.507, -0.026)),
        # Newcombe 1998, table II, method 10.
        ((36, 12, 2, 0), (0.0569, 0.3404)),
        ((36, 14, 0, 0), (0.1528, 0.4167)),
    ],
)
def test_the_interval_of_a_difference_of_paired_shares_is_that_of_the_literature(
    table: tuple[int, int, int, int], expected: tuple[float, float]
) -> None:
    result = paired_share_interval(*paired(*table))
    digits = 3 if table[0] == 1 else 4
    assert tuple(round(end, digits) for end in ends(result)) == expected


@given(*[st.integers(0, 40)] * 4)
def test_a_difference_lies_in_its_interval_which_turns_around_with_the_sides(a: int, b: int, c: int, d: int) -> None:
    if a + b + c + d == 0:
        return
    ours, theirs = paired(a, b, c, d)
    low, high = ends(paired_share_interval(ours, theirs))
    assert -1 <= low <= high <= 1
    assert low - 1e-12 <= (b - c) / (a + b + c + d) <= high + 1e-12
    assert ends(paired_share_interval(theirs, ours)) == pytest.approx((-high, -low), abs=1e-12)


def test_intervals_cover_what_they_are_to_cover() -> None:
    generator, tries = np.random.default_rng(5), 400
    covered = {"mean": 0, "median": 0, "difference": 0}
    for _ in range(tries):
        values = generator.normal(3, 2, 25)
        covered["mean"] += _contains(mean_interval(values), 3)
        covered["median"] += _contains(median_interval(values), 3)
        cases = generator.choice(4, 60, p=[0.5, 0.2, 0.1, 0.2])
        ours, theirs = cases < 2, (cases == 0) | (cases == 2)
        covered["difference"] += _contains(paired_share_interval(ours, theirs), 0.1)
    shares = {name: count / tries for name, count in covered.items()}
    assert all(0.92 < each <= 0.99 for each in shares.values()), shares


@given(st.lists(st.floats(-1e3, 1e3), min_size=12, max_size=60), LEVELS, st.integers(2, 5))
def test_the_mean_of_clusters_of_one_size_has_the_interval_of_their_own_means(
    values: list[float], confidence: float, size: int
) -> None:
    numbers = np.array(values[: len(values) // size * size])
    means = numbers.reshape(-1, size).mean(axis=1)
    result = mean_interval(numbers, confidence, np.repeat(np.arange(len(means)), size))
    expected = ends(mean_interval(means, confidence))
    assert ends(result) == pytest.approx(expected, rel=1e-9, abs=rounding(numbers, *expected))


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=40), st.integers(1, 6))
def test_the_same_cases_several_times_say_no_more_than_once(cases: list[tuple[bool, bool]], times: int) -> None:
    ours, theirs = np.array(cases).T
    clusters = np.tile(np.arange(len(ours)), times)
    again = [np.tile(each, times) for each in (ours, theirs)]
    pairs = [
        (paired_share_interval(again[0], again[1], clusters=clusters), paired_share_interval(ours, theirs)),
        (share(again[0], clusters=clusters).interval, share(ours).interval),
        (median_interval(again[0] + 0.0, clusters=clusters), median_interval(ours + 0.0)),
    ]
    for result, expected in pairs:
        assert (result.low, result.high) == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_intervals_of_clusters_cover_what_they_are_to_cover_where_those_of_independent_cases_do_not() -> None:
    generator, tries, seeds, points = np.random.default_rng(8), 300, 30, 8
    clusters = np.tile(np.arange(seeds), points)
    covered = dict.fromkeys(["mean", "median", "share", "difference", "naive mean", "naive difference"], 0)
    for _ in range(tries):
        common, noise = generator.normal(size=seeds)[clusters], generator.normal(size=seeds * points)
        values = 3 + common + 0.5 * noise
        covered["mean"] += _contains(mean_interval(values, clusters=clusters), 3)
        covered["median"] += _contains(median_interval(values, clusters=clusters), 3)
        covered["share"] += _contains(share(values > 3, clusters=clusters).interval, 0.5)
        theirs = values - 0.5 * noise + generator.normal(size=seeds)[clusters] > 3
        covered["difference"] += _contains(paired_share_interval(values > 3, theirs, clusters=clusters), 0)
        covered["naive mean"] += _contains(mean_interval(values), 3)
        covered["naive difference"] += _contains(paired_share_interval(values > 3, theirs), 0)
    shares = {name: count / tries for name, count in covered.items()}
    assert all(each > 0.91 for name, each in shares.items() if "naive" not in name), shares
    assert shares["naive mean"] < 0.7
    assert shares["naive difference"] < 0.8


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=80))
def test_the_interquartile_mean_is_the_trimmed_mean(values: list[float]) -> None:
    numbers = np.array(values)
    expected = scipy.stats.trim_mean(numbers, 0.25)
    assert interquartile_mean(numbers) == pytest.approx(expected, rel=1e-12, abs=rounding(numbers))


def test_the_interval_of_an_interquartile_mean_is_that_of_the_bootstrap() -> None:
    for size, shape in ((9, 2.0), (60, 5.0)):
        values = np.random.default_rng(size).gamma(shape, size=size)
        low, high = scipy.stats.bootstrap(
            [values],
            lambda sample, axis: scipy.stats.trim_mean(sample, 0.25, axis),
            n_resamples=4000,
            method="percentile",
            rng=np.random.default_rng(1),
        ).confidence_interval
        assert ends(iqm_interval(values)) == pytest.approx((low, high), abs=0.06 * (high - low))
        assert iqm_interval(values) == iqm_interval(values[::-1].copy())


def test_the_bootstrap_of_many_cases_needs_little_memory() -> None:
    values = np.random.default_rng(0).normal(size=20_000)
    tracemalloc.start()
    try:
        iqm_interval(values)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 16 * 2**20


def test_the_interval_of_a_difference_of_interquartile_means_is_that_of_the_paired_bootstrap() -> None:
    generator = np.random.default_rng(7)
    ours = generator.gamma(2, size=40)
    theirs = ours + generator.normal(0.5, 0.2, size=40)
    low, high = scipy.stats.bootstrap(
        (ours, theirs),
        lambda one, other, axis: scipy.stats.trim_mean(one, 0.25, axis) - scipy.stats.trim_mean(other, 0.25, axis),
        n_resamples=4000,
        paired=True,
        vectorized=True,
        method="percentile",
        rng=np.random.default_rng(1),
    ).confidence_interval
    interval = iqm_difference_interval(ours, theirs)
    assert ends(interval) == pytest.approx((low, high), abs=0.08 * (high - low))
    assert ends(iqm_difference_interval(ours + 3, ours)) == pytest.approx((3, 3))
    assert iqm_difference_interval(ours[:1], theirs[:1]) == NO_INTERVAL


def test_the_bootstrap_of_points_with_common_seeds_draws_seeds() -> None:
    """Episodes that are equal at all points say no more than those of one point."""
    values, seeds = np.sort(np.random.default_rng(2).normal(size=24)), np.arange(24)
    again = iqm_interval(np.tile(values, 5), clusters=np.tile(seeds, 5))
    assert ends(again) == pytest.approx(ends(iqm_interval(values)), rel=1e-9)


def test_students_interval_is_doubted_where_it_does_not_cover_and_the_interquartile_means_does() -> None:
    """With 10 % disasters; with normal numbers, it covers, and is doubted only where a sample cannot show more."""
    generator, tries, doubted, covered = (
        np.random.default_rng(3),
        300,
        dict[tuple[str, int], float](),
        dict[str, float](),
    )
    for name, probability in (("disasters", 0.1), ("normal", 0.0)):
        for size in (10, 20, 40):
            kinds = generator.random((tries, size)) < probability
            samples = np.where(kinds, -100.0, 100.0) + generator.normal(0, 5, (tries, size))
            mean = 100 - 200 * probability
            covered[f"{name} {size}"] = float(np.mean([_contains(mean_interval(sample), mean) for sample in samples]))
            doubted[name, size] = float(np.mean([doubt(sample) != "" for sample in samples]))
    assert 0.57 < covered["disasters 10"] < 0.73  # 1 - 0.9^10 = 65 %: samples with a disaster
    assert 0.82 < covered["disasters 20"] < 0.93
    assert doubted["disasters", 10] == doubted["disasters", 20] == 1
    assert doubted["disasters", 40] > 0.9
    assert covered["normal 40"] > 0.92
    assert doubted["normal", 40] < 0.05
    assert enough_cases() == 29
    assert doubt(np.ones(5)) == ""

    disasters = np.where(generator.random((tries, 20)) < 0.1, 0.0, 100.0) + generator.normal(0, 5, (tries, 20))
    large = np.where(generator.random(200_000) < 0.1, 0.0, 100.0) + generator.normal(0, 5, 200_000)
    truth = scipy.stats.trim_mean(large, 0.25)
    assert np.mean([_contains(iqm_interval(sample), truth) for sample in disasters[:150]]) > 0.87


def _contains(interval: Interval, value: float) -> bool:
    low, high = ends(interval)
    return low <= value <= high


def test_a_summary_leaves_out_what_is_not_finite() -> None:
    result = summarized([1.0, np.nan, 3.0, np.inf, 8.0])
    assert (result.count, result.mean, result.median, result.min, result.max) == (3, 4.0, 3.0, 1.0, 8.0)
    assert result.std == pytest.approx(np.std([1, 3, 8], ddof=1))
    assert result.median_interval == Interval(None, None)


@pytest.mark.parametrize(("values", "count", "mean"), [([], 0, None), ([np.nan], 0, None), ([2.5], 1, 2.5)])
def test_a_summary_of_at_most_one_value_has_no_interval(values: list[float], count: int, mean: float | None) -> None:
    result = summarized(values)
    assert (result.count, result.mean, result.std, result.mean_interval) == (count, mean, None, Interval(None, None))


def test_only_an_interval_on_one_side_excludes_zero() -> None:
    intervals = [Interval(0.1, 2), Interval(-2, -0.1), Interval(-1, 1), Interval(None, None)]
    assert [interval.excludes_zero for interval in intervals] == [True, True, False, False]
