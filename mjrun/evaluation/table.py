"""The tables of an evaluation: a row for each episode, and a row for each point where something varies."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mjrun.evaluation.episode import Episode, PlayedEpisodes
from mjrun.evaluation.result import Comparison, EpisodeSummary, PointSummary
from mjrun.evaluation.statistics import Interval
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import POINT, ResultsTable
from mjrun.model.column import Column

FILES = ("episodes.parquet", "episodes.csv")
REWARD = "reward/"  # before the name of each term
SUCCESS, RETURN, LENGTH, DIFFERENCE = "success", "return", "length", "_difference"
OWN = ("policy", "point", "episode", "seed", "return", "length", "steps", "ending", "outcome")


def episode_table(
    groups: Sequence[PlayedEpisodes], points: Design, rewards: Sequence[str], metrics: Sequence[str], *, compared: bool
) -> ResultsTable:
    """Returns the table of episodes, in the order of policies, points and seeds.

    Args:
      points: what varies; of one point without values where nothing does.
      rewards, metrics: their names.
      compared: whether there are several policies to be told apart.
    """
    table = ResultsTable()
    episodes = [episode for group in groups for episode in group.episodes]
    where = [group.point for group in groups for _ in group.episodes]

    def add(column: Column, value: Callable[[Episode], float]) -> None:
        table.add(column, [value(episode) for episode in episodes])

    if compared:
        table.add_texts("policy", [group.policy for group in groups for _ in group.episodes], "who played")
    if points.names:
        table.add(POINT, where)
    table.add_parameters(points, where, text_meaning="what varies")
    order = [index for group in groups for index in range(len(group.episodes))]
    table.add(Column("episode", meaning="number of the episode", integer=True), order)
    add(Column("seed", meaning="of all that is random in it", integer=True), lambda episode: episode.seed)
    add(Column("return", meaning="sum of all rewards"), lambda episode: episode.total)
    add(Column("length", "s", "simulated time"), lambda episode: episode.length)
    add(Column("steps", meaning="control periods", integer=True), lambda episode: episode.steps)
    table.add_texts("ending", [episode.ending for episode in episodes], "how it ended")
    table.add_texts("outcome", [episode.outcome for episode in episodes], "what that means")
    for name in rewards:
        sums = [episode.rewards.get(name, math.nan) for episode in episodes]
        table.add(Column(f"{REWARD}{name}", meaning="sum of a term of the reward"), sums)
    for index, name in enumerate(metrics):
        table.add(Column(name, meaning="metric"), [episode.metrics[index] for episode in episodes])
    return table


def point_table(design: Design, points: Sequence[PointSummary]) -> tuple[ResultsTable, dict[str, str]]:
    """Returns the table of points as that of a study, which `mjrun plot` knows, and the meaning of each metric in it.

    The ends of intervals come last, so that they are no metrics of their own.
    """
    measured = [measures(point.policies[0], point.comparison) for point in points]
    meanings = {name: measure.meaning for name, measure in measured[0].items()}
    table = ResultsTable()
    table.add(POINT, range(len(points)))
    table.add_parameters(design, range(len(points)))
    for name in meanings:
        table.add(Column(name, meaning="metric"), [_number(each[name].value) for each in measured])
    table.add_texts("status", ["ok"] * len(points))
    for name in meanings:
        intervals = [each[name].interval for each in measured]
        ends = (("low", [each.low for each in intervals]), ("high", [each.high for each in intervals]))
        for end, values in ends:
            meaning = f"{end} end of the interval of {name}"
            table.add(Column(f"{name}_{end}", meaning=meaning), [*map(_number, values)])
    return table, meanings


@dataclass(frozen=True)
class Measure:
    """A number of episodes, with its interval."""

    value: float | None
    meaning: str
    interval: Interval


def measures(summary: EpisodeSummary, comparison: Comparison | None) -> dict[str, Measure]:
    """Returns the numbers of a policy's episodes by name."""
    made: dict[str, Measure] = {}
    if summary.success:
        made[SUCCESS] = Measure(summary.success.share, "share of episodes", summary.success.interval)
    for name, each in {RETURN: summary.returns, LENGTH: summary.lengths, **summary.metrics}.items():
        made[name] = Measure(each.mean, "mean over the episodes", each.mean_interval)
    if comparison:
        for name, each in ((RETURN, comparison.returns), (SUCCESS, comparison.success)):
            if each:
                made[name + DIFFERENCE] = Measure(each.difference, "to the other policy, paired", each.interval)
    return made


def _number(value: float | None) -> float:
    return math.nan if value is None else value
