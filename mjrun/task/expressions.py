"""The expressions of a task in n worlds: rewards, terminations, and values that are observed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import concerning
from mjrun.probe.task_expression import (
    TaskColumns,
    TaskEvaluator,
    TaskExpression,
    parse_task_condition,
    parse_task_value,
)
from mjrun.task.episode import Ending
from mjrun.task.task import Task
from mjrun.task.terms import TIMED_OUT, UNSTABLE
from mjrun.timeline import seconds

ACTION, COMMAND, TIME = "action/", "command/", "time"  # columns of a task besides those of its model
RUNNING = -1  # instead of an ending


@dataclass(frozen=True, eq=False)
class Inputs:
    """What went into k worlds up to a control instant.

    Attributes:
      instants: control instants since the reset `(k,)`.
      actions: the last ones `(k, nact)`.
      commands: `(k, ncommands)`.
    """

    instants: np.ndarray
    actions: np.ndarray
    commands: np.ndarray


class TaskExpressions:
    """What rewards and ends the episodes of n worlds, and the values that are observed.

    Args:
      task: whose expressions they are.
      columns: that they can read.
      values: those that are observed, by the name of the term.
      names: of the numbers of an action and of the commands.
      count: worlds.

    Attributes:
      measured: the columns of the model that they read.
      endings: how episodes can end; the terminations of the task first, in their order.

    Raises:
      UnknownNameError: a name is that of no column or function.
      UsageError: a text is no expression.
    """

    def __init__(
        self,
        task: Task,
        columns: TaskColumns,
        values: Mapping[str, TaskExpression],
        names: tuple[Sequence[str], Sequence[str]],
        count: int,
    ) -> None:
        self._control_dt = task.control_dt
        self._names = [f"{ACTION}{name}" for name in names[0]], [f"{COMMAND}{name}" for name in names[1]]
        rewards = dict(_rewards(task, columns))
        conditions = dict(_conditions(task, columns))
        self._weights = [reward.weight for reward in task.rewards.values()]
        self._rewards = [each.evaluator(count) for each in rewards.values()]
        self._conditions = [each.evaluator(count) for each in conditions.values()]
        self._values = {name: each.evaluator(count) for name, each in values.items()}
        self.endings: Sequence[Ending] = [
            *(termination.ending(name) for name, termination in task.terminations.items()),
            TIMED_OUT,
            UNSTABLE,
        ]
        read = [
            column for each in (*rewards.values(), *conditions.values(), *values.values()) for column in each.columns
        ]
        own = {TIME, *self._names[0], *self._names[1]}
        self.measured = [column for column in dict.fromkeys(read) if column not in own]
        self._reads_time = TIME in read
        self._reads_inputs = tuple(bool({*names} & {*read}) for names in self._names)

    def columns(self, measured: np.ndarray, inputs: Inputs) -> dict[str, np.ndarray]:
        """The columns that expressions read, `(k,)` each, from those of the model `(k, len(self.measured))`."""
        columns = dict(zip(self.measured, np.ascontiguousarray(measured.T), strict=True))
        if self._reads_time:
            columns[TIME] = np.asarray(seconds(inputs.instants, self._control_dt), float)
        for read, names, values in zip(self._reads_inputs, self._names, (inputs.actions, inputs.commands), strict=True):
            if read:
                columns |= zip(names, np.ascontiguousarray(values.T), strict=True)
        return columns

    def begin(self, columns: Mapping[str, np.ndarray], ids: np.ndarray | None) -> None:
        """Takes note of the first instant of episodes, for what looks back at it."""
        for each in (*self._rewards, *self._conditions):
            each.begin(columns, ids)

    def rewards(self, columns: Mapping[str, np.ndarray], ids: np.ndarray | None, count: int) -> np.ndarray:
        """The weighted terms of the reward `(nterms, k)` of `count` worlds."""
        terms = np.empty((len(self._rewards), count))
        for term, each, weight in zip(terms, self._rewards, self._weights, strict=True):
            np.multiply(each.advance(columns, ids), weight, out=term)
        return terms

    def codes(self, columns: Mapping[str, np.ndarray], ids: np.ndarray | None, count: int) -> np.ndarray:
        """Which of the terminations holds `(k,)`, the first of several; −1 where none does."""
        codes = np.full(count, RUNNING)
        for code in range(len(self._conditions) - 1, -1, -1):
            codes[self._conditions[code].advance(columns, ids)] = code
        return codes

    def values(
        self, columns: Mapping[str, np.ndarray], ids: np.ndarray | None, first: bool
    ) -> Mapping[str, np.ndarray]:
        """The values that are observed, `(k,)` by the name of their term."""
        return {name: _next(each, columns, ids, first) for name, each in self._values.items()}


def _next(each: TaskEvaluator, columns: Mapping[str, np.ndarray], ids: np.ndarray | None, first: bool) -> np.ndarray:
    return each.begin(columns, ids) if first else each.advance(columns, ids)


def _rewards(task: Task, columns: TaskColumns) -> Iterator[tuple[str, TaskExpression]]:
    for name, reward in task.rewards.items():
        with concerning("rewards", name, "value"):
            yield name, parse_task_value(reward.value, columns, f"rewards.{name}")


def _conditions(task: Task, columns: TaskColumns) -> Iterator[tuple[str, TaskExpression]]:
    for name, termination in task.terminations.items():
        with concerning("terminations", name, "when"):
            yield name, parse_task_condition(termination.when, columns, f"terminations.{name}.when")
