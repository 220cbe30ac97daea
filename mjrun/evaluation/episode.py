"""Episodes that are to be played, and what has come of them; all of it picklable values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjrun.model.source import Source
from mjrun.policy.load import load_policy
from mjrun.policy.policy import Policy
from mjrun.python_code import ModuleSource
from mjrun.simulation.input_snapshot import InputSnapshot

OUTCOMES = ("success", "failure", "timeout")


@dataclass(frozen=True)
class PolicyChoice:
    """A policy, as a user names it.

    Attributes:
      policy: its text, or, in Python, the policy itself.
      normalize: the statistics that its observations are normalized with.
      trust: whether its file may run code.
      snapshot: copies of its files, which are read instead.
      modules: its code, if it is written by the user, for processes that load it.
    """

    policy: object
    normalize: str | None = None
    trust: bool = False
    snapshot: InputSnapshot | None = field(default=None, compare=False, repr=False)
    modules: tuple[ModuleSource, ...] = field(default=(), compare=False, repr=False)

    def load(self) -> Policy:
        """Returns the policy.

        Raises:
          UsageError: it cannot be a policy, or is not trusted.
          FileError: its files cannot be read.
        """
        place = self.snapshot.place if self.snapshot else Path
        return load_policy(self.policy, trust=self.trust, normalize=self.normalize, place=place)

    @property
    def name(self) -> str:
        """What tables call it."""
        return self.policy if isinstance(self.policy, str) else type(self.policy).__name__


@dataclass(frozen=True)
class EpisodeSpec:
    """What episodes have in common but for their seeds.

    Attributes:
      task: what is played.
      chosen: who plays.
      metrics: the name and the text of each.
    """

    task: Source
    chosen: PolicyChoice
    metrics: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)  # as there may be a million of them
class Episode:
    """What has come of an episode.

    Attributes:
      seed: of all that is random in it.
      total: the return: the sum of all rewards.
      steps: control periods.
      length: simulated time [s].
      ending: the name of the termination.
      outcome: its kind: `success`, `failure` or `timeout`.
      terms: the names of the terms of the reward, an object that episodes share.
      sums: of each term.
      metrics: in the order of the specification; NaN where there is none.
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
        """The sum of each term of the reward, by name."""
        return dict(zip(self.terms, self.sums, strict=True))


@dataclass(frozen=True)
class PlayedEpisodes:
    """The episodes of one policy at one point.

    Attributes:
      policy: its name.
      point: the number of the point.
      episodes: in the order of their seeds.
    """

    policy: str
    point: int
    episodes: Sequence[Episode]

    @property
    def returns(self) -> np.ndarray:
        """`(n,)`."""
        return np.array([episode.total for episode in self.episodes])

    @property
    def successes(self) -> np.ndarray:
        """Bool `(n,)`."""
        return np.array([episode.outcome == OUTCOMES[0] for episode in self.episodes])
