"""Summaries of episodes by policy and point, comparisons of two policies, and the tables and criteria of both.

Policies are compared over pairs of episodes of one seed at one point. Pairs of one seed at several points are not
independent; confidence intervals treat each seed as a cluster.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.episode import OUTCOMES, EpisodePlayer, EpisodeRecord, PlayedEpisodes
from mjrun.experiment import statistics
from mjrun.experiment.design import Design, DesignColumn
from mjrun.experiment.results_table import POINT, Requirements, ResultsTable, plain_metrics
from mjrun.experiment.statistics import NO_INTERVAL, Doubt, Interval, NumberSummary, Proportion
from mjrun.formats.study_reader import NO_UNITS
from mjrun.model.table_column import Column
from mjrun.options.evaluation import EvaluationOptions
from mjrun.probe.verdict import Verdict

FILES = ("episodes.parquet", "episodes.csv")
REWARD = "reward/"  # precedes the name of each term
SUCCESS, RETURN, LENGTH = "success", "return", "length"
IQM = "_iqm"  # follows a name: the interquartile mean
DIFFERENCE = "_difference"  # follows a name: the difference to the other policy
LOW, HIGH = "_low", "_high"  # follow a name: the ends of its interval
OWN = ("policy", "point", "episode", "seed", "return", "length", "steps", "ending", "outcome", "status", "message")


@dataclass(frozen=True)
class EndingCount:
    """The number of episodes that ended in one way.

    Attributes:
      ending: name of the termination.
      outcome: kind of the termination: success, failure or timeout.
      share: share of all episodes.
    """

    ending: str
    outcome: str
    share: Proportion


@dataclass(frozen=True)
class PolicySummary:
    """Summary of the episodes of one policy.

    Attributes:
      policy: name of the policy.
      episodes: number of episodes that did not fail; all other numbers are of these.
      failed: number of episodes that failed: a crash, a time limit, an action that is not finite.
      missing: number of episodes that are not played yet.
      returns: sums of all rewards.
      lengths: simulated times [s].
      success: share of episodes that ended as a success; None if no termination of the task is a success.
      endings: endings, the most frequent first.
      rewards: sums of each term of the reward.
      metrics: each metric over the episodes where it is finite.
    """

    policy: str
    episodes: int
    failed: int
    missing: int
    returns: NumberSummary
    lengths: NumberSummary
    success: Proportion | None
    endings: Sequence[EndingCount]
    rewards: Mapping[str, NumberSummary]
    metrics: Mapping[str, NumberSummary]


@dataclass(frozen=True)
class PairedDifference:
    """Paired difference between the first policy and the second.

    Attributes:
      difference: mean of the differences, or difference of the shares: the first's minus the second's; None without
        pairs.
      interval: Student's t interval of the mean of paired differences; for shares, Newcombe's interval for paired ones.
      better: name of the better policy; None if the interval contains 0.
      doubt: reason why the interval of a mean may be too narrow, as in `NumberSummary`.
      iqm: difference of the interquartile means; None without pairs, and for shares.
      iqm_interval: percentile interval of its bootstrap over pairs.
      first_wins, second_wins, ties: number of pairs in which the first, the second or neither is better.
    """

    difference: float | None
    interval: Interval
    better: str | None
    doubt: Doubt
    iqm: float | None
    iqm_interval: Interval
    first_wins: int
    second_wins: int
    ties: int


@dataclass(frozen=True)
class PolicyComparison:
    """Comparison of two policies on the same episodes.

    Attributes:
      first, second: names of the policies.
      pairs: number of episodes that both have played and that did not fail.
      returns: difference of returns.
      success: difference of success rates; None if no termination of the task is a success.
    """

    first: str
    second: str
    pairs: int
    returns: PairedDifference
    success: PairedDifference | None


@dataclass(frozen=True)
class PointSummary:
    """Summary of the episodes of one point.

    Attributes:
      point: number of the point.
      values: values of the point, by parameter.
      policies: summary of each policy's episodes.
      comparison: comparison of two policies at this point.
    """

    point: int
    values: Mapping[str, str]
    policies: Sequence[PolicySummary]
    comparison: PolicyComparison | None


@dataclass(frozen=True)
class EvaluationSummaries:
    """All summaries of an evaluation.

    Attributes:
      policies: summary of all episodes of each policy.
      comparison: comparison of two policies.
      points: summary of each point, if something varies.
    """

    policies: Sequence[PolicySummary]
    comparison: PolicyComparison | None
    points: Sequence[PointSummary]


def summaries(
    points: Design,
    player: EpisodePlayer,
    metrics: Sequence[str],
    policies: Sequence[Sequence[PlayedEpisodes]],
    confidence: float,
) -> EvaluationSummaries:
    """Summarizes the episodes that `policies`, one or two, have played at every point.

    Args:
      metrics: names of the metrics.
    """
    can_succeed = player.can_succeed or any(each.successes.any() for groups in policies for each in groups)

    def summary(groups: Sequence[PlayedEpisodes]) -> PolicySummary:
        episodes = [episode for group in groups for episode in group.episodes]
        names = list(dict.fromkeys(group.policy for group in groups))
        name = names[0] if len(names) == 1 else f"{len(names)} policies"
        return summary_of(name, episodes, player.rewards, metrics, confidence, can_succeed=can_succeed)

    def comparison(groups: Sequence[Sequence[PlayedEpisodes]]) -> PolicyComparison | None:
        return compared(groups[0], groups[1], confidence, can_succeed=can_succeed) if len(groups) == 2 else None

    by_point = list[PointSummary]()
    if points.names:
        for point, parts in enumerate(zip(*policies, strict=True)):
            groups = [[part] for part in parts]
            by_point.append(PointSummary(point, points.values(point), [*map(summary, groups)], comparison(groups)))
    return EvaluationSummaries([*map(summary, policies)], comparison(policies), by_point)


def summary_of(
    policy: str,
    episodes: Sequence[EpisodeRecord],
    rewards: Sequence[str],
    metrics: Sequence[str],
    confidence: float,
    *,
    can_succeed: bool,
) -> PolicySummary:
    """Summarizes `episodes` of a policy.

    Args:
      rewards, metrics: names of terms of the reward and of metrics.
      can_succeed: whether a termination of the task is a success.
    """
    requested, missing = len(episodes), sum(episode.status == "missing" for episode in episodes)
    episodes = [episode for episode in episodes if episode.status == "ok"]
    seeds = [episode.seed for episode in episodes]

    def summary(values: Sequence[float]) -> NumberSummary:
        return statistics.summarized(values, confidence, seeds)

    def share_of(cases: Sequence[bool]) -> Proportion:
        return statistics.share(cases, confidence, seeds)

    outcomes = {episode.ending: episode.outcome for episode in episodes}
    endings = [
        EndingCount(ending, outcome, share_of([episode.ending == ending for episode in episodes]))
        for ending, outcome in outcomes.items()
    ]
    succeeded = [episode.outcome == OUTCOMES[0] for episode in episodes]

    return PolicySummary(
        policy=policy,
        episodes=len(episodes),
        failed=requested - len(episodes) - missing,
        missing=missing,
        returns=summary([episode.total for episode in episodes]),
        lengths=summary([episode.length for episode in episodes]),
        success=share_of(succeeded) if can_succeed else None,
        endings=sorted(endings, key=lambda each: -each.share.count),
        rewards={name: summary([episode.rewards.get(name, math.nan) for episode in episodes]) for name in rewards},
        metrics={name: summary([episode.metrics[i] for episode in episodes]) for i, name in enumerate(metrics)},
    )


def doubts(
    policies: Sequence[PolicySummary], comparison: PolicyComparison | None, confidence: float, seeds: int
) -> list[str]:
    """Returns for each policy a sentence about the interval of the mean return, or an empty text if it is reliable.

    A last sentence concerns the difference of two policies.

    Args:
      seeds: number of seeds, each of which has an episode at every point.
    """
    texts = [
        _doubt(each.returns.doubt, each.returns.count, "the mean", "episodes", confidence, seeds) for each in policies
    ]
    if comparison:
        doubt, pairs = comparison.returns.doubt, comparison.pairs
        texts.append(_doubt(doubt, pairs, "the mean difference", "pairs of episodes", confidence, seeds))
    return texts


def _doubt(doubt: Doubt, count: int, mean: str, cases: str, confidence: float, seeds: int) -> str:
    start = f"the {100 * confidence:g} % interval of {mean} may be too narrow"
    if doubt == "few":
        count, independent = (seeds, "seeds") if count > seeds else (count, cases)  # episodes of a seed are one case
        absent, rare = (1 - statistics.RARE) ** count, f"{100 * statistics.RARE:g} %"
        return (
            f"{start}: {100 * absent:.2g} % of samples of {count} {independent} lack an event of a probability of "
            f"{rare}; {statistics.enough_cases()} {independent} are enough for it"
        )
    if doubt == "skewed":
        return (
            f"{start}, since a few extreme {cases} decide it; the interquartile mean does not depend on them, and more "
            "episodes make both intervals reliable"
        )
    return ""


def compared(
    ours: Sequence[PlayedEpisodes], theirs: Sequence[PlayedEpisodes], confidence: float, *, can_succeed: bool
) -> PolicyComparison:
    """Compares two policies whose episodes are in the same order, over the pairs of which neither failed."""
    names = ours[0].policy, theirs[0].policy
    returns = [np.concatenate([group.returns for group in groups]) for groups in (ours, theirs)]
    successes = [np.concatenate([group.successes for group in groups]) for groups in (ours, theirs)]
    seeds = np.array([episode.seed for group in ours for episode in group.episodes])
    is_pair = np.concatenate([group.is_completed for group in ours])
    is_pair &= np.concatenate([group.is_completed for group in theirs])
    seeds = seeds[is_pair]
    first, second = (values[is_pair] for values in successes)
    share_interval = statistics.paired_share_interval(first, second, confidence, seeds)
    success = _difference(names, first.astype(float) - second, share_interval)
    return PolicyComparison(
        *names,
        pairs=len(seeds),
        returns=_difference_of_returns(names, returns[0][is_pair], returns[1][is_pair], confidence, seeds),
        success=success if can_succeed else None,
    )


def _difference_of_returns(
    names: tuple[str, str], ours: np.ndarray, theirs: np.ndarray, confidence: float, seeds: np.ndarray
) -> PairedDifference:
    is_finite = np.isfinite(ours) & np.isfinite(theirs)
    ours, theirs, seeds = ours[is_finite], theirs[is_finite], seeds[is_finite]
    differences = ours - theirs
    plain = _difference(names, differences, statistics.mean_interval(differences, confidence, seeds))
    if not len(differences):
        return plain
    return replace(
        plain,
        doubt=statistics.doubt(differences, seeds),
        iqm=statistics.interquartile_mean(ours) - statistics.interquartile_mean(theirs),
        iqm_interval=statistics.iqm_difference_interval(ours, theirs, confidence, seeds),
    )


def _difference(names: tuple[str, str], differences: np.ndarray, interval: Interval) -> PairedDifference:
    mean = float(differences.mean()) if len(differences) else None
    better = (names[0] if mean > 0 else names[1]) if mean is not None and interval.excludes_zero else None
    wins = [int(np.count_nonzero(side)) for side in (differences > 0, differences < 0, differences == 0)]
    return PairedDifference(mean, interval, better, "", None, NO_INTERVAL, *wins)


def episode_table(
    groups: Sequence[PlayedEpisodes],
    points: Design,
    rewards: Sequence[str],
    metrics: Sequence[str],
    units: Mapping[str, str] = NO_UNITS,
    *,
    compared: bool,
) -> ResultsTable:
    """Returns the table of episodes in the order of policies, points and seeds.

    Args:
      points: parameters that vary; one point without values if nothing varies.
      rewards, metrics: names of terms of the reward and of metrics.
      units: units of parameters and metrics, by name.
      compared: whether a column names the policy.
    """
    table = ResultsTable()
    episodes = [episode for group in groups for episode in group.episodes]
    where = [group.point for group in groups for _ in group.episodes]

    def add(column: Column, value: Callable[[EpisodeRecord], float]) -> None:
        table.add(column, [value(episode) for episode in episodes])

    if compared:
        table.add_texts("policy", [group.policy for group in groups for _ in group.episodes], "who played")
    if points.names:
        table.add(POINT, where)
    table.add_parameters(points, where, units)
    order = [index for group in groups for index in range(len(group.episodes))]
    table.add(Column("episode", meaning="number of the episode", integer=True), order)
    seeds = seed_column([episode.seed for episode in episodes])
    table.add_values(Column("seed", meaning="of all that is random in it", integer=True), seeds, slice(None))
    add(Column("return", meaning="sum of all rewards"), lambda episode: episode.total)
    add(Column("length", "s", "simulated time"), lambda episode: episode.length)
    add(Column("steps", meaning="control periods", integer=True), lambda episode: episode.steps)
    table.add_texts("ending", [episode.ending for episode in episodes], "how it ended")
    table.add_texts("outcome", [episode.outcome for episode in episodes], "what that means")
    for name in rewards:
        sums = [episode.rewards.get(name, math.nan) for episode in episodes]
        table.add(Column(f"{REWARD}{name}", meaning="sum of a term of the reward"), sums)
    for index, name in enumerate(metrics):
        table.add(Column(name, units.get(name, ""), "metric"), [episode.metrics[index] for episode in episodes])
    table.add_texts("status", [episode.status for episode in episodes], "whether it failed")
    table.add_texts("message", [episode.message for episode in episodes], "why it failed")
    return table


def seed_column(seeds: Sequence[int]) -> DesignColumn:
    """Returns the seeds of episodes, which are not numbers where a float would round one."""
    return DesignColumn.of([*map(str, seeds)], np.arange(len(seeds)))


def point_table(
    design: Design, points: Sequence[PointSummary], units: Mapping[str, str] = NO_UNITS
) -> tuple[ResultsTable, dict[str, str]]:
    """Returns the table of points in the form of a study, for `mjrun plot`, and the meaning of each metric in it.

    The ends of intervals come last, so that they are not metrics themselves.

    Args:
      units: units of parameters and metrics, by name.
    """
    units = {**units, LENGTH: "s"}
    measured = [measures(point.policies[0], point.comparison) for point in points]
    meanings = {name: measure.meaning for name, measure in measured[0].items()}
    table = ResultsTable()
    table.add(POINT, range(len(points)))
    table.add_parameters(design, units=units)
    for name in meanings:
        table.add(Column(name, units.get(name, ""), "metric"), [_number(each[name].value) for each in measured])
    table.add_texts("status", ["ok" if point.policies[0].episodes else "failed" for point in points])
    for name in meanings:
        intervals = [each[name].interval for each in measured]
        ends = ((LOW, [each.low for each in intervals]), (HIGH, [each.high for each in intervals]))
        for end, values in ends:
            meaning = f"{end.removeprefix('_')} end of the interval of {name}"
            table.add(Column(name + end, units.get(name, ""), meaning), [*map(_number, values)])
    return table, meanings


@dataclass(frozen=True)
class Estimate:
    """An estimate from several episodes: its value, its meaning and its interval."""

    value: float | None
    meaning: str
    interval: Interval


def names_beside_metrics(metrics: Sequence[str]) -> list[str]:
    """Returns the names of the estimates that are not metrics, and of the ends of the intervals of all estimates."""
    own = [SUCCESS, RETURN, RETURN + IQM, LENGTH]
    own += [name + DIFFERENCE for name in (RETURN, SUCCESS, RETURN + IQM)]
    return [*own, *(name + end for name in (*own, *metrics) for end in (LOW, HIGH))]


def measures(summary: PolicySummary, comparison: PolicyComparison | None) -> dict[str, Estimate]:
    """Returns the numbers of a policy's episodes, by name."""
    made = dict[str, Estimate]()
    if summary.success:
        made[SUCCESS] = Estimate(summary.success.share, "share of episodes", summary.success.interval)
    for name, each in {RETURN: summary.returns, LENGTH: summary.lengths, **summary.metrics}.items():
        made[name] = Estimate(each.mean, "mean over the episodes", each.mean_interval)
        if name == RETURN:
            made[name + IQM] = Estimate(each.iqm, "interquartile mean over the episodes", each.iqm_interval)
    if comparison:
        for name, each in ((RETURN, comparison.returns), (SUCCESS, comparison.success)):
            if each:
                made[name + DIFFERENCE] = Estimate(each.difference, "to the other policy, paired", each.interval)
        meaning, returns = "of interquartile means to the other policy", comparison.returns
        made[RETURN + IQM + DIFFERENCE] = Estimate(returns.iqm, meaning, returns.iqm_interval)
    return made


