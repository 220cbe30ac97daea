"""What is known of an episode while it runs, whoever steps it: a task of mjrun's, or somebody else's environment."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import mujoco
import numpy as np

from mjrun.errors import InvalidActionError
from mjrun.physics.replay import RecordedStates, ReplayStepper
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode import EpisodeValues

Actor = Callable[[np.ndarray], np.ndarray]  # a policy in one episode: the action `(nact,)` on an observation `(nobs,)`
EndingKind = Literal["success", "failure", "timeout"]


@dataclass(frozen=True)
class Ending:
    """How an episode ended.

    Attributes:
      name: of the termination, such as `fallen`, `timeout` or `unstable`.
      kind: a timeout truncates an episode; anything else terminates it.
    """

    name: str
    kind: EndingKind

    @property
    def terminated(self) -> bool:
        """Whether the task itself ended here, so that nothing would have followed."""
        return self.kind != "timeout"


class Endings(tuple[Ending, ...]):
    """All endings that episodes of a task can have, by their codes. An episode that goes on has the code −1.

    Args:
      own: those of the task.
      timeout, unstable: those that every task has; their codes come last.

    Attributes:
      timeout, unstable: the codes of these.
      terminated, truncated: of each code, the last for −1 `(n + 1,)` bool.
    """

    timeout: int
    unstable: int
    terminated: np.ndarray
    truncated: np.ndarray

    def __new__(cls, own: Iterable[Ending], timeout: Ending, unstable: Ending) -> "Endings":
        self = super().__new__(cls, (*own, timeout, unstable))
        self.timeout, self.unstable = len(self) - 2, len(self) - 1
        self.terminated = np.array([*(ending.terminated for ending in self), False])
        self.truncated = np.array([*(not ending.terminated for ending in self), False])
        return self


@dataclass(frozen=True)
class EpisodeNames:
    """What the numbers of an episode are called.

    Attributes:
      observations: of each number that the policy observes: `position/x`.
      actions: of each number that it answers: actuators or joints.
      rewards: of the terms of the reward.
    """

    observations: Sequence[str]
    actions: Sequence[str]
    rewards: Sequence[str]


@dataclass(frozen=True)
class ControlInstant(EpisodeValues):
    """What holds from a control instant until the next, and how the episode ended here, if it did."""

    ending: Ending | None = None


def ask(actor: Actor, observation: np.ndarray, names: Sequence[str], step: int, time: float, policy: str) -> np.ndarray:
    """The action of a policy on an observation.

    Args:
      names: of the numbers of an action.
      step, time: of the control instant.
      policy: the name of the policy.

    Raises:
      InvalidActionError: a number of it is not finite.
    """
    action = np.asarray(actor(observation), float).ravel()
    if not np.isfinite(action).all():
        wrong = {n: v for n, v in zip(names, action.tolist(), strict=False) if not np.isfinite(v)}
        raise InvalidActionError(step, time, policy, wrong)
    return action


@runtime_checkable
class EpisodeStepper(Stepper, Protocol):
    """Steps through an episode: it resets, asks the policy at every control instant, and rewards.

    At every step the controls in force are those of the action in force; at a control instant, of the one that the
    policy answers there.

    Attributes:
      names: of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: control periods that were completed, up to the end of the episode.
    """

    names: EpisodeNames
    control_steps: int

    @property
    def periods(self) -> int: ...

    def now(self) -> ControlInstant:
        """The last control instant, which is at or before `self.step`."""
        ...


class EpisodeOver(Exception):  # noqa: N818 - not an error: a stepper cannot go beyond the end
    """An episode ended before the step that was asked for; the stepper stands at its end.

    Attributes:
      step: the last one.
    """

    def __init__(self, step: int, ending: Ending) -> None:
        self.step, self.ending = step, ending
        super().__init__(f"the episode ended at step {step}: {ending.name}")


class ReplayedEpisode(ReplayStepper):
    """Recorded states, with what held at each of the control instants among them."""

    def __init__(
        self, model: mujoco.MjModel, states: RecordedStates, instants: Sequence[ControlInstant], of: EpisodeStepper
    ) -> None:
        super().__init__(model, states)
        self.names: EpisodeNames = of.names
        self.control_steps, self.periods = of.control_steps, of.periods
        self._instants = instants

    def now(self) -> ControlInstant:
        """What held at the last control instant."""
        return self._instants[self.step // self.control_steps]


class ControlInstants:
    """What held at the control instants of an episode, while it is stepped through; of other simulations, nothing."""

    def __init__(self) -> None:
        self._instants: list[ControlInstant] = []
        self._stepper: EpisodeStepper | None = None

    def take(self, stepper: Stepper) -> None:
        """Takes note of where `stepper` stands; to be called at every step."""
        if isinstance(stepper, EpisodeStepper) and stepper.step == len(self._instants) * stepper.control_steps:
            self._stepper = stepper
            self._instants.append(stepper.now())

    def replay(self, model: mujoco.MjModel, states: RecordedStates) -> ReplayStepper:
        """Goes through the recorded `states` of all steps once more."""
        if self._stepper is None:
            return ReplayStepper(model, states)
        return ReplayedEpisode(model, states, self._instants, self._stepper)
