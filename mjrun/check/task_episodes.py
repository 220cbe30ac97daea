"""Episodes, in which rules about tasks look for faults, and the places of a task's parts."""

from collections.abc import Iterator
from dataclasses import field
from pathlib import Path

import numpy as np

from mjrun.check.rule import Place
from mjrun.dataclass import dataclass
from mjrun.errors import DocumentError, Problem, UsageError
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.task.task import UNSTABLE, Task
from mjrun.task.worlds import TaskWorlds

COUNT = 16  # episodes, of seeds 0, 1, …
MOST = 500  # control periods of each episode


@dataclass(frozen=True)
class NotFinite:
    """The first occurrence of a number that is not finite.

    Attributes:
      kind: `observations` or `rewards`.
      name: the name of the number, or of the reward.
      term: the term that it belongs to.
      value: `nan`, `inf` or `-inf`.
      time: the time within the episode [s].
      seed: the seed of the episode.
    """

    kind: str
    name: str
    term: str
    value: float
    time: float
    seed: int


@dataclass
class TaskEpisodeFaults:
    """The observed faults of episodes.

    Attributes:
      count: the number of episodes.
      acting: the source of actions: `random actions`, or a policy.
      periods: the total number of control periods.
      not_finite: the first occurrence of each number that is not finite.
      ended_at_start: the seeds of episodes at whose start a termination holds, by its name.
      unstable: the seeds of episodes that became unstable.
      constant: the names and terms of the observed numbers that stayed the same in all episodes.
    """

    count: int
    acting: str
    periods: int = 0
    not_finite: list[NotFinite] = field(default_factory=list[NotFinite])
    ended_at_start: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    unstable: list[int] = field(default_factory=list[int])
    constant: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])


def watch(worlds: TaskWorlds, policy: Policy) -> TaskEpisodeFaults:
    """Plays an episode of each world under `policy`, whose answers must be finite, and returns the faults."""
    return _Watch(worlds, policy).run()


class _Watch:
    def __init__(self, worlds: TaskWorlds, policy: Policy) -> None:
        self._worlds, self._policy = worlds, policy
        self._dt = float(worlds.task.control_dt)
        acting = "random actions" if policy.name == "random" else policy.name
        self._seen = TaskEpisodeFaults(worlds.count, acting)
        self._known: set[tuple[str, str]] = set()

    def run(self) -> TaskEpisodeFaults:
        worlds, seen = self._worlds, self._seen
        observations = worlds.reset(range(worlds.count))
        for seed, ending in enumerate(worlds.ended_at_start):
            if ending is not None:
                seen.ended_at_start.setdefault(ending.name, []).append(seed)
        self._look("observations", observations, np.arange(worlds.count), 0)
        lowest, highest = observations.min(axis=0), observations.max(axis=0)

        space = ActionSpace(worlds.action_names, worlds.actions.low, worlds.actions.high)
        actors = [self._policy.episode(seed, space) for seed in range(worlds.count)]
        running = np.arange(worlds.count)
        for period in range(1, min(worlds.task.periods, MOST) + 1):
            step = worlds.step(_answers(actors, running, observations), running)
            seen.periods += len(running)
            is_unstable = np.array([ending is not None and ending.name == UNSTABLE.name for ending in step.ended])
            seen.unstable += running[is_unstable].tolist()
            self._look("rewards", step.reward_terms[~is_unstable], running[~is_unstable], period)
            self._look("observations", step.observations, running, period)
            lowest = np.minimum(lowest, step.observations.min(axis=0))
            highest = np.maximum(highest, step.observations.max(axis=0))
            goes_on = ~step.over & np.isfinite(step.observations).all(axis=1)  # the policy gets no others
            running, observations = running[goes_on], step.observations[goes_on]
            if not len(running):
                break
        seen.constant = [
            (number.name, number.term)
            for number, low, high in zip(worlds.observed, lowest, highest, strict=True)
            if low == high
        ]
        return seen

    def _look(self, kind: str, values: np.ndarray, seeds: np.ndarray, period: int) -> None:
        """Records values `(k, …)` of episodes that are not finite."""
        for row, column in np.argwhere(~np.isfinite(values)).tolist():
            observed = self._worlds.observed[column] if kind == "observations" else None
            name = observed.name if observed else self._worlds.reward_names[column]
            term = observed.term if observed else name
            if (kind, term) not in self._known:
                self._known.add((kind, term))
                value, seed = float(values[row, column]), int(seeds[row])
                self._seen.not_finite.append(NotFinite(kind, name, term, value, period * self._dt, seed))


def _answers(actors: list[Actor], running: np.ndarray, observations: np.ndarray) -> np.ndarray:
    return np.array([actors[i](seen) for i, seen in zip(map(int, running), observations, strict=True)])


class TaskPlaces:
    """The places of a task's parts.

    Args:
      task: a task, with the places in its document if it has one.
      path: the path of the document.
    """

    def __init__(self, task: Task, path: Path) -> None:
        self.task, self._path = task, path

    def at(self, *path: str | int) -> Place:
        """Returns the place of the part at `path`, such as `"actions", 0`."""
        error = UsageError("", path)
        located = self.task.places.located(error) if self.task.places else error
        return place_of(located.problems[0], self._path) if isinstance(located, DocumentError) else Place(self._path)

    def numbers_of_actions(self, worlds: TaskWorlds) -> Iterator[list[int]]:
        """Yields the indices in the action vector of each of the task's actions."""
        start = 0
        for width in worlds.actions.widths:
            yield list(range(start, start + width))
            start += width


def place_of(problem: Problem, path: Path) -> Place:
    """Returns the file and line of a problem, whose place is `task.yaml:12:5`; `path` if it is not in a file."""
    file, _, position = problem.place.rpartition(":")
    file, _, line = file.rpartition(":")
    if not (file and line.isdecimal() and position.isdecimal()):
        return Place(path)
    return Place(Path(file), int(line))
