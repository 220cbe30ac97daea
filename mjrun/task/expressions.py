"""The expressions of a task in n worlds: rewards, terminations, and values that are observed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjrun.errors import concerning
from mjrun.probe.evaluation import ColumnLayout, ColumnMatrix
from mjrun.probe.task_expression import (
    TaskColumns,
    TaskExpression,
    parse_task_condition,
    parse_task_value,
)
from mjrun.task.episode import Endings
from mjrun.task.row_program import RowProgram
from mjrun.task.task import Task
from mjrun.task.terms import TIMED_OUT, UNSTABLE

ACTION, COMMAND, TIME = "action/", "command/", "time"  # columns of a task besides those of its model
RUNNING = -1  # instead of an ending
NOTHING: Mapping[str, Any] = {}
Judge = Callable[[float], tuple[float, list[float], int]]
Fill = Callable[[np.ndarray, float], None]


class Inputs(NamedTuple):
    """What went into k worlds up to a control instant; into one world alone where the axis of worlds is missing.

    Attributes:
      instants: control instants since the reset `(k,)`.
      actions: the last ones `(k, nact)`.
      commands: `(k, ncommands)`.
    """

    instants: Any
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
      reads_time, reads_actions, reads_commands: whether they read any of these.
      has_values: whether some are observed.
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
        self._looking_back = [each for each in self._rewards if each.memory]
        self._conditions = [each.evaluator(count) for each in conditions.values()]
        self._conditions_backwards = [*enumerate(self._conditions)][::-1]
        self._values = {name: each.evaluator(count) for name, each in values.items()}
        self.has_values = bool(values)
        own_endings = (termination.ending(name) for name, termination in task.terminations.items())
        self.endings = Endings(own_endings, TIMED_OUT, UNSTABLE)
        read = [
            column for each in (*rewards.values(), *conditions.values(), *values.values()) for column in each.columns
        ]
        own = {TIME, *own_columns[0], *own_columns[1]}
        self.measured = [column for column in dict.fromkeys(read) if column not in own]
        self.reads_time = TIME in read
        self.reads_actions, self.reads_commands = (not {*read}.isdisjoint(own_names) for own_names in own_columns)
        columns_of = [self.measured]
        columns_of += [own_columns[0]] if self.reads_actions else []
        columns_of += [own_columns[1]] if self.reads_commands else []
        self._layout = ColumnLayout([name for part in columns_of for name in part])

    @property
    def memory(self) -> list[np.ndarray]:
        """What they remember of each world `(count, …)`."""
        evaluators = [*self._rewards, *self._conditions, *self._values.values()]
        return [array for each in evaluators for array in each.memory]

    def columns(self, measured: np.ndarray, inputs: Inputs) -> ColumnMatrix:
        """The columns that expressions read, `(k,)` each, from those of the model `(k, len(self.measured))`."""
        read = [measured]
        read += [inputs.actions] if self.reads_actions else []
        read += [inputs.commands] if self.reads_commands else []
        matrix = np.concatenate(read, axis=-1) if len(read) > 1 else measured
        return ColumnMatrix(self._layout, matrix, {TIME: self.time(inputs.instants)} if self.reads_time else NOTHING)

    def alone(self, row: np.ndarray, places: Sequence[int], is_first: bool) -> tuple[Judge, Fill, bool]:
        """Compiles the expressions of a single world.

        Args:
          row: the columns that they read, side by side: of the model, then actions and commands if read.
          places: of the values that are observed.
          is_first: whether an episode begins there.

        Returns:
          A function of the time that gives the reward, its weighted terms, and which of the terminations holds; one of
          an array and the time, which writes the values that are observed into it; and whether they must be called
          within `np.errstate(all="ignore")`.
        """
        judging = RowProgram(row, self._layout.places, is_first)
        terms = [judging.value(each) for each in self._rewards]
        for index, weight in enumerate(self._weights):
            judging.add(f"t{index} = float({terms[index]}) * {weight!r}")
        terms = [f"t{index}" for index in range(len(terms))]
        holds = [f"{code} if {judging.value(each)} else " for code, each in enumerate(self._conditions)]
        judge = judging.function(
            "time", f"{' + '.join(['0.0', *terms])}, [{', '.join(terms)}], {''.join(holds)}{RUNNING}"
        )

        filling = RowProgram(row, self._layout.places, is_first)
        for place, each in zip(places, self._values.values(), strict=True):
            filling.add(f"values[{place}] = {filling.value(each)}")
        return judge, filling.function("values, time", "None"), judging.uses_numpy or filling.uses_numpy

    def time(self, instants: Any) -> Any:
        """The time of control instants [s], exact and rounded once."""
        return instants * self._control_dt.numerator / self._control_dt.denominator

    def begin(self, columns: ColumnMatrix, ids: np.ndarray | None, count: int) -> np.ndarray:
        """Takes note of the first instant of `count` episodes, for what looks back at it.

        Returns:
          Which of the terminations holds already there `(count,)`, the first of several; −1 where none does.
        """
        with np.errstate(all="ignore"):
            for each in self._looking_back:
                each.begin(columns, ids)
            codes = np.full(count, RUNNING)
            for code, condition in self._conditions_backwards:
                codes[condition.begin(columns, ids)] = code
        return codes

    def advance(self, columns: ColumnMatrix, ids: np.ndarray | None, count: int) -> tuple[np.ndarray, np.ndarray]:
        """What comes of a control period in `count` worlds.

        Returns:
          The weighted terms of the reward `(nterms, count)`; and which of the terminations holds `(count,)`, the first
          of several, −1 where none does.
        """
        terms, codes = np.empty((len(self._rewards), count)), np.full(count, RUNNING)
        with np.errstate(all="ignore"):
            for term, each, weight in zip(terms, self._rewards, self._weights, strict=True):
                np.multiply(each.advance(columns, ids), weight, out=term)
            for code, condition in self._conditions_backwards:
                codes[condition.advance(columns, ids)] = code
        return terms, codes

    def values(self, columns: ColumnMatrix, ids: np.ndarray | None, first: bool) -> Mapping[str, np.ndarray]:
        """The values that are observed, `(k,)` by the name of their term; see `columns`."""
        with np.errstate(all="ignore"):
            if first:
                return {name: each.begin(columns, ids) for name, each in self._values.items()}
            return {name: each.advance(columns, ids) for name, each in self._values.items()}


def _rewards(task: Task, columns: TaskColumns) -> Iterator[tuple[str, TaskExpression]]:
    for name, reward in task.rewards.items():
        with concerning("rewards", name, "value"):
            yield name, parse_task_value(reward.value, columns, f"rewards.{name}")


def _conditions(task: Task, columns: TaskColumns) -> Iterator[tuple[str, TaskExpression]]:
    for name, termination in task.terminations.items():
        with concerning("terminations", name, "when"):
            yield name, parse_task_condition(termination.when, columns, f"terminations.{name}.when")
