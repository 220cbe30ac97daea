"""What episodes come to: of each policy, at each point, and of one policy against the other, with intervals.

Policies are compared by the episodes that both have played: of the same seed, at the same point. Pairs of one seed at
several points have much in common; intervals take each seed for a cluster.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.evaluation.episode import OUTCOMES, Episode, PlayedEpisodes
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.result import Comparison, EndingCount, EpisodeSummary, PairedDifference, PointSummary
from mjrun.evaluation.statistics import (
    Interval,
    NumberSummary,
    Share,
    mean_interval,
    paired_share_interval,
    share,
    summarized,
)


@dataclass(frozen=True)
class Summaries:
    """What episodes come to.

    Attributes:
      policies: of each policy, all its episodes.
      comparison: of two policies.
      points: of each point, where something varies.
    """

    policies: Sequence[EpisodeSummary]
    comparison: Comparison | None
    points: Sequence[PointSummary]


def summaries(
    prepared: PreparedEvaluation, policies: Sequence[Sequence[PlayedEpisodes]], confidence: float
) -> Summaries:
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
    return Summaries([*map(summary, policies)], comparison(policies), points)


def summary_of(
    policy: str,
    episodes: Sequence[Episode],
    rewards: Sequence[str],
    metrics: Sequence[str],
    confidence: float,
    *,
    can_succeed: bool,
) -> EpisodeSummary:
    """What `episodes`, at least one, come to.

    Args:
      rewards, metrics: their names.
      can_succeed: whether a termination of the task is a success.
    """
    seeds = [episode.seed for episode in episodes]

    def summary(values: Sequence[float]) -> NumberSummary:
        return summarized(values, confidence, seeds)

    def share_of(cases: Sequence[bool]) -> Share:
        return share(cases, confidence, seeds)

    outcomes = {episode.ending: episode.outcome for episode in episodes}
    endings = [
        EndingCount(ending, outcome, share_of([episode.ending == ending for episode in episodes]))
        for ending, outcome in outcomes.items()
    ]
    succeeded = [episode.outcome == OUTCOMES[0] for episode in episodes]

    return EpisodeSummary(
        policy=policy,
        episodes=len(episodes),
        returns=summary([episode.total for episode in episodes]),
        lengths=summary([episode.length for episode in episodes]),
        success=share_of(succeeded) if can_succeed else None,
        endings=sorted(endings, key=lambda each: -each.share.count),
        rewards={name: summary([episode.rewards.get(name, math.nan) for episode in episodes]) for name in rewards},
        metrics={name: summary([episode.metrics[i] for episode in episodes]) for i, name in enumerate(metrics)},
    )


def compared(
    ours: Sequence[PlayedEpisodes], theirs: Sequence[PlayedEpisodes], confidence: float, *, can_succeed: bool
) -> Comparison:
    """How policies differ whose episodes are in the same order."""
    names = ours[0].policy, theirs[0].policy
    returns = [np.concatenate([group.returns for group in groups]) for groups in (ours, theirs)]
    successes = [np.concatenate([group.successes for group in groups]) for groups in (ours, theirs)]
    seeds = np.array([episode.seed for group in ours for episode in group.episodes])
    differences = returns[0] - returns[1]
    share_interval = paired_share_interval(successes[0], successes[1], confidence, seeds)
    success = _difference(names, successes[0].astype(float) - successes[1], share_interval)
    return Comparison(
        *names,
        pairs=len(differences),
        returns=_difference(names, differences, mean_interval(differences, confidence, seeds)),
        success=success if can_succeed else None,
    )


def _difference(names: tuple[str, str], differences: np.ndarray, interval: Interval) -> PairedDifference:
    mean = float(differences.mean())
    better = (names[0] if mean > 0 else names[1]) if interval.excludes_zero else None
    wins = [int(np.count_nonzero(side)) for side in (differences > 0, differences < 0, differences == 0)]
    return PairedDifference(mean, interval, better, *wins)
