"""The expressions of a task in n worlds: rewards, terminations, and values that are observed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import concerning
from mjrun.probe.column_matrix import ColumnLayout, ColumnMatrix
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
        own_columns = [f"{ACTION}{name}" for name in names[0]], [f"{COMMAND}{name}" for name in names[1]]
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
        own = {TIME, *own_columns[0], *own_columns[1]}
        self.measured = [column for column in dict.fromkeys(read) if column not in own]
        self._reads_time = TIME in read
        self._reads_actions, self._reads_commands = (not {*read}.isdisjoint(own_names) for own_names in own_columns)
        columns_of = [self.measured]
        columns_of += [own_columns[0]] if self._reads_actions else []
        columns_of += [own_columns[1]] if self._reads_commands else []
        self._layout = ColumnLayout([name for part in columns_of for name in part])

    def columns(self, measured: np.ndarray, inputs: Inputs) -> ColumnMatrix:
        """The columns that expressions read, `(k,)` each, from those of the model `(k, len(self.measured))`."""
        read = [measured]
        read += [inputs.actions] if self._reads_actions else []
        read += [inputs.commands] if self._reads_commands else []
        matrix = np.concatenate(read, axis=1) if len(read) > 1 else measured
        others = {TIME: self._time(inputs.instants)} if self._reads_time else {}
        return ColumnMatrix(self._layout, matrix, others)

    def _time(self, instants: np.ndarray) -> np.ndarray:
        """The time of control instants [s], exact and rounded once."""
        return instants * self._control_dt.numerator / self._control_dt.denominator

    def begin(self, columns: Mapping[str, np.ndarray], ids: np.ndarray | None, count: int) -> np.ndarray:
        """Takes note of the first instant of `count` episodes, for what looks back at it.

        Returns:
          Which of the terminations holds already there `(count,)`, the first of several; −1 where none does.
        """
        for each in self._rewards:
            each.begin(columns, ids)
        codes = np.full(count, RUNNING)
        for code in range(len(self._conditions) - 1, -1, -1):
            codes[np.asarray(self._conditions[code].begin(columns, ids), bool)] = code
        return codes

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
        self, measured: np.ndarray, inputs: Inputs, ids: np.ndarray | None, first: bool
    ) -> Mapping[str, np.ndarray]:
        """The values that are observed, `(k,)` by the name of their term; see `columns`."""
        if not self._values:
            return {}
        columns = self.columns(measured, inputs)
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
