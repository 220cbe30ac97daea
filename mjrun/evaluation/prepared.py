"""An evaluation that is ready to run, with policies loaded, names and numbers checked; and the episodes that it plays.

The episodes are the points of a study: resumable, isolated, and on its engines. An episode is a function of its seed:
neither its process nor the episodes beside it change a bit of the result.
"""

import math
import pickle
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Self, overload

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, listing, option
from mjrun.evaluation.episode import (
    OUTCOMES,
    EpisodeGroupSpec,
    EpisodePlayer,
    EpisodeRecord,
    PlayedEpisodes,
    PolicyChoice,
    player_of,
)
from mjrun.evaluation.summaries import LENGTH, OWN, RETURN, REWARD, PassCriteria, names_beside_metrics, seed_column
from mjrun.experiment.design import SHORT_PATHS, Design, design
from mjrun.experiment.results_table import check_metric_names, plain_metrics, written_units
from mjrun.experiment.samplers import SAMPLES
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.override import ELEMENTS, ROOTS, Override, overrides_of, paths_of_field
from mjrun.model.source import ModelSource
from mjrun.options.evaluation import EXTRAS, EvaluationOptions
from mjrun.options.option import is_given, options_of
from mjrun.options.policy import BUILT_IN
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.simulation import NOISE_REQUIREMENT, DisturbanceOptions, Disturbances
from mjrun.options.sweep import PARTS, SAMPLER_DESCRIPTIONS, ExecutionOptions
from mjrun.options.task import TaskOptions
from mjrun.packages import require_all
from mjrun.python_code import CODE_REMEDY, PickledWithCode, edit_remarks, memory_warning, module_sources
from mjrun.reporter import Reporter
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.policy_episode import policy_files
from mjrun.study.part_files import point_keys, study_identity
from mjrun.study.prepared_points import PreparedPoints
from mjrun.study.spec import PointResult, ShippedStudy, StudyPoint, StudySpec
from mjrun.task.task import Task

POLICY, SEED = "policy", "seed"
DISTURBANCES = {each.name: each.kind for each in options_of(DisturbanceOptions)}  # parameters of every task
TIMES = ("control_dt", "duration")  # parameters of a task without a document

# Creates the task with changed values of its document, by their paths, such as `observations[0].noise`.
Rewritten = Callable[[Mapping[str, str]], ModelSource]
OUTCOME = "outcome"  # of a result, as an index of `OUTCOMES`; the message of a result is the ending
MOST = 64  # episodes that are played at once in this process


@dataclass(frozen=True)
class PolicyEpisodes:
    """Episodes of one policy at one point, before they are played.

    Attributes:
      policy: index of the policy: 0 for the evaluated one, 1 for the other.
      name: name of the policy.
      point: number of the point.
      spec: specification that the episodes share.
    """

    policy: int
    name: str
    point: int
    spec: EpisodeGroupSpec


