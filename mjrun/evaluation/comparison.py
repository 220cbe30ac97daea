"""Which of two policies is better, by episodes that both have played: of the same seed, at the same point.

Pairs of one seed at several points have much in common; intervals take each seed for a cluster.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.evaluation.statistics import Interval, mean_interval, paired_share_interval
from mjrun.evaluation.table import PlayedEpisodes


@dataclass(frozen=True)
class PairedDifference:
    """How the first policy differs from the second.

    Attributes:
      difference: the mean of the differences, or the difference of the shares: the first's minus the second's.
      interval: Student's t interval of the mean of paired differences; for shares, Newcombe's of paired ones.
      better: the name of the policy that is better; None where the interval has 0 in it, so that they cannot be told
        apart.
      first_wins, second_wins, ties: on how many pairs which of them is better.
    """

    difference: float
    interval: Interval
    better: str | None
    first_wins: int
    second_wins: int
    ties: int


@dataclass(frozen=True)
class Comparison:
    """Two policies on the same episodes.

    Attributes:
      first, second: their names.
      pairs: how many episodes both have played.
      returns: the difference of returns.
      success: the difference of success rates; None where no termination of the task is a success.
    """

    first: str
    second: str
    pairs: int
    returns: PairedDifference
    success: PairedDifference | None


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
