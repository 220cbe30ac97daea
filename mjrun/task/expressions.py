"""The expressions of a task in n worlds: rewards, terminations, and observed values."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjrun.errors import concerning
from mjrun.probe.expression import ColumnLayout, ColumnMatrix
from mjrun.probe.task_expression import TaskExpression, TaskVocabulary, parse_task_condition, parse_task_value
from mjrun.task.batch_columns import NumberSource
from mjrun.task.episode import Endings
from mjrun.task.single_world_expressions import RowFunctionBuilder
from mjrun.task.task import TIMED_OUT, UNSTABLE, Task

ACTION, COMMAND, TIME = "action/", "command/", "time"  # columns of a task in addition to those of its model
RUNNING = -1  # the code of an episode that has not ended
NOTHING: Mapping[str, Any] = {}
Judge = Callable[[float], tuple[float, list[float], int]]
Fill = Callable[[np.ndarray, float], None]


class ExpressionInputs(NamedTuple):
    """The inputs of k worlds up to a control instant; of a single world where the axis of worlds is missing.

    Attributes:
      instants: control instants since the reset `(k,)`.
      actions: the last ones `(k, nact)`.
      commands: `(k, ncommands)`.
    """

    instants: Any
    actions: np.ndarray
    commands: np.ndarray


class TaskExpressions:
    """The rewards, terminations and observed values of n worlds.

    Args:
      task: the task with the expressions.
      columns: the columns that they can read.
      values: the observed values, by the name of the term.
      names: the names of the numbers of an action and of the commands.
      count: the number of worlds.

    Attributes:
      measured: the columns of the model that they read.
      actions, commands: the columns with the numbers of an action and of the commands.
      reads_time, reads_actions, reads_commands: whether they read any of these.
      has_values: whether any values are observed.
      endings: all possible endings; the terminations of the task first, in their order.

    Raises:
      UnknownNameError: a name is neither a column nor a function.
      UsageError: a text is not an expression.
    """

    def __init__(
        self,
        task: Task,
        columns: TaskVocabulary,
        values: Mapping[str, TaskExpression],
        names: tuple[Sequence[str], Sequence[str]],
        count: int,
    ) -> None:
        self._control_dt = task.control_dt
        rewards: list[TaskExpression] = []
        for name, reward in task.rewards.items():
            with concerning("rewards", name, "value"):
                rewards.append(parse_task_value(reward.value, columns, f"rewards.{name}"))
        conditions: list[TaskExpression] = []
        for name, termination in task.terminations.items():
            with concerning("terminations", name, "when"):
                conditions.append(parse_task_condition(termination.when, columns, f"terminations.{name}.when"))

        self._weights = [reward.weight for reward in task.rewards.values()]
        self._weight_column = np.array(self._weights, float)[:, None]
        self._rewards = [each.evaluator(count) for each in rewards]
        self._conditions = [each.evaluator(count) for each in conditions]
        self._values = {name: each.evaluator(count) for name, each in values.items()}
        self.has_values = bool(values)
        own_endings = (termination.ending(name) for name, termination in task.terminations.items())
        self.endings = Endings(own_endings, TIMED_OUT, UNSTABLE)

        self.actions = actions = [f"{ACTION}{name}" for name in names[0]]
        self.commands = commands = [f"{COMMAND}{name}" for name in names[1]]
        read = dict.fromkeys(column for each in (*rewards, *conditions, *values.values()) for column in each.columns)
        self.measured = [column for column in read if column not in {TIME, *actions, *commands}]
        self.reads_time = TIME in read
        self.reads_actions, self.reads_commands = (not read.keys().isdisjoint(own) for own in (actions, commands))
        self._layout = ColumnLayout(
            [
                *self.measured,
                *(actions if self.reads_actions else ()),
                *(commands if self.reads_commands else ()),
            ]
        )

    @property
    def memory(self) -> list[np.ndarray]:
        """The previous values that they remember of each world `(count, …)`."""
        evaluators = [*self._rewards, *self._conditions, *self._values.values()]
        return [array for each in evaluators for array in each.memory]

    def columns(self, measured: np.ndarray, inputs: ExpressionInputs) -> ColumnMatrix:
        """Returns the columns that they read, `(k,)` each, from those of the model `(k, len(self.measured))`."""
        read = [measured]
        read += [inputs.actions] if self.reads_actions else []
        read += [inputs.commands] if self.reads_commands else []
        matrix = np.concatenate(read, axis=-1) if len(read) > 1 else measured
        return ColumnMatrix(self._layout, matrix, {TIME: self.time(inputs.instants)} if self.reads_time else NOTHING)

    def alone(
        self,
        columns: Mapping[str, NumberSource],
        measured: Mapping[int, NumberSource],
        places: Sequence[int],
        is_first: bool,
    ) -> tuple[Judge, Fill, bool]:
        """Compiles the expressions of a single world.

        Args:
          columns: the source of each column that they read.
          measured: the source of each measured number of an observation, by its place.
          places: the places of the observed values in an observation.
          is_first: whether the functions are for the first control instant of an episode.

        Returns:
          A function of the time that returns the reward, its weighted terms, and the code of the termination that
          holds; a function of an observation and the time that writes measured numbers and observed values into it; and
          whether both must be called within `np.errstate(all="ignore")`.
        """
        judging = RowFunctionBuilder(columns, is_first)
        values = [judging.value(each) for each in self._rewards]
        for index, (value, weight) in enumerate(zip(values, self._weights, strict=True)):
            judging.add(f"t{index} = float({value}) * {weight!r}")
        terms = [f"t{index}" for index in range(len(values))]
        holds = [f"{code} if {judging.value(each)} else " for code, each in enumerate(self._conditions)]
        judge = judging.function(
            "time", f"{' + '.join(['0.0', *terms])}, [{', '.join(terms)}], {''.join(holds)}{RUNNING}"
        )

        filling = RowFunctionBuilder(columns, is_first)
        filling.copy(measured, "values")
        for place, each in zip(places, self._values.values(), strict=True):
            filling.add(f"values[{place}] = {filling.value(each)}")
        return judge, filling.function("values, time", "None"), judging.uses_numpy or filling.uses_numpy

    def time(self, instants: Any) -> Any:
        """Returns the time of control instants [s], exact and rounded once."""
        return instants * self._control_dt.numerator / self._control_dt.denominator

    def begin(self, columns: ColumnMatrix, ids: np.ndarray | None, count: int) -> np.ndarray:
        """Evaluates the expressions at the first instant of `count` episodes.

        Returns:
          The code of the first termination that holds there `(count,)`; −1 where none does.
        """
        with np.errstate(all="ignore"):
            for each in self._rewards:
                if each.memory:
                    each.begin(columns, ids)
            return self._codes([each.begin(columns, ids) for each in self._conditions], count)

    def advance(self, columns: ColumnMatrix, ids: np.ndarray | None, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Evaluates the expressions at the end of a control period in `count` worlds.

        Returns:
          The weighted terms of the reward `(nterms, count)`, and the code of the first termination that holds
          `(count,)`; −1 where none does.
        """
        terms = np.empty((len(self._rewards), count))
        with np.errstate(all="ignore"):
            for row, each in enumerate(self._rewards):
                terms[row] = each.advance(columns, ids)
            terms *= self._weight_column
            return terms, self._codes([each.advance(columns, ids) for each in self._conditions], count)

    def values(self, columns: ColumnMatrix, ids: np.ndarray | None, first: bool) -> Mapping[str, np.ndarray]:
        """Returns the observed values, `(k,)` by the name of their term; see `columns`."""
        with np.errstate(all="ignore"):
            if first:
                return {name: each.begin(columns, ids) for name, each in self._values.items()}
            return {name: each.advance(columns, ids) for name, each in self._values.items()}

    def _codes(self, conditions: Sequence[np.ndarray], count: int) -> np.ndarray:
        """Returns the code of the first condition `(count,)` bool that holds in each world."""
        codes = np.empty(count, int)
        codes.fill(RUNNING)  # np.full takes twice as long
        for code, holds in reversed([*enumerate(conditions)]):
            codes[holds] = code
        return codes
