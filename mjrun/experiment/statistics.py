"""Means, medians, shares and their differences, each with a confidence interval; the same numbers have the same ones.

Sources: E. B. Wilson, JASA 22 (1927) 209, for a share; Student's t for a mean and for the mean of paired differences;
order statistics for a median; the bootstrap for an interquartile mean, as R. Agarwal et al., NeurIPS 34 (2021) 29304,
recommend; W. G. Cochran, Sampling Techniques (1977) 2.15, for the number of cases that a skewed mean needs; R. G.
Newcombe, Statistics in Medicine 17 (1998) 2635, method 10, for the difference of paired shares.

Episodes of one seed at several points are not independent: they form a cluster. A mean then has the variance of the
sums of clusters, and counts are divided by their design effect (J. N. K. Rao and A. J. Scott, Biometrics 48 (1992)
577), which is limited here to between 1 and the size of a cluster. The bootstrap draws clusters: each resample has the
same seeds at every point, and equally many episodes.

Sensitivity of metrics to parameters, from the points of `mjrun.experiment.samplers`: A. Saltelli et al., Computer
Physics Communications 181 (2010) 259, for the estimators of Sobol' indices; F. Campolongo et al., Environmental
Modelling & Software 22 (2007) 1509, for the mean magnitude μ* of elementary effects. An index has an interval: of the
bootstrap over samples, or Student's for means of elementary effects.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.experiment.results_table import ResultsTable
from mjrun.experiment.samplers import SAMPLES, STEP
from mjrun.formats.study_reader import SENSITIVITY
from mjrun.model.table_column import Column

CONFIDENCE = 0.95
TRIMMED = 0.25  # share of the cases at each end that an interquartile mean leaves out
RESAMPLES = 2000  # of the bootstrap
FEWEST_RESAMPLES = 400  # of the bootstrap of many cases, whose interval is narrow
DRAWN = 4_000_000  # most cases in all resamples, unless they are the fewest
BLOCK = 2**17  # cases that are drawn at once: they fit into a cache, and need a few MiB
RARE = 0.1  # probability of a case that decides a mean, such as a crash of a robot
FEWEST_SAMPLES = 2  # for an index
SENSITIVITY_FILES = (SENSITIVITY, "sensitivity.csv")


@dataclass(frozen=True)
class Interval:
    """A confidence interval.

    Attributes:
      low, high: ends of the interval; None if there are too few cases for one.
    """

    low: float | None
    high: float | None

    @property
    def excludes_zero(self) -> bool:
        """True if 0 lies outside of the interval."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)


NO_INTERVAL = Interval(None, None)


@dataclass(frozen=True)
class NumberSummary:
    """Summary of a number that each episode has.

    Attributes:
      count: number of episodes where it is finite.
      mean, std: mean and standard deviation over these; `std` estimates that of the population, with n − 1. None if
        there are too few.
      mean_interval: Student's t interval of the mean.
      doubt: reason why that interval may cover the mean less often than the confidence: `few`, too few cases to contain
        one of a probability of 10 %; `skewed`, too few for their skewness; empty without such a reason.
      iqm: interquartile mean: mean without the lowest and the highest quarter, which extreme cases do not change.
      iqm_interval: percentile interval of its bootstrap.
      median: median over these.
      median_interval: interval from order statistics, whose coverage is at least the confidence for any distribution;
        undefined for fewer than 6 episodes at 95 %.
      min, max: extremes over these.
    """

    count: int
    mean: float | None
    std: float | None
    mean_interval: Interval
    doubt: "Doubt"
    iqm: float | None
    iqm_interval: Interval
    median: float | None
    median_interval: Interval
    min: float | None
    max: float | None


@dataclass(frozen=True)
class Proportion:
    """Share of the cases in which something holds.

    Attributes:
      count: number of cases in which it holds.
      of: number of all cases.
      share: `count / of`; None without cases.
      interval: Wilson's score interval.
    """

    count: int
    of: int
    share: float | None
    interval: Interval


Doubt = Literal["", "few", "skewed"]
Clusters = Sequence[int] | np.ndarray | None  # cluster of each case `(n,)`; None if cases are independent


