"""What the episodes of an evaluation come to: of each policy, of each point, and of one policy against the other."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.evaluation.comparison import Comparison, compared
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.result import PointSummary
from mjrun.evaluation.statistics import Interval
from mjrun.evaluation.summary import EpisodeSummary, summary_of
from mjrun.evaluation.table import PlayedEpisodes
from mjrun.model.column import Column
from mjrun.study.design import Design
from mjrun.study.results import result_columns
from mjrun.study.simulate import PointResult


@dataclass(frozen=True)
class Findings:
    """What episodes come to.

    Attributes:
      policies: of each policy, all its episodes.
      comparison: of two policies.
      points: of each point, where something varies.
    """

    policies: Sequence[EpisodeSummary]
    comparison: Comparison | None
    points: Sequence[PointSummary]


def findings(prepared: PreparedEvaluation, policies: Sequence[Sequence[PlayedEpisodes]], confidence: float) -> Findings:
    """What the episodes come to that `policies`, one or two, have played at every point."""
    rewards, metrics = prepared.player.rewards, prepared.metrics
    can_succeed = prepared.player.can_succeed or any(each.successes.any() for groups in policies for each in groups)

    def summary(groups: Sequence[PlayedEpisodes]) -> EpisodeSummary:
        episodes = [episode for group in groups for episode in group.episodes]
        names = list(dict.fromkeys(group.policy for group in groups))
        name = names[0] if len(names) == 1 else f"{len(names)} policies"
        return summary_of(name, episodes, rewards, metrics, confidence, can_succeed=can_succeed)

    def comparison(groups: Sequence[Sequence[PlayedEpisodes]]) -> Comparison | None:
        return compared(groups[0], groups[1], confidence, can_succeed=can_succeed) if len(groups) == 2 else None

    points: list[PointSummary] = []
    if prepared.points.names:
        for point, parts in enumerate(zip(*policies, strict=True)):
            groups = [[part] for part in parts]
            points.append(PointSummary(point, prepared.values(point), [*map(summary, groups)], comparison(groups)))
    return Findings([*map(summary, policies)], comparison(policies), points)


@dataclass(frozen=True)
class _Measure:
    """A number of a point, with its interval."""

    value: float | None
    meaning: str
    interval: Interval


def map_columns(design: Design, points: Sequence[PointSummary]) -> tuple[list[Column], np.ndarray, dict[str, str]]:
    """The table of points as that of a study, which `mjrun plot` knows: its columns, its rows, and what it measures.

    The ends of intervals come last, so that they are no measures of their own.
    """
    measured = [_measures(point) for point in points]
    meanings = {name: measure.meaning for name, measure in measured[0].items()}
    results = [
        PointResult(point.point, "ok", tuple(map(_number, (each.value for each in measures.values()))), 0)
        for point, measures in zip(points, measured, strict=True)
    ]
    all_columns, all_rows = result_columns(design, [*meanings], results)
    wanted = [i for i, column in enumerate(all_columns) if column.name not in ("steps", "exit_code", "message")]
    columns, rows = [all_columns[i] for i in wanted], [all_rows[:, i] for i in wanted]
    for name in meanings:
        intervals = [each[name].interval for each in measured]
        ends = (("low", [each.low for each in intervals]), ("high", [each.high for each in intervals]))
        columns += [Column(f"{name}_{end}", meaning=f"{end} end of the interval of {name}") for end, _ in ends]
        rows += [np.array([*map(_number, values)]) for _, values in ends]
    return columns, np.stack(rows, axis=1), meanings


def _measures(point: PointSummary) -> dict[str, _Measure]:
    """The numbers of a point by name."""
    own = point.policies[0]
    measures: dict[str, _Measure] = {}
    if own.success:
        measures["success"] = _Measure(own.success.share, "share of episodes", own.success.interval)
    means = {"return": own.returns, "length": own.lengths, **own.metrics}
    for name, each in means.items():
        measures[name] = _Measure(each.mean, "mean over the episodes", each.mean_interval)
    if point.comparison:
        for name, each in (("return", point.comparison.returns), ("success", point.comparison.success)):
            if each:
                meaning = "to the other policy, paired"
                measures[f"{name}_difference"] = _Measure(each.difference, meaning, each.interval)
    return measures


def _number(value: float | None) -> float:
    return math.nan if value is None else value
