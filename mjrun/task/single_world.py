"""A task in a single world, stepped with as little as can be done around the physics.

Where a step of the physics takes microseconds, what NumPy takes for arrays of one world is most of the time. Here what
is read is decided once, and expressions are evaluated on Python's numbers. No number differs from `TaskWorlds`.
"""

import math
from typing import Any

import numpy as np

from mjrun.probe.column_matrix import ColumnMatrix
from mjrun.task.expressions import NOTHING, RUNNING, Inputs
from mjrun.task.measurement import ALL
from mjrun.task.task import Task
from mjrun.task.worlds import SQUARE, TaskStep, TaskWorlds

NO_COMMANDS = np.zeros(0)


class SingleWorld(TaskWorlds):
    """One world of a task.

    Args:
      task: with its model.

    Raises:
      UsageError, ModelError, FileError: as `TaskWorlds`.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task, 1, 1)
        expressions, columns = self._expressions, self._measurement.count
        self._has_commands = bool(self.commands.names)
        nact = len(self.action_names) if expressions.reads_actions else 0
        ncommands = len(self.commands.names) if expressions.reads_commands else 0
        row = np.zeros(columns + nact + ncommands)  # what is measured for terms, and for expressions; and the rest
        self._read = self._measurement.reader(row[:columns])
        self._row_of_terms, self._row_of_expressions = row[: self._of_terms], row[self._of_terms :]
        self._action_read, self._commands_read = row[columns : columns + nact], row[columns + nact :]
        self._action, self._target, self._only_observed = self._actions[0], self._targets[0], self._observed[0]
        self._only_motion, self._only_warnings = self._motion[0], self._warnings[0]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task,), self._saved()

    def start(self, seed: int) -> np.ndarray:
        """Begins the episode of `seed`; returns the first observation `(nobs,)`.

        Raises:
          UsageError, ModelError: the model of this episode cannot be had.
        """
        with self.task.located():
            self._load([seed], self._all)
        self._instants[0], self._action[:] = 0, 0
        self._over[0] = self._failed[0] = False
        self._batch.warning[0] = 0
        self._call(lambda: self._batch.forward(None, self._stage_at_start))
        self._measurement.begin(ALL)
        self._read()

        inputs, columns = self._columns_at(0)
        expressions = self._expressions
        self._start_codes[0] = expressions.begin_alone(columns)
        values = expressions.values_alone(columns, first=True) if expressions.has_values else NOTHING
        observed = self._observations.observe(self._row_of_terms, inputs, values, 0, first=True)
        self._only_observed[:] = observed
        return observed

    def act(self, action: np.ndarray) -> TaskStep:
        """A control period under `action` `(nact,)`; no array of what comes of it has an axis of worlds.

        Raises:
          ValueError: the action is not finite or does not fit, or the episode is over or has not begun.
        """
        action = np.asarray(action, float)
        if action.shape != self._action.shape or self._over[0] or not math.isfinite(np.vdot(action, action)):
            self.begin(action[None])
        else:
            self._action[:] = action
            self._target[:] = targets = self.actions.targets(action)
            self._torques.apply(targets, self._ctrl, 0)
        self._advance(self.control_steps, None, self._stage)
        self._read()
        return self._result()

    def _result(self) -> TaskStep:
        """What has come of the control period."""
        expressions, endings = self._expressions, self._expressions.endings
        before = int(self._instants[0])
        self._instants[0] = instant = before + 1
        inputs, columns = self._columns_at(instant, before)
        terms, code = expressions.advance_alone(columns)
        if code == RUNNING and instant >= self._periods:
            code = endings.timeout

        if self._has_commands:
            inputs, columns = self._columns_at(instant)
        values = expressions.values_alone(columns, first=False) if expressions.has_values else NOTHING
        observed = self._observations.observe(self._row_of_terms, inputs, values, 0, first=False)
        motion = self._only_motion
        is_stable = np.vdot(motion, motion) < SQUARE and not self._has_failed and not any(self._only_warnings.tolist())
        if not is_stable and self.is_unstable(0):
            code, terms = endings.unstable, [0.0] * len(terms)
            observed = self._only_observed.copy()
        self._only_observed[:] = observed
        if code != RUNNING:
            self._over[0] = True
        total = 0.0
        for term in terms:  # one after the other, as in `TaskWorlds`
            total += term
        return TaskStep(observed, total, terms, code, endings)

    def _columns_at(self, instant: int, commanded: int | None = None) -> tuple[Inputs, ColumnMatrix]:
        """What went into the world up to a control instant, and the columns that expressions read there.

        Args:
          commanded: the instant of the commands, if they are those of another.
        """
        commands = NO_COMMANDS
        if self._has_commands:
            commands = self.commands.at(0, instant if commanded is None else commanded)
            if self._expressions.reads_commands:
                self._commands_read[:] = commands
        if self._expressions.reads_actions:
            self._action_read[:] = self._action
        columns = self._expressions.matrix(self._row_of_expressions, instant)
        return Inputs(instant, self._action, commands), columns