def summarized(
    values: Sequence[float] | np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None
) -> NumberSummary:
    """Summarizes the finite ones of `values` `(n,)`."""
    numbers = np.asarray(values, float)
    is_good = np.isfinite(numbers)
    good = numbers[is_good]
    clusters = None if clusters is None else np.asarray(clusters)[is_good]
    if not len(good):
        return NumberSummary(0, None, None, NO_INTERVAL, "", None, NO_INTERVAL, None, NO_INTERVAL, None, None)
    return NumberSummary(
        count=len(good),
        mean=float(good.mean()),
        std=float(good.std(ddof=1)) if len(good) > 1 else None,
        mean_interval=mean_interval(good, confidence, clusters),
        doubt=doubt(good, clusters),
        iqm=interquartile_mean(good),
        iqm_interval=iqm_interval(good, confidence, clusters),
        median=float(np.median(good)),
        median_interval=median_interval(good, confidence, clusters),
        min=float(good.min()),
        max=float(good.max()),
    )


def mean_interval(values: np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None) -> Interval:
    """Returns Student's t interval of the mean of `values` `(n,)`; undefined for fewer than two cases or clusters."""
    from scipy.special import stdtrit

    members = _members(len(values), clusters)
    count = int(members.max(initial=-1)) + 1
    if count < 2:
        return NO_INTERVAL
    mean = float(values.mean())
    half = float(stdtrit(count - 1, (1 + confidence) / 2)) * math.sqrt(_variance_of_mean(values, members))
    return Interval(mean - half, mean + half)


@dataclass(frozen=True)
class GroupMeans:
    """Means of groups of cases, with Student's t intervals: arrays `(groups,)`.

    Attributes:
      count: number of finite cases.
      mean: NaN without any.
      std: standard deviation of the population, estimated with n − 1; NaN for fewer than two.
      low, high: ends of the interval; NaN for fewer than two.
    """

    count: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    low: np.ndarray
    high: np.ndarray


def group_means(values: np.ndarray, groups: np.ndarray, count: int, confidence: float = CONFIDENCE) -> GroupMeans:
    """Returns the means of many groups of cases at once.

    Args:
      values: number of each case `(n,)`; those that are not finite are left out.
      groups: number of the group of each case `(n,)`, from 0.
      count: number of groups.
    """
    from scipy.special import stdtrit

    is_good = np.isfinite(values)
    values, groups = values[is_good], groups[is_good]
    sizes = np.bincount(groups, minlength=count)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(groups, values, count) / sizes
        squares = np.bincount(groups, (values - mean[groups]) ** 2, count)
        std = np.where(sizes > 1, np.sqrt(squares / (sizes - 1)), np.nan)
        half = stdtrit(np.maximum(sizes - 1, 1), (1 + confidence) / 2) * std / np.sqrt(sizes)
    return GroupMeans(sizes, mean, std, mean - half, mean + half)


def doubt(values: np.ndarray, clusters: Clusters = None) -> Doubt:
    """Returns a reason to doubt Student's interval of the mean of `values` `(n,)`; empty if they are all equal.

    Cases that no sample contains cannot be seen in it: below 29 cases, one of a probability of 10 % is absent from more
    than 5 % of samples. Above, Cochran's rule asks for 25 times the square of the skewness.
    """
    members = _members(len(values), clusters)
    means = np.bincount(members, values) / np.bincount(members)
    deviations = means - float(means.mean())
    spread = float(means.std())
    if spread <= 1e-12 * float(np.abs(means).max()):
        return ""
    if (1 - RARE) ** len(means) > 1 - CONFIDENCE:
        return "few"
    skewness = float(np.power(deviations / spread, 3).mean())
    return "skewed" if len(means) < 25 * skewness**2 else ""


def enough_cases() -> int:
    """Returns the number of cases from which on `doubt` does not call them few."""
    return math.ceil(math.log(1 - CONFIDENCE) / math.log(1 - RARE))


def interquartile_mean(values: np.ndarray) -> float:
    """Returns the mean of `values` `(n,)`, n > 0, without the lowest and the highest quarter."""
    cut = int(TRIMMED * len(values))
    return float(np.sort(values)[cut : len(values) - cut].mean())


def iqm_interval(values: np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None) -> Interval:
    """Returns the percentile interval of the bootstrap of the interquartile mean of `values` `(n,)`.

    A resample draws clusters with replacement. Undefined for fewer than two cases or clusters.
    """
    cases = np.sort(values) if clusters is None else values  # so that their order makes no difference
    return percentile_interval(_resampled_iqms(cases, clusters), confidence)


