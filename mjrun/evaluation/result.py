"""What an evaluation finds, as `--json` reports it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mjrun.evaluation.comparison import Comparison
from mjrun.evaluation.summary import EpisodeSummary
from mjrun.probe.verdict import Verdict

SCHEMA = "mjrun-eval-1"


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
class Film:
    """A film of an episode.

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
      films: of episodes.
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
    films: Sequence[Film]
    assertions: Sequence[Verdict]
    files: Sequence[str]
    steps: int
    wall: float
    schema: str = field(default=SCHEMA)
