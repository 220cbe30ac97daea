"""What episodes come to: returns, successes, endings, terms of the reward and metrics, with intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjrun.evaluation.episode import Episode
from mjrun.evaluation.statistics import NumberSummary, Share, share, summarized
from mjrun.evaluation.table import OUTCOMES


@dataclass(frozen=True)
class EndingCount:
    """How many episodes ended in one way.

    Attributes:
      ending: the name of the termination.
      outcome: what it means: success, failure or timeout.
      share: of all episodes.
    """

    ending: str
    outcome: str
    share: Share


@dataclass(frozen=True)
class EpisodeSummary:
    """What episodes of one policy come to.

    Attributes:
      policy: its name.
      episodes: how many were played.
      returns: the sums of all rewards.
      lengths: simulated times [s].
      success: the share of episodes that ended as a success; None where no termination of the task is one.
      endings: the most frequent first.
      rewards: the sums of each term of the reward.
      metrics: each over the episodes that have it.
    """

    policy: str
    episodes: int
    returns: NumberSummary
    lengths: NumberSummary
    success: Share | None
    endings: Sequence[EndingCount]
    rewards: Mapping[str, NumberSummary]
    metrics: Mapping[str, NumberSummary]


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