def iqm_difference_interval(
    ours: np.ndarray, theirs: np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None
) -> Interval:
    """Returns the interval of the difference of two interquartile means over the same cases, of `ours` − of `theirs`.

    It is the percentile interval of a bootstrap whose resamples draw pairs of `(n,)` cases, or clusters of pairs.
    """
    return percentile_interval(_resampled_iqms(ours, clusters) - _resampled_iqms(theirs, clusters), confidence)


def percentile_interval(resampled: np.ndarray, confidence: float = CONFIDENCE) -> Interval:
    """Returns the percentile interval of a bootstrap: of numbers of its resamples `(n,)`; undefined without any."""
    if not len(resampled):
        return NO_INTERVAL
    low, high = np.quantile(resampled, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Interval(float(low), float(high))


def _resampled_iqms(values: np.ndarray, clusters: Clusters) -> np.ndarray:
    """Returns the interquartile mean of each resample of `values` `(n,)`; empty for fewer than two cases or clusters.

    All values of the same number and clusters have the same resamples.
    """
    members = _members(len(values), clusters)
    count = int(members.max(initial=-1)) + 1
    if count < 2:
        return np.zeros(0)
    order = np.argsort(values, kind="stable")
    ordered, members = values[order], members[order]
    resamples = resamples_of(len(values))
    generator, means = np.random.default_rng(0), list[np.ndarray]()
    block = max(1, BLOCK // len(values))
    for start in range(0, resamples, block):
        rows = min(block, resamples - start)
        drawn = generator.integers(count, size=(rows, count)) + count * np.arange(rows)[:, None]
        times = np.bincount(drawn.ravel(), minlength=rows * count).reshape(rows, count)
        ranks = np.cumsum(times[:, members], axis=1, dtype=float)  # highest rank of each value, which may occur often
        size = ranks[:, -1:]
        cut = np.floor(TRIMMED * size)
        kept = np.diff(np.clip(ranks, cut, size - cut), axis=1, prepend=cut)
        means.append(kept @ ordered / (size - 2 * cut)[:, 0])
    return np.concatenate(means)


def resamples_of(count: int) -> int:
    """Returns the number of resamples in the bootstrap of `count` cases."""
    return max(FEWEST_RESAMPLES, min(RESAMPLES, DRAWN // count))


def median_interval(values: np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None) -> Interval:
    """Returns the narrowest symmetric pair of order statistics of `values` `(n,)` that covers the median.

    A cluster counts as one case.
    """
    from scipy.special import bdtr

    count = int(_members(len(values), clusters).max(initial=-1)) + 1
    ranks = np.arange(count // 2)
    tails = bdtr(ranks.astype(float), count, 0.5)  # probability that at most `rank` values are below the median
    fitting = ranks[tails <= (1 - confidence) / 2]
    if not len(fitting):
        return NO_INTERVAL
    ordered, rank = np.sort(values), int(fitting[-1]) * len(values) // count
    return Interval(float(ordered[rank]), float(ordered[len(values) - 1 - rank]))


def share(cases: Sequence[bool] | np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None) -> Proportion:
    """Returns the share of true `cases` `(n,)`."""
    holds = np.asarray(cases, bool)
    count, of = int(np.count_nonzero(holds)), len(holds)
    if not of:
        return Proportion(0, 0, None, NO_INTERVAL)
    effect = _design_effect(holds.astype(float), _members(of, clusters))
    return Proportion(count, of, count / of, wilson_interval(count / effect, of / effect, confidence))


def wilson_interval(count: float, of: float, confidence: float = CONFIDENCE) -> Interval:
    """Returns Wilson's score interval of the share `count / of`."""
    from statistics import NormalDist

    z = NormalDist().inv_cdf((1 + confidence) / 2)
    share, weight = count / of, z * z / of
    centre = (share + weight / 2) / (1 + weight)
    half = z / (1 + weight) * math.sqrt(share * (1 - share) / of + weight / (4 * of))
    low = 0.0 if count == 0 else max(0.0, centre - half)
    return Interval(low, 1.0 if count == of else min(1.0, centre + half))


def paired_share_interval(
    ours: np.ndarray, theirs: np.ndarray, confidence: float = CONFIDENCE, clusters: Clusters = None
) -> Interval:
    """Returns the interval of the difference of two shares over the same cases, of `ours` − of `theirs`, bool `(n,)`.

    Newcombe's method 10 combines the distances of both Wilson intervals from their shares like those of correlated
    estimates. The interval stays within −1 and 1, and is defined for any number of cases but zero.
    """
    if not len(ours):
        return NO_INTERVAL
    effect = _design_effect(ours.astype(float) - theirs, _members(len(ours), clusters))
    cases = (ours & theirs, ours & ~theirs, ~ours & theirs, ~ours & ~theirs)
    both, only_ours, only_theirs, neither = (int(np.count_nonzero(case)) / effect for case in cases)
    of = len(ours) / effect
    first, second = (both + only_ours) / of, (both + only_theirs) / of
    wilson = [wilson_interval(count, of, confidence) for count in (both + only_ours, both + only_theirs)]
    correlation = _correlation(both, only_ours, only_theirs, neither)

    def distance(a: float, b: float) -> float:
        return math.sqrt(max(0.0, a * a - 2 * correlation * a * b + b * b))

    (low1, high1), (low2, high2) = ((each.low or 0.0, each.high or 0.0) for each in wilson)
    difference = first - second
    below = distance(first - low1, high2 - second)
    above = distance(high1 - first, second - low2)
    return Interval(max(-1.0, difference - below), min(1.0, difference + above))


def _correlation(both: float, only_ours: float, only_theirs: float, neither: float) -> float:
    """Returns the correlation of the pairs, corrected for continuity where positive as in Newcombe's method 10."""
    margins = (both + only_ours) * (only_theirs + neither) * (both + only_theirs) * (only_ours + neither)
    if margins == 0:
        return 0.0
    excess, half = both * neither - only_ours * only_theirs, (both + only_ours + only_theirs + neither) / 2
    corrected = max(excess - half, 0.0) if excess > 0 else excess
    return corrected / math.sqrt(margins)


def _members(count: int, clusters: Clusters) -> np.ndarray:
    """Returns the number of the cluster of each case `(n,)`, from 0; each independent case is a cluster."""
    return np.arange(count) if clusters is None else np.unique(np.asarray(clusters), return_inverse=True)[1]


def _variance_of_mean(values: np.ndarray, members: np.ndarray) -> float:
    """Returns the variance of the mean of `values` `(n,)`, which may depend on each other within a cluster."""
    sums = np.bincount(members, values - values.mean())
    return len(sums) / (len(sums) - 1) * float(sums @ sums) / len(values) ** 2


def _design_effect(values: np.ndarray, members: np.ndarray) -> float:
    """Returns the ratio of the variance of the mean of `values` `(n,)` to that of independent values.

    Where it cannot be estimated, each cluster counts as one case, which is the upper limit.
    """
    cases, count = len(values), int(members.max()) + 1
    if cases == count:
        return 1.0
    independent = _variance_of_mean(values, np.arange(cases))
    if count < 2 or independent == 0:
        return cases / count
    return min(max(_variance_of_mean(values, members) / independent, 1.0), cases / count)


# --- sensitivity to parameters -----------------------------------------------------------------------


@dataclass(frozen=True)
class SensitivityIndex:
    """A sensitivity index with its confidence interval.

    Attributes:
      value: index; None if it is undefined, as for a constant metric.
      interval: its confidence interval.
    """

    value: float | None
    interval: Interval


@dataclass(frozen=True)
class MetricSensitivity:
    """The sensitivity of a metric to a parameter.

    Attributes:
      metric, parameter: their names.
      samples: number of samples without a failed point.
      indices: estimates by name. `saltelli` gives `first`, the share of the variance that the parameter explains alone,
        and `total`, with its interactions; `morris` gives `mu_star`, the mean magnitude of elementary effects, and
        `sigma`, their standard deviation.
    """

    metric: str
    parameter: str
    samples: int
    indices: Mapping[str, SensitivityIndex]


def sobol_indices(values: np.ndarray, confidence: float) -> list[dict[str, SensitivityIndex]]:
    """Returns the Sobol' indices of each parameter.

    Args:
      values: a number of each point of `saltelli` `(samples, parameters + 2)`, all finite.
    """
    samples = len(values)
    generator = np.random.default_rng(0)
    drawn = [_first_and_total(values[generator.integers(samples, size=samples)]) for _ in range(resamples_of(samples))]
    first, total = (np.array(each) for each in zip(*drawn, strict=True))
    made = _first_and_total(values)
    return [
        {
            "first": _bootstrapped(made[0][index], first[:, index], confidence),
            "total": _bootstrapped(made[1][index], total[:, index], confidence),
        }
        for index in range(values.shape[1] - 2)
    ]


def elementary_effects(
    values: np.ndarray, fractions: np.ndarray, confidence: float
) -> list[dict[str, SensitivityIndex]]:
    """Returns the mean magnitude and the standard deviation of the elementary effects of each parameter.

    Args:
      values: a number of each point of `morris` `(trajectories, parameters + 1)`, all finite.
      fractions: the points `(trajectories, parameters + 1, parameters)`.
    """
    signs = np.sign(np.diff(fractions, axis=1))  # not zero for the one parameter that changes
    effects = np.einsum("ts,tsp->tp", np.diff(values, axis=1), signs) / STEP
    return [
        {
            "mu_star": SensitivityIndex(float(np.abs(each).mean()), mean_interval(np.abs(each), confidence)),
            "sigma": SensitivityIndex(float(each.std(ddof=1)), NO_INTERVAL),
        }
        for each in effects.T
    ]


def _first_and_total(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first and total indices of parameters, `(parameters,)` each, NaN if all values are equal."""
    values = values - values[:, :2].mean()
    a, b, mixed = values[:, :1], values[:, 1:2], values[:, 2:]
    variance = float(values[:, :2].var())
    if variance == 0:
        nothing = np.full(mixed.shape[1], np.nan)
        return nothing, nothing
    return (b * (mixed - a)).mean(axis=0) / variance, 0.5 * ((a - mixed) ** 2).mean(axis=0) / variance


def _bootstrapped(value: float, drawn: np.ndarray, confidence: float) -> SensitivityIndex:
    if not np.isfinite(value):
        return SensitivityIndex(None, NO_INTERVAL)
    return SensitivityIndex(float(value), percentile_interval(drawn[np.isfinite(drawn)], confidence))


def sensitivities(
    sampler: str,
    parameters: Sequence[str],
    metrics: Mapping[str, np.ndarray | Sequence[float]],
    confidence: float,
    seed: int,
) -> list[MetricSensitivity]:
    """Returns the sensitivity of each metric to each parameter.

    Args:
      sampler: `saltelli` or `morris`.
      metrics: values of each metric `(n,)`, by name; a sample with a value that is not finite is left out.
      seed: seed of the design.
    """
    draw, more = SAMPLES[sampler]
    size, made = len(parameters) + more, list[MetricSensitivity]()
    for name, numbers in metrics.items():
        values = np.asarray(numbers, float).reshape(-1, size)
        usable = np.isfinite(values).all(axis=1)
        count = int(np.count_nonzero(usable))
        if count < FEWEST_SAMPLES:
            continue
        if sampler == "saltelli":
            indices = sobol_indices(values[usable], confidence)
        else:
            fractions = draw(len(values), len(parameters), np.random.default_rng(seed))
            indices = elementary_effects(values[usable], fractions.reshape(-1, size, size - 1)[usable], confidence)
        made += [
            MetricSensitivity(name, parameter, count, each) for parameter, each in zip(parameters, indices, strict=True)
        ]
    return made


def sensitivity_table(made: Sequence[MetricSensitivity]) -> ResultsTable:
    """Returns a table with a row for each metric and parameter."""
    table = ResultsTable()
    table.add_texts("metric", [each.metric for each in made])
    table.add_texts("parameter", [each.parameter for each in made])
    table.add(
        Column("samples", meaning="samples without a failed point", integer=True), [each.samples for each in made]
    )
    for name in made[0].indices:
        estimates = [each.indices[name] for each in made]
        columns = {
            name: [each.value for each in estimates],
            f"{name}_low": [each.interval.low for each in estimates],
            f"{name}_high": [each.interval.high for each in estimates],
        }
        for column, values in columns.items():
            if any(value is not None for value in values):
                table.add(Column(column), [np.nan if value is None else value for value in values])
    return table
