"""The check of a task: its document, its model and policy, and episodes of random actions, in which rules look for
faults.
"""

from collections.abc import Callable, Iterator
from dataclasses import field, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, cast

import numpy as np

from mjrun.check import rule_runner
from mjrun.check.finding import Finding, Place
from mjrun.check.rules import task_episodes
from mjrun.check.worker import ARENAS, Checker
from mjrun.check.worker_pool import MIB, CheckRequest
from mjrun.child_process import limit_this_process
from mjrun.dataclass import dataclass
from mjrun.errors import DocumentError, DocumentProblem, FileError, MjrunError, ModelError, UsageError, clean, option
from mjrun.formats.input_file import require_file
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.model.source import ModelSource
from mjrun.model.xml_source import read_xml
from mjrun.options.policy import RANDOM
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace, Policy
from mjrun.policy.task_facts import check_agreement
from mjrun.suffixes import YAML
from mjrun.task.episode import ask
from mjrun.task.task import UNSTABLE, Task
from mjrun.task.worlds import TaskWorlds

COUNT = 16  # episodes, of seeds 0, 1, …
MOST = 500  # control periods of each episode


@dataclass(frozen=True)
class NonFiniteOccurrence:
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
    not_finite: list[NonFiniteOccurrence] = field(default_factory=list[NonFiniteOccurrence])
    ended_at_start: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    unstable: list[int] = field(default_factory=list[int])
    constant: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])


def watch(worlds: TaskWorlds, policy: Policy) -> TaskEpisodeFaults:
    """Plays an episode of each world under `policy`, whose answers must be finite, and returns the faults."""
    seen = TaskEpisodeFaults(worlds.count, "random actions" if policy.name == "random" else policy.name)
    known = set[tuple[str, str]]()

    def look(kind: str, values: np.ndarray, seeds: np.ndarray, period: int) -> None:
        """Records values `(k, …)` of episodes that are not finite."""
        for row, column in np.argwhere(~np.isfinite(values)).tolist():
            observed = worlds.observed[column] if kind == "observations" else None
            name = observed.name if observed else worlds.reward_names[column]
            term = observed.term if observed else name
            if (kind, term) not in known:
                known.add((kind, term))
                value, time = float(values[row, column]), period * float(worlds.task.control_dt)
                seen.not_finite.append(NonFiniteOccurrence(kind, name, term, value, time, int(seeds[row])))

    observations = worlds.reset(range(worlds.count))
    for seed, ending in enumerate(worlds.ended_at_start):
        if ending is not None:
            seen.ended_at_start.setdefault(ending.name, []).append(seed)
    look("observations", observations, np.arange(worlds.count), 0)
    lowest, highest = observations.min(axis=0), observations.max(axis=0)

    space = ActionSpace(worlds.action_names, worlds.actions.low, worlds.actions.high)
    actors = [policy.episode(seed, space) for seed in range(worlds.count)]
    running = np.arange(worlds.count)
    for period in range(1, min(worlds.task.periods, MOST) + 1):
        first = (period - 1) * worlds.control_steps, (period - 1) * float(worlds.task.control_dt)
        actions = [
            ask(actors[i], row, worlds.action_names, *first, policy.name)
            for i, row in zip(map(int, running), observations, strict=True)
        ]
        step = worlds.step(np.array(actions), running)
        seen.periods += len(running)
        is_unstable = np.array([ending is not None and ending.name == UNSTABLE.name for ending in step.ended])
        seen.unstable += running[is_unstable].tolist()
        look("rewards", step.reward_terms[~is_unstable], running[~is_unstable], period)
        look("observations", step.observations, running, period)
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


def place_of(problem: DocumentProblem, path: Path) -> Place:
    """Returns the file and line of a problem, whose place is `task.yaml:12:5`; `path` if it is not in a file."""
    file, _, position = problem.place.rpartition(":")
    file, _, line = file.rpartition(":")
    if not (file and line.isdecimal() and position.isdecimal()):
        return Place(path)
    return Place(Path(file), int(line))


