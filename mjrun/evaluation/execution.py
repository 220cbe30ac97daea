"""Execution of all episodes of an evaluation, as the points of a study: resumable, isolated, and on its engines.

An episode is a function of its seed: neither its process nor the episodes beside it change a bit of the result.
"""

import math
import pickle
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Self, overload

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, option
from mjrun.evaluation.episode import OUTCOMES, EpisodeGroupSpec, EpisodePlayer, EpisodeRecord, PlayedEpisodes, player_of
from mjrun.evaluation.prepared import PolicyEpisodes, PreparedEvaluation
from mjrun.evaluation.summaries import LENGTH, RETURN, REWARD
from mjrun.experiment.design import Design
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.source import ModelSource
from mjrun.options.option import is_given
from mjrun.options.sweep import PARTS, ExecutionOptions
from mjrun.python_code import PickledWithCode
from mjrun.reporter import Reporter
from mjrun.study.part_files import point_keys, study_identity
from mjrun.study.prepared_points import PreparedPoints
from mjrun.study.spec import PointResult, ShippedStudy, StudyPoint, StudySpec
from mjrun.task.task import Task

OUTCOME = "outcome"  # of a result, as an index of `OUTCOMES`; the message of a result is the ending
MOST = 64  # episodes that are played at once in this process


@dataclass(frozen=True)
class EvaluationSpec:
    """The specification of the episodes of several groups, in this order; a picklable value.

    Attributes:
      groups: specification of each group.
      count: number of episodes of each group.
      rewards: names of the terms of the reward.
    """

    groups: tuple[EpisodeGroupSpec, ...]
    count: int
    rewards: tuple[str, ...]

    @property
    def numbers(self) -> list[str]:
        """Names of the numbers of a result."""
        metrics = [name for name, _ in self.groups[0].metrics]
        return [RETURN, LENGTH, OUTCOME, *(f"{REWARD}{name}" for name in self.rewards), *metrics]

    def stored_at(self, root: Path) -> Self:
        """Returns the same specification, whose files are in the folder `root`."""
        return replace(self, groups=tuple(group.stored_at(root) for group in self.groups))

    def simulator(self) -> "EpisodeSimulator":
        """Returns the simulator of the episodes."""
        return EpisodeSimulator(self)

    def models(self, points: Iterable[Sequence[str]]) -> list[ModelSource]:
        """Returns the task, whose environment all episodes share."""
        return [self.groups[0].task]

    @property
    def packages(self) -> Sequence[str]:
        """The packages that compute the actions."""
        specs = [StudySpec(group.simulation(), (), ()) for group in self.groups]
        return list(dict.fromkeys(package for spec in specs for package in spec.packages))


