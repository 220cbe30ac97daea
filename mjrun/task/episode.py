"""The course of an episode, whether a task of mjrun's or a Gymnasium environment steps it."""

import math
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, Protocol, runtime_checkable

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import InvalidActionError
from mjrun.physics.recorded_states import RecordedStates, SpooledRows
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode_columns import EpisodeValues

Actor = Callable[[np.ndarray], np.ndarray]  # a policy in one episode: observation `(nobs,)` to action `(nact,)`
EndingKind = Literal["success", "failure", "timeout"]


@dataclass(frozen=True)
class Ending:
    """The ending of an episode.

    Attributes:
      name: the name of the termination, such as `fallen`, `timeout` or `unstable`.
      kind: a timeout truncates an episode; anything else terminates it.
    """

    name: str
    kind: EndingKind

    @property
    def terminated(self) -> bool:
        """True where the task itself ended, so that nothing would have followed."""
        return self.kind != "timeout"


class PossibleEndings(tuple[Ending, ...]):
    """All possible endings of the episodes of a task, by their codes. A running episode has the code −1.

    Args:
      own: the terminations of the task.
      timeout, unstable: the endings of every task; their codes come last.

    Attributes:
      timeout, unstable: the codes of these.
      terminated, truncated: the flags of each code, the last for −1 `(n + 1,)` bool.
    """

    timeout: int
    unstable: int
    terminated: np.ndarray
    truncated: np.ndarray

    def __new__(cls, own: Iterable[Ending], timeout: Ending, unstable: Ending) -> "PossibleEndings":
        self = super().__new__(cls, (*own, timeout, unstable))
        self.timeout, self.unstable = len(self) - 2, len(self) - 1
        self.terminated = np.array([*(ending.terminated for ending in self), False])
        self.truncated = np.array([*(not ending.terminated for ending in self), False])
        return self


@dataclass(frozen=True)
class EpisodeColumnNames:
    """The names of the numbers of an episode.

    Attributes:
      observations: the names of the numbers of an observation, such as `position/x`.
      actions: the names of the numbers of an action: actuators or joints.
      rewards: the names of the terms of the reward.
    """

    observations: Sequence[str]
    actions: Sequence[str]
    rewards: Sequence[str]


@dataclass(frozen=True)
class ControlInstant(EpisodeValues):
    """A control instant: the values that hold until the next one, and the ending of the episode if it ended here."""

    ending: Ending | None = None


def ask(actor: Actor, observation: np.ndarray, names: Sequence[str], step: int, time: float, policy: str) -> np.ndarray:
    """Returns the action of a policy on an observation.

    Args:
      names: the names of the numbers of an action.
      step, time: the step and the time of the control instant.
      policy: its name, for messages.

    Raises:
      InvalidActionError: a number of the action is not finite.
    """
    action = np.asarray(actor(observation), float).ravel()
    if not (math.isfinite(sum(action.tolist())) or np.isfinite(action).all()):
        wrong = {name: value for name, value in zip(names, action.tolist(), strict=False) if not np.isfinite(value)}
        raise InvalidActionError(step, time, policy, wrong)
    return action


def recorded(actor: Actor) -> tuple[Actor, Actor]:
    """Returns `actor`, recording its answers, and an actor that repeats these and continues `actor` after them.

    Many answers are stored on disk. All of them have the same size.
    """
    answers = _Answers()

    def record(observation: np.ndarray) -> np.ndarray:
        try:
            answer = actor(observation)
        except Exception as error:
            answers.add_error(error)
            raise
        answers.add(answer)
        return answer

    def repeat(observation: np.ndarray) -> np.ndarray:
        return actor(observation) if answers.are_repeated else answers.next()

    return record, repeat


class _Answers:
    """The answers and errors of an actor, in their order."""

    def __init__(self) -> None:
        self._rows: SpooledRows | None = None
        self._errors = deque[tuple[int, Exception]]()  # each with the number of answers before it
        self._repeated = 0

    @property
    def are_repeated(self) -> bool:
        """True if none is left to repeat."""
        return not self._errors and self._repeated == len(self._rows or ())

    def add(self, answer: np.ndarray) -> None:
        """Adds an answer `(nact,)`."""
        if self._rows is None:
            self._rows = SpooledRows(len(answer))
            weakref.finalize(self, self._rows.close)
        self._rows.append(answer)

    def add_error(self, error: Exception) -> None:
        """Adds an error."""
        self._errors.append((len(self._rows or ()), error))

    def next(self) -> np.ndarray:
        """Returns the next answer, or raises the next error."""
        if self._errors and self._errors[0][0] == self._repeated:
            raise self._errors.popleft()[1]
        assert self._rows
        self._repeated += 1
        return self._rows[self._repeated - 1].copy()


@runtime_checkable
class EpisodeStepper(Stepper, Protocol):
    """A stepper through one episode: it resets, calls the policy at every control instant, and computes rewards.

    At every step the controls are those of the current action; at a control instant, of the action that the policy
    returns there.

    Attributes:
      names: the names of observations, actions and terms of the reward.
      control_steps: physics steps in a control period.
      periods: completed control periods, up to the end of the episode.
    """

    names: EpisodeColumnNames
    control_steps: int

    @property
    def periods(self) -> int: ...

    def now(self) -> ControlInstant:
        """Returns the last control instant at or before `self.step`."""
        ...


class EpisodeOver(Exception):  # noqa: N818 - not an error: a stepper cannot go beyond the end
    """The end of an episode before the requested step; the stepper is at the end.

    Attributes:
      step: the last step.
      ending: the end of the episode.
    """

    def __init__(self, step: int, ending: Ending) -> None:
        self.step, self.ending = step, ending
        super().__init__(f"the episode ended at step {step}: {ending.name}")


class EpisodeReplayStepper(ReplayStepper):
    """A stepper along the recorded states of an episode, with the values of the control instants among them."""

    def __init__(
        self, model: mujoco.MjModel, states: RecordedStates, instants: Sequence[ControlInstant], of: EpisodeStepper
    ) -> None:
        super().__init__(model, states)
        self.names: EpisodeColumnNames = of.names
        self.control_steps, self.periods = of.control_steps, of.periods
        self._instants = instants

    def now(self) -> ControlInstant:
        """Returns the last control instant."""
        return self._instants[self.step // self.control_steps]


class ControlInstants:
    """The control instants of an episode, collected while it is stepped; empty for any other simulation."""

    def __init__(self) -> None:
        self._instants: list[ControlInstant] = []
        self._stepper: Stepper | None = None
        self._episode: EpisodeStepper | None = None

    def record(self, stepper: Stepper) -> None:
        """Records the control instant if `stepper` is at one; called at every step."""
        if stepper is not self._stepper:
            self._stepper = stepper
            self._episode = stepper if isinstance(stepper, EpisodeStepper) else None  # slow, so once
        episode = self._episode
        if episode and episode.step == len(self._instants) * episode.control_steps:
            self._instants.append(episode.now())

    def replay(self, model: mujoco.MjModel, states: RecordedStates) -> ReplayStepper:
        """Returns a stepper through the recorded `states` of all steps."""
        if self._episode is None:
            return ReplayStepper(model, states)
        return EpisodeReplayStepper(model, states, self._instants, self._episode)