def _number(value: float | None) -> float:
    return math.nan if value is None else value


class PassCriteria:
    """Requirements and thresholds of an evaluation, whose names are checked before anything is played.

    Args:
      numbers: names of the numeric columns that the table of episodes will have.
      endings: names that endings can have; each is a column of ones and zeros, as is each outcome.
      can_succeed: whether a termination of the task is a success.

    Raises:
      UsageError: a requirement is malformed, or contains an unknown name.
    """

    def __init__(
        self, options: EvaluationOptions, numbers: Sequence[str], endings: Sequence[str], *, can_succeed: bool
    ) -> None:
        self._flags = [name for name in dict.fromkeys([*OUTCOMES, *endings]) if name not in numbers]
        self._requirements = Requirements(options.require, numbers, self._flags)

        self._thresholds = {name: least for name, (least,) in options.fail_below.items()}
        means = [
            RETURN,
            RETURN + IQM,
            LENGTH,
            *(name for name, _ in plain_metrics(options.metric)),
            *([SUCCESS] if can_succeed else []),
        ]
        is_compared = options.compare is not None
        differences = [
            f"{name}{DIFFERENCE}" for name in (RETURN, RETURN + IQM, SUCCESS) if is_compared and name in means
        ]
        valid = [name + end for name in [*means, *differences] for end in ("", LOW)]
        for name, least in self._thresholds.items():
            with concerning("fail_below", name):
                if name == SUCCESS and not can_succeed:
                    raise UsageError(f"{option('fail_below')} {name}: no termination of the task is a success")
                if name not in valid:
                    raise UnknownNameError("number", name, valid, where=option("fail_below"))
                if name in (SUCCESS, SUCCESS + LOW) and least > 1:
                    raise BadValueError(option("fail_below"), f"{name}={least:g}", "a share, such as 90% or 0.9")

    def verdicts(
        self, table: ResultsTable, count: int, summary: PolicySummary, comparison: PolicyComparison | None
    ) -> list[Verdict]:
        """Returns whether each requirement and each threshold holds for the episodes that did not fail.

        Args:
          table: table of episodes; the first `count` rows are those of the evaluated policy.
        """
        rows = np.flatnonzero(table.flags("status", ["ok"])["ok"][:count])
        endings = [flag for flag in self._flags if flag not in OUTCOMES]
        outcomes = [flag for flag in self._flags if flag in OUTCOMES]
        columns = {**table.flags("ending", endings), **table.flags("outcome", outcomes), **table.numbers}
        verdicts = self._requirements.verdicts({name: values[rows] for name, values in columns.items()})
        made = measures(summary, comparison)
        known = {name: each.value for name, each in made.items()}
        known |= {name + LOW: each.interval.low for name, each in made.items()}
        for name, least in self._thresholds.items():
            text, value = f"{name} >= {least:g}", known.get(name)
            reason = "there are too few episodes to compute it" if value is None else f"it is {value:.6g}"
            verdicts.append(Verdict(text, value is not None and value >= least, f"{clean(text)}: {reason}", len(rows)))
        return verdicts
