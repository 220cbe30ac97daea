"""Episodes to play and records of episodes that were played: picklable values."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.source import Source
from mjrun.options.disturbance import NO_DISTURBANCES, Disturbances
from mjrun.options.policy import is_code
from mjrun.policy.load import load_policy
from mjrun.policy.policy import Policy
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.simulation import Simulation
from mjrun.study.spec import PointResult, Status

FAILURE = "failure"
OUTCOMES = ("success", FAILURE, "timeout")


@dataclass(frozen=True)
class PolicyChoice:
    """A policy as the user names it.

    Attributes:
      policy: text of the policy or, in Python, the policy.
      normalize: statistics that normalize its observations.
      trust: whether its file may execute code.
      snapshot: copies of its files, which are read instead.
    """

    policy: object
    normalize: str | None = None
    trust: bool = False
    snapshot: InputSnapshot | None = field(default=None, compare=False, repr=False)

    def load(self) -> Policy:
        """Loads the policy.

        Raises:
          UsageError: it is not a policy, or is not trusted.
          FileError: its files cannot be read.
        """
        place = self.snapshot.place if self.snapshot else Path
        return load_policy(self.policy, trust=self.trust, normalize=self.normalize, place=place)

    @property
    def is_code(self) -> bool:
        """True for code that the user has written and other processes can load."""
        return isinstance(self.policy, str) and is_code(self.policy)

    @property
    def name(self) -> str:
        """Name of the policy in tables."""
        return self.policy if isinstance(self.policy, str) else type(self.policy).__name__


@dataclass(frozen=True)
class GroupSpec:
    """Everything that the episodes of a group share: all but their seeds.

    Attributes:
      task: task to play.
      chosen: policy that plays.
      metrics: name and text of each metric.
      disturbances: noise instead of that of the task, and additional pushes.
    """

    task: Source
    chosen: PolicyChoice
    metrics: tuple[tuple[str, str], ...] = ()
    disturbances: Disturbances = NO_DISTURBANCES

    @property
    def source(self) -> Source:
        """The task, read from copies of its files if there are any."""
        snapshot = self.chosen.snapshot
        return self.task.stored_at(snapshot.place) if snapshot else self.task

    def simulation(self, seed: int = 0) -> Simulation:
        """Returns the simulation of the episode of a seed."""
        chosen = self.chosen
        return Simulation(
            self.task,
            policy=chosen.policy,
            normalize=chosen.normalize,
            trust=chosen.trust,
            **vars(self.disturbances),
            seed=seed,
            snapshot=chosen.snapshot,
        )

    def stored_at(self, root: Path) -> "GroupSpec":
        """Returns the same specification, whose files are in the folder `root`."""
        chosen = self.chosen
        snapshot = chosen.snapshot and replace(chosen.snapshot, root=root)
        return replace(self, chosen=replace(chosen, snapshot=snapshot))


@dataclasses.dataclass(frozen=True, slots=True)  # since there may be a million of them
class EpisodeRecord:
    """The record of an episode that was played, or failed.

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
      status: `ok`, or how the episode failed; then its numbers are NaN, and it has no ending.
      message: reason of the failure.
      exit_code: exit code of the failure.
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
    status: Status = "ok"
    message: str = ""
    exit_code: int = 0

    @classmethod
    def failed(cls, seed: int, result: PointResult, terms: Sequence[str], metrics: int) -> "EpisodeRecord":
        """Returns the record of an episode that failed with this result.

        Args:
          terms: names of the terms of the reward.
          metrics: number of metrics.
        """
        return cls(
            seed=seed,
            total=math.nan,
            steps=result.steps,
            length=math.nan,
            ending="",
            outcome="",
            terms=terms,
            sums=(math.nan,) * len(terms),
            metrics=(math.nan,) * metrics,
            status=result.status,
            message=result.message,
            exit_code=result.exit_code,
        )

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
      episodes: records in the order of the seeds, also of episodes that failed.
    """

    policy: str
    point: int
    episodes: Sequence[EpisodeRecord]

    @property
    def is_completed(self) -> np.ndarray:
        """Episodes that did not fail, bool `(n,)`."""
        return np.array([episode.status == "ok" for episode in self.episodes])

    @property
    def returns(self) -> np.ndarray:
        """Return of each episode `(n,)`; NaN where it failed."""
        return np.array([episode.total for episode in self.episodes])

    @property
    def successes(self) -> np.ndarray:
        """Success of each episode, bool `(n,)`."""
        return np.array([episode.outcome == OUTCOMES[0] for episode in self.episodes])
