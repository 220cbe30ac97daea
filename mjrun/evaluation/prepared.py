"""An evaluation that is ready to run: policies loaded, names and numbers checked, nothing written."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.episode import OUTCOMES, EpisodeGroupSpec, EpisodePlayer, PolicyChoice, player_of
from mjrun.evaluation.summaries import IQM, OWN, RETURN, REWARD, PassCriteria, seed_column
from mjrun.experiment.design import SHORT_PATHS, Design, design
from mjrun.experiment.results_table import check_metric_names, plain_metrics, written_units
from mjrun.experiment.samplers import SAMPLES
from mjrun.model.override import ELEMENTS, ROOTS, Override, overrides_of, paths_of_field
from mjrun.model.source import ModelSource
from mjrun.options.evaluation import EXTRAS, EvaluationOptions
from mjrun.options.option import is_given, options_of
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.simulation import NOISE_REQUIREMENT, DisturbanceOptions, Disturbances
from mjrun.options.task import TaskOptions
from mjrun.packages import require_all
from mjrun.python_code import edit_remarks, memory_warning, module_sources
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.policy_episode import policy_files
from mjrun.task.task import Task

POLICY, SEED = "policy", "seed"
DISTURBANCES = {each.name: each.kind for each in options_of(DisturbanceOptions)}  # parameters of every task
TIMES = ("control_dt", "duration")  # parameters of a task without a document

# Creates the task with changed values of its document, by their paths, such as `observations[0].noise`.
Rewritten = Callable[[Mapping[str, str]], ModelSource]


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
      units: units of the metrics, by name; empty where unknown.
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
        snapshot = InputSnapshot.empty().with_files((), task.files)
        with snapshot.original_names_in_errors():
            self.points = points_of(options, task.stored_at(snapshot.place))
            self.groups = self._grouped(options, task, rewritten, snapshot)
            chosen = [group.spec.chosen for group in self.groups]
            self.player = self._checked_players()  # imports the policies, and with them the modules that they import
            self.modules = module_sources(dict.fromkeys(each.policy for each in chosen if each.is_code))
            self._edited = edit_remarks(self.modules)
            self.metrics = [name for name, _ in plain_metrics(options.metric)]
            self.units = {**self.player.metric_units(), **written_units(options.metric)}
            check_metric_names(
                options.metric, (*OWN, RETURN + IQM, *OUTCOMES, *self.player.endings, *self.points.names)
            )
            self.criteria = self._criteria(options)

    def remarks(self, seed: int) -> Iterator[str]:
        """Yields a remark on each policy in Python that begins the episode of `seed` differently the second time.

        So it does on each module that was edited between its import and this evaluation, as in a notebook. It calls the
        policies in this process, so they should have played episodes without failures before.
        """
        yield from self._edited
        for group in {group.policy: group for group in reversed(self.groups)}.values():
            if group.spec.chosen.is_code:
                player = player_of(group.spec) if group.policy else self.player
                first, again = player.first_action(seed), player.first_action(seed)
                if not np.array_equal(first, again):
                    yield memory_warning(f"{option('policy')} {clean(group.name)}", "episodes")

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
            _files_of_policies([own for policy in chosen for own in policy]), _files_of_tasks(tasks)
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
        first = player_of(self.groups[0].spec)
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
        return [(own.name, own), (other.name, other)]
    return [(f"{own.name} (1)", own), (f"{other.name} (2)", other)]


def points_of(options: EvaluationOptions, task: ModelSource) -> Design:
    """Returns the points that `options` describe; one without values if nothing varies.

    Raises:
      UsageError: a parameter cannot vary, or a value is invalid.
    """
    if options.repeats != 1:
        raise UsageError(f"{option('repeats')}: use {option('episodes')} to repeat each point")
    if options.sampler in SAMPLES:
        sampler = f"{option('sampler')} {options.sampler}"
        raise UsageError(f"{sampler} is for studies, which compute sensitivities; use sobol, halton or random")
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