class PreparedEvaluation:
    """An evaluation whose options are all checked. It reads copies of its files, so later edits change no result.

    Args:
      task: task to play.
      rewritten: see `Rewritten`.

    Attributes:
      task: task with the overrides of the options.
      points: parameters and the values of each point; one point without values if nothing varies.
      groups: groups of episodes by policy, then by point.
      modules: modules of the policies that are code, for processes that load them.
      metrics: names of the metrics.
      units: units of the parameters and metrics, by name; empty where unknown.
      player: player of the first group.
      criteria: requirements and thresholds.

    Raises:
      MissingExtraError: a library is not installed.
      UsageError: a name is unknown, a value is invalid, or a policy does not fit the task.
      FileError: a policy cannot be read.
    """

    def __init__(self, options: EvaluationOptions, task: ModelSource, rewritten: Rewritten | None) -> None:
        require_all(EXTRAS)
        self.task = task = replace(task, overrides=(*task.overrides, *overrides_of(options)))
        snapshot = InputSnapshot.empty().with_files((), of_models=task.files)
        with snapshot.original_names_in_errors():
            self.points = points_of(options, task.stored_at(snapshot.place))
            self.groups = self._grouped(options, task, rewritten, snapshot)
            chosen = [group.spec.chosen for group in self.groups]
            self.player = self._checked_players()  # imports the policies, and with them the modules that they import
            self.modules = module_sources(dict.fromkeys(each.policy for each in chosen if each.is_code))
            self._edited = edit_remarks(self.modules)
            self.metrics = [name for name, _ in plain_metrics(options.metric)]
            units = {**self.player.parameter_units(self.points.names), **self.player.metric_units()}
            self.units = {**units, **written_units(options.metric)}
            check_metric_names(
                options.metric,
                (*OWN, *OUTCOMES, *self.player.endings, *self.points.names, *names_beside_metrics(self.metrics)),
            )
            self.criteria = self._criteria(options)

    def remarks(self, seed: int) -> Iterator[str]:
        """Yields a remark on each policy that begins the episode of `seed` differently the second time.

        So it does on each module that was edited between its import and this evaluation, as in a notebook. It calls the
        policies in this process, so they should have played episodes without failures before.
        """
        yield from self._edited
        for group in {group.policy: group for group in reversed(self.groups)}.values():
            chosen = group.spec.chosen
            if isinstance(chosen.policy, str) and chosen.policy not in BUILT_IN:
                player = player_of(group.spec) if group.policy else self.player
                first, again = player.first_action(seed), player.first_action(seed)
                if not np.array_equal(first, again):
                    remedy = CODE_REMEDY if chosen.is_code else "export the network without random numbers"
                    yield memory_warning(f"{option('policy')} {clean(group.name)}", "episodes", remedy)

    @property
    def snapshot(self) -> InputSnapshot:
        """Copies of all files."""
        snapshot = self.groups[0].spec.chosen.snapshot
        assert snapshot
        return snapshot

    def _grouped(
        self, options: EvaluationOptions, task: ModelSource, rewritten: Rewritten | None, snapshot: InputSnapshot
    ) -> list[PolicyEpisodes]:
        values = [self.points.values(point) for point in range(len(self.points.points))]
        tasks = [task_at(task, each, rewritten) for each in values]
        policies = _policies(options, self.points)
        chosen = [[policy_at(policy, each) for each in values] for _, policy in policies]
        snapshot = snapshot.with_files(
            _files_of_policies([own for policy in chosen for own in policy]), of_models=_files_of_tasks(tasks)
        )
        metrics, groups = plain_metrics(options.metric), list[PolicyEpisodes]()
        for place, (name, policy) in enumerate(policies):
            for point, own in enumerate(chosen[place]):
                disturbances = disturbances_at(options.disturbances, self.points.names, values[point], tasks[point])
                spec = EpisodeGroupSpec(tasks[point], replace(own, snapshot=snapshot), metrics, disturbances)
                groups.append(PolicyEpisodes(place, name if own == policy else own.name, point, spec))
        return groups

    def _checked_players(self) -> EpisodePlayer:
        """Returns the player of the first group; creates those of other policies to check that they fit the task."""
        try:
            first = player_of(self.groups[0].spec)
        except UsageError as error:
            if error.path[:1] == ("set",) and {*error.path[1:2]} <= {*self.points.names}:
                error.path = ("vary", *error.path[1:])
            raise
        known = {self.groups[0].spec.chosen}
        for group in self.groups:
            if group.spec.chosen not in known:
                known.add(group.spec.chosen)
                with concerning("compare" if group.policy else "policy"):
                    player_of(group.spec)
        return first

    def _criteria(self, options: EvaluationOptions) -> PassCriteria:
        varying = [
            name for index, name in enumerate(self.points.names) if self.points.column(index).numbers is not None
        ]
        rewards = [f"{REWARD}{name}" for name in self.player.rewards]
        is_exact = seed_column(range(options.seed, options.seed + options.episodes)).numbers is not None
        own = [*(["seed"] if is_exact else []), "return", "length", "steps"]
        columns = [*varying, *own, *rewards, *self.metrics]
        return PassCriteria(options, columns, self.player.endings, can_succeed=self.player.can_succeed)


def _files_of_tasks(tasks: Sequence[ModelSource]) -> Iterator[Path]:
    models = dict.fromkeys(task.model if isinstance(task, Task) else task for task in tasks)
    for model in models:
        yield from model.files
    for task in tasks:
        yield from task.tables if isinstance(task, Task) else ()


def _files_of_policies(policies: Sequence[PolicyChoice]) -> Iterator[Path]:
    for policy in dict.fromkeys((each.policy, each.normalize) for each in policies if isinstance(each.policy, str)):
        yield from policy_files(*policy)


def _policies(options: EvaluationOptions, points: Design) -> list[tuple[str, PolicyChoice]]:
    """Returns the policies with unique names."""
    if POLICY in points.names:
        for name in ("policy", "compare"):
            if is_given(options, name):
                raise UsageError(
                    f"{option(name)} and {option('vary')} {POLICY} both select the policy; give only one", (name,)
                )
    elif options.policy is None:
        raise UsageError(f"select a policy with {option('policy')}: a file, FILE.py:NAME, random or zero", ("policy",))
    own = PolicyChoice(options.policy, options.normalize, options.trust)
    if options.compare is None:
        return [(own.name, own)]
    other = PolicyChoice(options.compare, options.compare_normalize, options.trust)
    if own.name != other.name:
        first, second = distinct_ends(own.name, other.name)
        return [(first, own), (second, other)]
    return [(f"{own.name} (1)", own), (f"{other.name} (2)", other)]


def distinct_ends(first: str, second: str) -> tuple[str, str]:
    """Returns the shortest ends of two different paths that differ: `a/p.onnx` and `b/p.onnx` of `runs/a/p.onnx` and
    `runs/b/p.onnx`.
    """
    one, other = re.split(r"[/\\]", first), re.split(r"[/\\]", second)
    count = next((n for n in range(1, max(len(one), len(other))) if one[-n:] != other[-n:]), 0)  # 0: whole
    return "/".join(one[-count:]), "/".join(other[-count:])


