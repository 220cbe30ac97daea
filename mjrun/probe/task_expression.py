"""Expressions over the control instants of a task, such as `exp(-norm(goal/x, goal/y)) - 0.1*rate(qpos/hip)`.

The language is that of `mjrun.probe.row_expression`, with values of one instant and without aggregates. In addition:

    previous(x)         the value of x at the control instant before; at the first instant of an episode, x itself
    rate(x)             (x − previous(x)) / control_dt
    control_dt          the control period [s]

`previous(previous(x))` is the value two control instants ago. Any number of worlds are evaluated at once; the values of
one do not depend on the others, to the last bit.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UsageError
from mjrun.probe.episode_columns import EPISODE_GROUPS, within_task
from mjrun.probe.expression import (
    CONSTANTS,
    BooleanExpression,
    NumericExpression,
    ParsedExpression,
    PreviousValue,
    walk,
)
from mjrun.probe.expression_program import WorldsProgram
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import SourceText
from mjrun.probe.vocabularies import ModelVocabulary

Ids = Sequence[int] | np.ndarray | None  # ids of worlds; None for all
Program = Callable[[Mapping[str, Any], slice | np.ndarray, int], list[np.ndarray]]


class TaskVocabulary(ModelVocabulary):
    """Every column that can be measured of a model, and the columns of a task: `action/left`, `command/goal/0`."""

    def __init__(self, model: mujoco.MjModel, others: Iterable[str], control_dt: float) -> None:
        super().__init__(model, others)
        self.control_dt = control_dt
        self.constants = CONSTANTS | {"control_dt": control_dt}

    def missing(self, name: str, position: int, source: SourceText) -> UsageError:
        if name.partition("/")[0] in {*EPISODE_GROUPS} - self.groups:
            return within_task(name)
        return super().missing(name, position, source)


class TaskExpression(ParsedExpression):
    """A number, or a condition, per control instant."""


class TaskEvaluator:
    """An evaluator of expressions in several worlds, at one control instant after another.

    It must be called within `np.errstate(all="ignore")`: 1/0 is inf, as in assertions.

    Args:
      expressions: the expressions.
      count: the number of worlds, none of which has begun.

    Attributes:
      roots: the roots of the expressions.
      previous: the calls of `previous`, inner ones first, each with its values of the worlds `(count, …)`.
    """

    def __init__(self, expressions: Sequence[TaskExpression], count: int) -> None:
        self.roots: list[NumericExpression | BooleanExpression] = [each.root for each in expressions]
        self._count = count
        nodes = [node for root in self.roots for node in walk(root) if isinstance(node, PreviousValue)]
        self.previous = [
            (node, np.full((count, node.width) if node.width else count, np.nan)) for node in dict.fromkeys(nodes)
        ]

    @property
    def memory(self) -> list[np.ndarray]:
        """The stored values of each world `(count, …)`."""
        return [before for _, before in self.previous]

    def begin(self, columns: Mapping[str, Any], ids: Ids = None) -> list[np.ndarray]:
        """Returns the values at the first control instant of the worlds `ids`, and drops their earlier values.

        Args:
          columns: columns of the k worlds `ids`, or of all of them, `(k,)` each, by name.

        Returns:
          `(k,)` of each expression, float64, or bool for a condition.
        """
        return self._begin(columns, *self._worlds(ids))

    def advance(self, columns: Mapping[str, Any], ids: Ids = None) -> list[np.ndarray]:
        """Returns the values at the next control instant of the worlds `ids`; see `begin`."""
        return self._advance(columns, *self._worlds(ids))

    def remember(self, columns: Mapping[str, Any], ids: Ids = None) -> None:
        """Begins as `begin`, without the values."""
        if self.previous:
            self._remember(columns, *self._worlds(ids))

    def _worlds(self, ids: Ids) -> tuple[slice | np.ndarray, int]:
        return (slice(None), self._count) if ids is None else (np.asarray(ids, int), len(ids))

    @cached_property
    def _begin(self) -> Program:
        return self._compiled(self.roots, is_first=True)

    @cached_property
    def _advance(self) -> Program:
        return self._compiled(self.roots, is_first=False)

    @cached_property
    def _remember(self) -> Program:
        return self._compiled([], is_first=True)

    def _compiled(self, roots: Sequence[NumericExpression | BooleanExpression], is_first: bool) -> Program:
        """Compiles the function that stores all previous values, and returns the values of some expressions."""
        program = WorldsProgram(is_first)
        for node, before in self.previous:
            program.remember(node, before)
        return program.function("columns, rows, count", f"[{', '.join(map(program.value, roots))}]")


def parse_task_value(text: str, columns: TaskVocabulary, label: str) -> TaskExpression:
    """Parses a number per control instant.

    Args:
      label: name of the text in messages: `rewards.distance`.

    Raises:
      UnknownNameError: a column or function is unknown; the message lists near and valid ones.
      UsageError: the text is invalid; the message states where, what was found and what is valid.
    """
    return TaskExpression(text, Parser(text, label, columns).row_value())


def parse_task_condition(text: str, columns: TaskVocabulary, label: str) -> TaskExpression:
    """Parses a condition at each control instant; see `parse_task_value`."""
    return TaskExpression(text, Parser(text, label, columns).condition())
