"""Tables of an evaluation, of episodes and of points, and requirements on them."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.episode import OUTCOMES, EpisodeRecord, PlayedEpisodes
from mjrun.evaluation.summaries import EpisodeSummary, PointSummary, PolicyComparison
from mjrun.experiment.design import Design
from mjrun.experiment.design_points import DesignColumn
from mjrun.experiment.results_table import POINT, Requirements, ResultsTable, plain_metrics
from mjrun.experiment.statistics import Interval
from mjrun.formats.study_reader import NO_UNITS
from mjrun.model.table_column import Column
from mjrun.options.evaluation import EvaluationOptions
from mjrun.probe.verdict import Verdict

FILES = ("episodes.parquet", "episodes.csv")
REWARD = "reward/"  # precedes the name of each term
SUCCESS, RETURN, LENGTH = "success", "return", "length"
IQM = "_iqm"  # follows a name: the interquartile mean
DIFFERENCE = "_difference"  # follows a name: the difference to the other policy
LOW = "_low"  # follows a name: the lower end of its interval
OWN = ("policy", "point", "episode", "seed", "return", "length", "steps", "ending", "outcome", "status", "message")


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
      units: units of metrics, by name.
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
    table.add_parameters(points, where)
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
      units: units of metrics, by name.
    """
    units = {**units, LENGTH: "s"}
    measured = [measures(point.policies[0], point.comparison) for point in points]
    meanings = {name: measure.meaning for name, measure in measured[0].items()}
    table = ResultsTable()
    table.add(POINT, range(len(points)))
    table.add_parameters(design)
    for name in meanings:
        table.add(Column(name, units.get(name, ""), "metric"), [_number(each[name].value) for each in measured])
    table.add_texts("status", ["ok" if point.policies[0].episodes else "failed" for point in points])
    for name in meanings:
        intervals = [each[name].interval for each in measured]
        ends = (("low", [each.low for each in intervals]), ("high", [each.high for each in intervals]))
        for end, values in ends:
            meaning = f"{end} end of the interval of {name}"
            table.add(Column(f"{name}_{end}", units.get(name, ""), meaning), [*map(_number, values)])
    return table, meanings


@dataclass(frozen=True)
class Measure:
    """A number of several episodes, with its meaning and its interval."""

    value: float | None
    meaning: str
    interval: Interval


def measures(summary: EpisodeSummary, comparison: PolicyComparison | None) -> dict[str, Measure]:
    """Returns the numbers of a policy's episodes, by name."""
    made = dict[str, Measure]()
    if summary.success:
        made[SUCCESS] = Measure(summary.success.share, "share of episodes", summary.success.interval)
    for name, each in {RETURN: summary.returns, LENGTH: summary.lengths, **summary.metrics}.items():
        made[name] = Measure(each.mean, "mean over the episodes", each.mean_interval)
        if name == RETURN:
            made[name + IQM] = Measure(each.iqm, "interquartile mean over the episodes", each.iqm_interval)
    if comparison:
        for name, each in ((RETURN, comparison.returns), (SUCCESS, comparison.success)):
            if each:
                made[name + DIFFERENCE] = Measure(each.difference, "to the other policy, paired", each.interval)
        meaning, returns = "of interquartile means to the other policy", comparison.returns
        made[RETURN + IQM + DIFFERENCE] = Measure(returns.iqm, meaning, returns.iqm_interval)
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
        for name in self._thresholds:
            with concerning("fail_below", name):
                if name == SUCCESS and not can_succeed:
                    raise UsageError(f"{option('fail_below')} {name}: no termination of the task is a success")
                if name not in valid:
                    raise UnknownNameError("number", name, valid, where=option("fail_below"))

    def verdicts(
        self, table: ResultsTable, count: int, summary: EpisodeSummary, comparison: PolicyComparison | None
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