def points_of(options: EvaluationOptions, task: ModelSource) -> Design:
    """Returns the points that `options` describe; one without values if nothing varies.

    Raises:
      UsageError: a parameter cannot vary, or a value is invalid.
    """
    if options.repeats != 1:
        raise UsageError(f"{option('repeats')}: use {option('episodes')} to repeat each point")
    if options.sampler in SAMPLES:
        sampler = f"{option('sampler')} {options.sampler}"
        others = [name for name in SAMPLER_DESCRIPTIONS if name not in SAMPLES]
        raise UsageError(f"{sampler} is for studies, which compute sensitivities\nsamplers: {listing(others)}")
    if not any((options.vary, options.points, options.correlate, options.when, options.where)):
        return Design((), [()])
    if any(path == SEED for path, _ in options.vary):
        with concerning("vary", SEED):
            message = f"{option('vary')} {SEED}: each episode has a separate seed; see {option('episodes')}"
            raise UsageError(message)
    return design(options, task.load(), options.seed)


def task_at(task: ModelSource, values: Mapping[str, str], rewritten: Rewritten | None) -> ModelSource:
    """Returns the task of the point at which parameters have `values`.

    Args:
      rewritten: see `Rewritten`; None for a task without a document.

    Raises:
      UsageError: a parameter is unknown, or a value is invalid.
    """
    overrides = list[Override]()
    changes = dict[str, str]()
    for name, text in values.items():
        if name == POLICY or name in DISTURBANCES:
            continue
        path = name.removeprefix("scale:").removeprefix("add:")
        if name in SHORT_PATHS or path.partition(".")[0] in ROOTS or path.partition("/")[0] in ELEMENTS:
            overrides.append(Override(SHORT_PATHS.get(name, name), text))
        else:
            changes[name] = text
            _require_known(name)
    if changes:
        task = replace(rewritten(changes), overrides=task.overrides) if rewritten else _with_times(task, changes)
    return replace(task, overrides=(*task.overrides, *overrides)) if overrides else task


def _require_known(name: str) -> None:
    """Refuses a parameter that is a field of the model without its path, such as `friction`."""
    own = {each.key for each in options_of(TaskOptions)}
    if "." not in name and name.partition("[")[0] not in own and (meant := paths_of_field(name)):
        with concerning("vary", name):
            valid = [POLICY, *DISTURBANCES, *SHORT_PATHS, "opt.FIELD", "KIND/NAME.FIELD", "keys of the task"]
            raise UnknownNameError("parameter", name, valid, where=option("vary"), meant=meant)


def policy_at(chosen: PolicyChoice, values: Mapping[str, str]) -> PolicyChoice:
    """Returns the policy of the point at which parameters have `values`."""
    return replace(chosen, policy=values[POLICY]) if POLICY in values else chosen


def disturbances_at(
    disturbances: Disturbances, names: Sequence[str], values: Mapping[str, str], task: ModelSource
) -> Disturbances:
    """Returns the disturbances of the point at which parameters have `values`.

    Where noise is a parameter that does not exist at the point, its correlation is left out.

    Args:
      names: the parameters.
      task: the task of the point, which may contain noise.

    Raises:
      UsageError: the value of a disturbance is invalid.
    """
    varied = dict[str, object]()
    for name in DISTURBANCES.keys() & values.keys():
        kind = DISTURBANCES[name]
        try:
            varied[name] = kind(kind.parse(values[name]))
        except InvalidValueError as error:
            with concerning("vary", name):
                raise BadValueError(f"{option('vary')} {name}", values[name], error.expected) from None
    changed = replace(disturbances, **varied)
    varies = NOISE_REQUIREMENT.partner in names and NOISE_REQUIREMENT.name not in varied
    is_silent = changed.ctrl_noise is None and not (isinstance(task, Task) and task.ctrl_noise)
    return replace(changed, ctrl_noise_time=None) if varies and is_silent else changed


def _with_times(task: ModelSource, changes: Mapping[str, str]) -> ModelSource:
    for name in changes:
        if not isinstance(task, Task) or name not in TIMES:
            valid = [
                POLICY,
                *DISTURBANCES,
                *SHORT_PATHS,
                *(TIMES if isinstance(task, Task) else ()),
                "opt.FIELD",
                "KIND/NAME.FIELD",
            ]
            with concerning("vary", name):
                raise UnknownNameError("parameter", name, valid, where=option("vary"))
    try:
        return replace(task, **changes)
    except BadValueError as error:
        name = str(error.path[0])
        with concerning("vary", name):
            raise UsageError(f"{option('vary')} {clean(name)}: {error}") from None


# --- the episodes ------------------------------------------------------------------------------------


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
            if key not in records or records[key].status != "ok":  # two groups may have the same episodes
                record = self._record(self._seeds[index % count], self.known[index])
                if key not in records or record.status == "ok" or records[key].status == "missing":
                    records[key] = record
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