class TaskChecker(Checker):
    """A checker of one task."""

    def __init__(self, task: CheckRequest, send: Callable[[dict[str, Any]], object]) -> None:
        super().__init__(task, send)
        self._written: list[Finding] = []  # a finding of both random actions and a policy is written once

    def check(self) -> None:
        self.write(stage="reading it")
        task = self._read()
        if task is None:
            return
        self.write(stage="loading its model")
        worlds = self._worlds(task)
        if worlds is None:
            return
        self.write(loaded=True)
        limit_this_process(memory=self.task.memory * MIB + ARENAS * COUNT * worlds.model(0).narena)
        places = TaskPlaces(task, self.path)
        self._write_selected(list(task_episodes.beyond_ranges(worlds, places)))

        self.write(stage="asking its policy")
        policy = self._policy(task)
        if self.task.steps and task_episodes.CODES.intersection(self.task.codes):
            self.write(stage="taking random actions")
            self._watch(worlds, load_policy(RANDOM), places)
        if policy is not None:
            self.write(stage="playing its policy")
            self._watch(worlds, policy, places)

    def _read(self) -> Task | None:
        """Returns the task; None if it cannot be read or has mistakes, which are written."""
        read = cast("Callable[[str], Task]", resolve_name(self.task.reader))
        try:
            require_file(self.path, "task document", YAML)
        except FileError as error:
            self._write_mistake(error)
            return None
        try:
            return read(self.task.path)
        except (UsageError, FileError) as error:
            self._write_mistakes(error)
        return None

    def _worlds(self, task: Task) -> TaskWorlds | None:
        """Returns worlds of the task; None if its model is missing or does not fit, which is written."""
        try:
            with collected_warnings():
                return TaskWorlds(task, COUNT, threads=1)
        except ModelError as error:
            self.write_findings(self._of_model(error, task.model))
        except (UsageError, FileError) as error:
            self._write_mistakes(error)
        return None

    def _of_model(self, error: ModelError, source: ModelSource) -> list[Finding]:
        """Returns findings that explain why the model of a task does not load."""
        if source.main_file is not None:
            return rule_runner.explain(error, read_xml(source.main_file))
        message, _, remedy = str(error).partition("\n")
        return [task_episodes.MISTAKE.in_model(self.path, message, remedy)]

    def _write_mistakes(self, error: MjrunError) -> None:
        """Writes the mistakes in the document; the model is not at fault."""
        self.write(loaded=True)
        if not isinstance(error, DocumentError):
            self._write_mistake(error)
            return
        for problem in error.problems:
            place = f"{problem.path}: {problem.message}" if problem.path else problem.message
            self.write_findings([task_episodes.MISTAKE.finding(place, "", place_of(problem, self.path))])

    def _write_mistake(self, error: MjrunError) -> None:
        message, _, remedy = error.spelled(option).partition("\n")
        message = message.removeprefix(f"{clean(str(self.path))}: ")
        self.write_findings([task_episodes.MISTAKE.in_model(self.path, message, remedy)])

    def _policy(self, task: Task) -> Policy | None:
        """Returns the requested policy; None without a request, or if it does not fit, which is reported."""
        if not self.task.policy:
            return None
        try:
            policy = load_policy(self.task.policy, trust=self.task.trust, normalize=self.task.normalize)
            check_agreement(task, policy)
        except MjrunError as error:
            self._write_misfit(error)
            return None
        return policy

    def _watch(self, worlds: TaskWorlds, policy: Policy, places: TaskPlaces) -> None:
        try:
            with collected_warnings(), without_timers():
                episodes = watch(worlds, policy)
        except MjrunError as error:
            self._write_misfit(error)
            return
        self._write_selected(list(task_episodes.episode_findings(episodes, places)))

    def _write_misfit(self, error: MjrunError) -> None:
        message, _, remedy = error.spelled(option).partition("\n")
        finding = task_episodes.MISFIT.finding(message, remedy, Place(self.path))
        self.write_findings([replace(finding, object="")])

    def _write_selected(self, findings: list[Finding]) -> None:
        for code, group in rule_runner.by_code(findings).items():
            if code in self.task.codes:
                news = [finding for finding in group if finding not in self._written]
                self._written += news
                self.write_findings(news)
