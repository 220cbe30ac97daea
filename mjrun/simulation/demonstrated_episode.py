"""A demonstration as a sequence of states and actions, for datasets of episodes."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, option
from mjrun.model.demonstrations import open_demonstrations
from mjrun.suffixes import split_episode
from mjrun.timeline import nearest, rational

UNEVEN = 0.01  # share of the time between two states by which others may differ
SUCCESS = 1.0  # reward of a completed task
DENOMINATOR = 1000  # of a rate [Hz]


@dataclass(frozen=True)
class DemonstratedEpisode:
    """A recorded episode of T rows: action t was taken in state t.

    Attributes:
      source: the demonstration as users write it.
      task: the instruction in natural language, or else the name of the environment.
      robot: the name of the robot, or those of several; empty if the file states none.
      times: the time of each state since the first one [s], `(T,)`.
      actions: the inputs of the controller that recorded it `(T, n)`.
      rewards: the reward of each action `(T,)`; None if the file has none.
      success: whether the task was completed, according to the rewards; None without rewards.
    """

    source: str
    task: str
    robot: str
    times: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray | None
    success: bool | None

    @property
    def action_names(self) -> Sequence[str]:
        """The names of the numbers of an action."""
        return [f"action_{index}" for index in range(self.actions.shape[1])]

    @property
    def rate(self) -> Fraction:
        """The number of states per second [Hz].

        Raises:
          UsageError: the states are not evenly spaced.
        """
        gaps = np.diff(self.times)
        if not len(gaps):
            raise UsageError(f"{clean(self.source)} has one state, and therefore no rate")
        usual = float(np.median(gaps))
        if not usual > 0:
            raise UsageError(f"{clean(self.source)}: its times do not ascend; {option('replay_rate')} replaces them")
        uneven = np.flatnonzero(abs(gaps - usual) > UNEVEN * usual)
        if len(uneven):
            row = int(uneven[0])
            raise UsageError(
                f"{clean(self.source)}: state {row + 1} is {gaps[row]:.6g} s after the one before, and others "
                f"{usual:.6g} s; a dataset has a constant rate"
            )
        return Fraction(1 / usual).limit_denominator(DENOMINATOR)

    def steps(self, timestep: Fraction) -> list[int]:
        """Returns the step of each state, in timesteps [s] of the model."""
        return [nearest(rational(time) / timestep) for time in self.times.tolist()]


def read_demonstration(text: str | Path, rate: Fraction | None = None) -> DemonstratedEpisode:
    """Reads the demonstration that `text` names.

    Args:
      rate: states per second [Hz], instead of their times.

    Raises:
      FileError: it is missing, cannot be read, or has no action for each state.
    """
    path, episode = split_episode(text)
    with open_demonstrations(Path(path)) as file:
        name = file.named(episode)
        times, actions, origin = file.states(name)[:, 0], file.array(name, "actions"), file.origin(name)
        rewards = file.array(name, "rewards") if "rewards" in file.datasets(name) else None
    source = f"{path}:{name}"
    actions = actions.reshape(len(actions), -1) if actions.ndim else actions
    for what, values in (("actions", actions), ("rewards", rewards)):
        if values is not None and (values.shape[:1] != times.shape or not np.isfinite(values).all()):
            reason = f"its {what} have the shape {values.shape}, and its states {times.shape}"
            raise FileError(source, reason if values.shape[:1] != times.shape else f"its {what} are not all finite")
    return DemonstratedEpisode(
        source=source,
        task=clean(origin.instruction or origin.task or name),
        robot=clean(", ".join(origin.robots)),
        times=times - times[0] if rate is None else np.arange(len(times)) / float(rate),
        actions=actions,
        rewards=rewards,
        success=None if rewards is None else bool((rewards >= SUCCESS).any()),
    )