class EpisodeSimulator:
    """A simulator of episodes; those of one group that arrive together are played side by side."""

    def __init__(self, spec: EvaluationSpec) -> None:
        self._spec, self._group = spec, -1
        self._snapshot = spec.groups[0].chosen.snapshot
        self._player: EpisodePlayer

    def run(self, points: Sequence[StudyPoint]) -> Iterator[Sequence[PointResult]]:
        """Yields the results of episodes, group by group."""
        by_group = dict[int, list[StudyPoint]]()
        for point in points:
            by_group.setdefault(point.index // self._spec.count, []).append(point)
        for group, some in by_group.items():
            with collected_warnings():  # which the parent process reports
                played = self._played(group, some)
            yield played

    def _played(self, group: int, points: Sequence[StudyPoint]) -> list[PointResult]:
        start, seeds = time.perf_counter(), [int(point.values[-1]) for point in points]
        try:
            if group != self._group:
                self._group, self._player = -1, player_of(self._spec.groups[group])
                self._group = group
            episodes = self._player.play(seeds)
        except Exception as error:  # of all episodes, such as a value of a point that its model refuses
            self._group = -1
            if len(points) > 1:
                return [result for point in points for result in self._played(group, [point])]
            return [PointResult.failed(points[0].index, error, len(self._spec.numbers), self._snapshot)]
        wall = (time.perf_counter() - start) / len(points)
        return [self._result(point, episode, wall) for point, episode in zip(points, episodes, strict=True)]

    def _result(self, point: StudyPoint, episode: EpisodeRecord, wall: float) -> PointResult:
        outcome = OUTCOMES.index(episode.outcome) if episode.status == "ok" else math.nan
        rewards = episode.rewards
        terms = [rewards.get(name, math.nan) for name in self._spec.rewards]
        numbers = (episode.total, episode.length, outcome, *terms, *episode.metrics)
        message = episode.ending
        if episode.status != "ok":
            message = self._snapshot.with_original_names(episode.message) if self._snapshot else episode.message
        return PointResult(point.index, episode.status, numbers, episode.steps, episode.exit_code, message, wall)


class _EpisodeParameters(Sequence[tuple[str, ...]]):
    """The values of each episode: those of its group, and its seed. They are made on demand, for many episodes.

    Args:
      groups: values of each group.
      seeds: seeds of the episodes of each group.
    """

    def __init__(self, groups: Sequence[tuple[str, ...]], seeds: Sequence[int]) -> None:
        self._groups, self._seeds = groups, seeds

    def __len__(self) -> int:
        return len(self._groups) * len(self._seeds)

    @overload
    def __getitem__(self, index: int) -> tuple[str, ...]: ...
    @overload
    def __getitem__(self, index: slice) -> list[tuple[str, ...]]: ...
    def __getitem__(self, index: int | slice) -> tuple[str, ...] | list[tuple[str, ...]]:
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        group, place = divmod(range(len(self))[index], len(self._seeds))
        return (*self._groups[group], str(self._seeds[place]))


class PreparedEpisodes(PreparedPoints):
    """Episodes that are ready to be played in processes.

    Args:
      prepared: the evaluation.
      groups: those of its groups whose policies are named by texts.
      seeds: seeds of the episodes of each group.
      folder: folder of the evaluation.
    """

    def __init__(
        self, prepared: PreparedEvaluation, groups: Sequence[PolicyEpisodes], seeds: Sequence[int], folder: Path
    ) -> None:
        specs = tuple(group.spec for group in groups)
        spec = EvaluationSpec(specs, len(seeds), tuple(prepared.player.rewards))
        self._episodes, self._seeds, self._task = spec, seeds, prepared.task
        several = len({group.policy for group in groups}) > 1
        names = (*(["policy"] if several else []), *prepared.points.names, "seed")
        values = _EpisodeParameters(
            [(*([group.name] if several else []), *prepared.points.points[group.point]) for group in groups], seeds
        )
        pickled = PickledWithCode(pickle.dumps(spec), prepared.modules)
        shipped = ShippedStudy(pickled, len(spec.numbers), prepared.snapshot)
        super().__init__(spec, Design(names, values), shipped, folder, spec.numbers)

    @property
    def noun(self) -> str:
        return "episode"

    def taken_records(self) -> list[list[EpisodeRecord]]:
        """Returns the records of the episodes of each group."""
        records, count = dict[str, EpisodeRecord](), len(self._seeds)
        for index, key in enumerate(self.keys):
            if key not in records:  # two groups may have the same episodes
                records[key] = self._record(self._seeds[index % count], self.known[index])
        keys = [self.keys[start : start + count] for start in range(0, len(self.keys), count)]
        return [[records[key] for key in some] for some in keys]

    def _record(self, seed: int, result: PointResult) -> EpisodeRecord:
        total, length, outcome, *numbers = result.metrics
        rewards = self._episodes.rewards
        sums, metrics = tuple(numbers[: len(rewards)]), tuple(numbers[len(rewards) :])
        if result.status != "ok":
            return EpisodeRecord.failed(seed, result, rewards, len(metrics))
        ending = result.message, OUTCOMES[int(outcome)]
        return EpisodeRecord(seed, total, result.steps, length, *ending, rewards, sums, metrics)

    def keys_of(self, indices: Sequence[int] | np.ndarray) -> list[str]:
        return [self._all_keys[index] for index in indices]

    @cached_property
    def _all_keys(self) -> list[str]:
        """The key of each episode, which does not depend on the number of episodes or other policies."""
        keys, models = list[str](), dict[ModelSource, mujoco.MjModel]()
        for group in self._episodes.groups:
            task = replace(group.task, overrides=self._task.overrides)  # the others are in the identity
            source = task.model if isinstance(task, Task) else task
            if source not in models:
                models[source] = task.stored_at(self.shipped.snapshot.place).load()
            spec = StudySpec(group.simulation(), ("seed",), group.metrics)
            identity = study_identity(spec, models[source], self.shipped.spec.modules)
            keys += point_keys(identity, spec, ((str(seed),) for seed in self._seeds))
        return keys


def play_all(
    prepared: PreparedEvaluation, options: ExecutionOptions, seeds: Sequence[int], folder: Path, reporter: Reporter
) -> tuple[list[PlayedEpisodes], int]:
    """Plays the episodes of `seeds` of each group; returns all of them, and how many of them were not known already.

    Python policies that are not named by a text play in this process, since no other could create them. Nothing
    identifies their code, so that these episodes are always played.
    """
    groups, simulated = prepared.groups, 0
    records = dict[int, list[EpisodeRecord]]()
    shared = [place for place, group in enumerate(groups) if isinstance(group.spec.chosen.policy, str)]
    for name in ("time_limit", "time_budget", "max_failures") if len(shared) < len(groups) else ():
        if is_given(options, name):
            message = f"{option(name)} requires a policy that other processes can load: a file or FILE.py:NAME"
            raise UsageError(message, (name,))
    if shared:
        episodes = PreparedEpisodes(prepared, [groups[place] for place in shared], seeds, folder)
        episodes.files.create()
        episodes.warn(reporter)
        missing = episodes.missing(options.retry_failed)
        episodes.note_known(missing, reporter)
        if missing:
            simulated = episodes.simulate(missing, options, reporter).total()
        records |= zip(shared, episodes.taken_records(), strict=True)
    for place, group in enumerate(groups):
        if place not in records:
            records[place] = _played_here(group.spec, seeds, reporter)
            simulated += len(seeds)
    played = [PlayedEpisodes(group.name, group.point, records[place]) for place, group in enumerate(groups)]
    return played, simulated


def _played_here(spec: EpisodeGroupSpec, seeds: Sequence[int], reporter: Reporter) -> list[EpisodeRecord]:
    player, episodes = player_of(spec), list[EpisodeRecord]()
    for start in range(0, len(seeds), MOST):
        episodes += player.play(seeds[start : start + MOST])
        reporter.progress("episodes", len(episodes), len(seeds))
    return episodes


def forget_code(groups: Sequence[PlayedEpisodes], prepared: PreparedEvaluation, folder: Path) -> None:
    """Removes the results of a complete evaluation of code, which may have read files that nothing keeps track of."""
    is_complete = all(episode.status == "ok" for group in groups for episode in group.episodes)
    if is_complete and any(group.spec.chosen.is_code for group in prepared.groups):
        shutil.rmtree(folder / PARTS, ignore_errors=True)
