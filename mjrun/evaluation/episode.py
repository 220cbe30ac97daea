"""Episodes to play and records of episodes that were played: picklable values."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.source import Source
from mjrun.policy.load import load_policy
from mjrun.policy.policy import Policy
from mjrun.python_code import ModuleSource
from mjrun.simulation.input_snapshot import InputSnapshot

OUTCOMES = ("success", "failure", "timeout")


@dataclass(frozen=True)
class PolicyChoice:
    """A policy as the user names it.

    Attributes:
      policy: text of the policy or, in Python, the policy.
      normalize: statistics that normalize its observations.
      trust: whether its file may execute code.
      snapshot: copies of its files, which are read instead.
      modules: modules of a policy that the user has written, for processes that load it.
    """

    policy: object
    normalize: str | None = None
    trust: bool = False
    snapshot: InputSnapshot | None = field(default=None, compare=False, repr=False)
    modules: tuple[ModuleSource, ...] = field(default=(), compare=False, repr=False)

    def load(self) -> Policy:
        """Loads the policy.

        Raises:
          UsageError: it is not a policy, or is not trusted.
          FileError: its files cannot be read.
        """
        place = self.snapshot.place if self.snapshot else Path
        return load_policy(self.policy, trust=self.trust, normalize=self.normalize, place=place)

    @property
    def name(self) -> str:
        """Name of the policy in tables."""
        return self.policy if isinstance(self.policy, str) else type(self.policy).__name__


@dataclass(frozen=True)
class EpisodeSpec:
    """Everything that episodes share except their seeds.

    Attributes:
      task: task to play.
      chosen: policy that plays.
      metrics: name and text of each metric.
    """

    task: Source
    chosen: PolicyChoice
    metrics: tuple[tuple[str, str], ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)  # since there may be a million of them
class EpisodeRecord:
    """The record of an episode that was played.

    Attributes:
      seed: seed of everything that is random in the episode.
      total: return: sum of all rewards.
      steps: number of control periods.
      length: simulated time [s].
      ending: name of the termination.
      outcome: kind of the termination: `success`, `failure` or `timeout`.
      terms: names of the terms of the reward; episodes share this object.
      sums: sum of each term.
      metrics: metrics in the order of the specification; NaN where undefined.
    """

    seed: int
    total: float
    steps: int
    length: float
    ending: str
    outcome: str
    terms: Sequence[str]
    sums: Sequence[float]
    metrics: Sequence[float] = ()

    @property
    def rewards(self) -> Mapping[str, float]:
        """Sum of each term of the reward, by name."""
        return dict(zip(self.terms, self.sums, strict=True))


@dataclass(frozen=True)
class PlayedEpisodes:
    """The episodes of one policy at one point.

    Attributes:
      policy: name of the policy.
      point: number of the point.
      episodes: records in the order of the seeds.
    """

    policy: str
    point: int
    episodes: Sequence[EpisodeRecord]

    @property
    def returns(self) -> np.ndarray:
        """Return of each episode `(n,)`."""
        return np.array([episode.total for episode in self.episodes])

    @property
    def successes(self) -> np.ndarray:
        """Success of each episode, bool `(n,)`."""
        return np.array([episode.outcome == OUTCOMES[0] for episode in self.episodes])
