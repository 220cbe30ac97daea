"""What varies between the episodes besides their seeds: the task of each point, and who plays it."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, option
from mjrun.evaluation.episode import PolicyChoice
from mjrun.model.override import ELEMENTS, ROOTS, Override
from mjrun.model.source import Source
from mjrun.options.evaluation import EvaluationOptions
from mjrun.physics.parameter_grid import SHORT
from mjrun.study.design import Design, design
from mjrun.task.task import Task

POLICY, SEED = "policy", "seed"
TIMES = ("control_dt", "duration")  # of a task, which are values of their own

# The task with values of its document by their paths, such as `observations[0].noise`.
Rewritten = Callable[[Mapping[str, str]], Source]


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
