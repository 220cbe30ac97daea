"""An evaluation that can run: every policy loaded, every name found and every number checked; nothing is written."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.criteria import Criteria
from mjrun.evaluation.episode import OUTCOMES, EpisodeSpec, PolicyChoice
from mjrun.evaluation.player import EpisodePlayer, player_of
from mjrun.evaluation.table import OWN, REWARD
from mjrun.experiment.design import Design, design, numbers
from mjrun.experiment.results_table import check_metric_names
from mjrun.model.override import ELEMENTS, ROOTS, Override, overrides_of
from mjrun.model.source import Source
from mjrun.options.evaluation import EXTRAS, EvaluationOptions
from mjrun.options.option import is_given
from mjrun.options.policy import is_code
from mjrun.packages import require_all
from mjrun.physics.parameter_grid import SHORT
from mjrun.python_code import module_sources
from mjrun.simulation.episode import policy_files
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.task.task import Task

POLICY, SEED = "policy", "seed"
TIMES = ("control_dt", "duration")  # of a task, which are values of their own

# The task with values of its document by their paths, such as `observations[0].noise`.
Rewritten = Callable[[Mapping[str, str]], Source]


@dataclass(frozen=True)
class EpisodeGroup:
    """The episodes of one policy at one point, which are to be played.

    Attributes:
      policy: its place: 0 for the one that is asked about, 1 for the other.
      name: of the policy.
      point: the number of the point.
      spec: what the episodes have in common.
    """

    policy: int
    name: str
    point: int
    spec: EpisodeSpec


class PreparedEvaluation:
    """What `options` describe, checked.

    Args:
      task: what is played.
      rewritten: makes the task of other values of its document.

    Attributes:
      points: what varies; one point without values where nothing does.
      groups: by policies, and then by points.
      metrics: their names.
      player: of the first group.
      criteria: what is required.

    Raises:
      MissingExtraError: a library is not installed.
      UsageError: a name that nothing has, or a value that cannot be; a policy that does not fit.
      FileError: a policy cannot be read.
    """

    def __init__(self, options: EvaluationOptions, task: Source, rewritten: Rewritten | None) -> None:
        require_all(EXTRAS)
        task = replace(task, overrides=(*task.overrides, *overrides_of(options)))
        with_task = InputSnapshot.empty().with_files(task.files)
        with with_task.original_names_in_errors():
            self._prepare(options, task, rewritten, with_task)

    def _prepare(
        self, options: EvaluationOptions, task: Source, rewritten: Rewritten | None, snapshot: InputSnapshot
    ) -> None:
        """Prepares everything from copies of the files: from here on, edits of the files change no result."""
        self.points = points_of(options, task.stored_at(snapshot.place))
        tasks = [task_at(task, self.values(point), rewritten) for point in range(len(self.points.points))]
        policies = _policies(options, self.points)
        chosen = [
            (place, name, policy, point, policy_at(policy, self.values(point)))
            for place, (name, policy) in enumerate(policies)
            for point in range(len(tasks))
        ]
        snapshot = snapshot.with_files(_files(tasks, [own for *_, own in chosen]))
        self.groups: list[EpisodeGroup] = []
        for place, name, policy, point, own in chosen:
            code = [own.policy] if is_code(str(own.policy)) else []
            stored = replace(own, snapshot=snapshot, modules=module_sources(code))
            spec = EpisodeSpec(tasks[point].stored_at(snapshot.place), stored, options.metric)
            self.groups.append(EpisodeGroup(place, name if own == policy else own.name, point, spec))
        self.metrics = [name for name, _ in options.metric]
        self.player = self._checked_players()
        check_metric_names(options.metric, (*OWN, *OUTCOMES, *self.player.endings, *self.points.names))
        varying = [
            name
            for index, name in enumerate(self.points.names)
            if numbers([values[index] for values in self.points.points]) is not None
        ]
        rewards = [f"{REWARD}{name}" for name in self.player.rewards]
        columns = [*varying, "seed", "return", "length", "steps", *rewards, *self.metrics]
        self.criteria = Criteria(
            options,
            columns,
            self.player.endings,
            can_succeed=self.player.can_succeed,
            compared=options.compare is not None,
        )

    def values(self, point: int) -> dict[str, str]:
        """What varies, and its values at a point."""
        return dict(zip(self.points.names, self.points.points[point], strict=True))

    def _checked_players(self) -> EpisodePlayer:
        """The player of the first group; those of other policies are made too, to see that each fits the task."""
        first = player_of(self.groups[0].spec)
        known = {self.groups[0].spec.chosen}
        for group in self.groups:
            if group.spec.chosen not in known:
                known.add(group.spec.chosen)
                with concerning("compare" if group.policy else "policy"):
                    player_of(group.spec)
        return first


def _files(tasks: Sequence[Source], policies: Sequence[PolicyChoice]) -> Iterator[Path]:
    """The files that tasks and policies are read from."""
    models = dict.fromkeys(task.model if isinstance(task, Task) else task for task in tasks)
    for model in models:
        yield from model.files
    for task in tasks:
        yield from task.tables if isinstance(task, Task) else ()
    for policy in dict.fromkeys((each.policy, each.normalize) for each in policies if isinstance(each.policy, str)):
        yield from policy_files(*policy)


def _policies(options: EvaluationOptions, points: Design) -> list[tuple[str, PolicyChoice]]:
    """The policies and their names."""
    if POLICY in points.names:
        for name in ("policy", "compare"):
            if is_given(options, name):
                raise UsageError(f"{option(name)} and {option('vary')} {POLICY} both say who plays", (name,))
    elif options.policy is None:
        raise UsageError(f"say with {option('policy')} who plays: a file, FILE.py:NAME, random or zero", ("policy",))
    if options.compare_normalize is not None and options.compare is None:
        raise UsageError(f"{option('compare_normalize')} goes with {option('compare')}", ("compare_normalize",))
    own = PolicyChoice(options.policy, options.normalize, options.trust)
    if options.compare is None:
        return [(own.name, own)]
    other = PolicyChoice(options.compare, options.compare_normalize, options.trust)
    if own.name != other.name:
        return [(own.name, own), (other.name, other)]
    return [(f"{own.name} (1)", own), (f"{other.name} (2)", other)]


def points_of(options: EvaluationOptions, task: Source) -> Design:
    """The points that `options` describe; one without values where nothing varies.

    Raises:
      UsageError: what cannot vary, or values that cannot be.
    """
    if options.repeats != 1:
        raise UsageError(f"{option('repeats')}: episodes repeat each point; {option('episodes')} says how often")
    if not options.vary and options.points is None:
        return Design((), [()])
    if any(path == SEED for path, _ in options.vary):
        with concerning("vary", SEED):
            message = f"{option('vary')} {SEED}: each episode has a seed of its own; see {option('episodes')}"
            raise UsageError(message)
    return design(options, task.load(), options.seed)


def task_at(task: Source, values: Mapping[str, str], rewritten: Rewritten | None) -> Source:
    """The task of the point at which names have `values`.

    Args:
      rewritten: makes the task of other values of its document; None where it comes from none.

    Raises:
      UsageError: a name that nothing has, or a value that cannot be.
    """
    overrides = list[Override]()
    changes = dict[str, str]()
    for name, text in values.items():
        if name == POLICY:
            continue
        if name in SHORT or _is_of_model(name):
            overrides.append(Override(SHORT.get(name, name), text))
        else:
            changes[name] = text
    if changes:
        task = replace(rewritten(changes), overrides=task.overrides) if rewritten else _with_times(task, changes)
    return replace(task, overrides=(*task.overrides, *overrides)) if overrides else task


def policy_at(chosen: PolicyChoice, values: Mapping[str, str]) -> PolicyChoice:
    """Who plays at the point at which names have `values`."""
    return replace(chosen, policy=values[POLICY]) if POLICY in values else chosen


def _is_of_model(name: str) -> bool:
    """Whether it is a path of the model, `geom/floor.friction` or `opt.gravity`, and not one of the document."""
    path = name.removeprefix("scale:").removeprefix("add:")
    return path.partition(".")[0] in ROOTS or path.partition("/")[0] in ELEMENTS


def _with_times(task: Source, changes: Mapping[str, str]) -> Source:
    for name in changes:
        if not isinstance(task, Task) or name not in TIMES:
            valid = [POLICY, *SHORT, *(TIMES if isinstance(task, Task) else ()), "opt.FIELD", "KIND/NAME.FIELD"]
            with concerning("vary", name):
                raise UnknownNameError("parameter", name, valid, where=option("vary"))
    try:
        return replace(task, **changes)
    except BadValueError as error:
        name = str(error.path[0])
        with concerning("vary", name):
            raise UsageError(f"{option('vary')} {clean(name)}: {error}") from None
