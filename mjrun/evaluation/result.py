"""What an evaluation finds, as `--json` reports it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mjrun.evaluation.statistics import Interval, NumberSummary, Share
from mjrun.probe.verdict import Verdict

SCHEMA = "mjrun-eval-1"


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


@dataclass(frozen=True)
class PointSummary:
    """What the episodes of one point come to.

    Attributes:
      point: its number.
      values: what varies, and its values.
      policies: of each policy, what its episodes come to.
      comparison: of two policies at this point.
    """

    point: int
    values: Mapping[str, str]
    policies: Sequence[EpisodeSummary]
    comparison: Comparison | None


@dataclass(frozen=True)
class EpisodeVideo:
    """A video of an episode.

    Attributes:
      rank: `worst`, `median`, `best`, or `rank7` for the seventh from below, by the return.
      path: its file.
      seed: of the episode.
      point: where it was played, if something varies.
      returned: the sum of all its rewards.
      ending: how it ended.
    """

    rank: str
    path: str
    seed: int
    point: int | None
    returned: float
    ending: str


@dataclass(frozen=True)
class EvaluationResult:
    """What an evaluation finds.

    Attributes:
      path: the folder of the results.
      task: what was played.
      episodes: of each policy at each point.
      seed: of the first of them.
      confidence: of all intervals.
      policies: of each policy, what all its episodes come to; the first is the one that is asked about.
      comparison: of two policies.
      names: what varies.
      points: of each point, where something varies.
      films: the videos of episodes.
      assertions: what was required, and whether it holds.
      files: what was written.
      steps: control periods of all episodes.
      wall: wall time [s].
      schema: of this document.
    """

    path: str
    task: str
    episodes: int
    seed: int
    confidence: float
    policies: Sequence[EpisodeSummary]
    comparison: Comparison | None
    names: Sequence[str]
    points: Sequence[PointSummary]
    films: Sequence[EpisodeVideo]
    assertions: Sequence[Verdict]
    files: Sequence[str]
    steps: int
    wall: float
    schema: str = field(default=SCHEMA)
