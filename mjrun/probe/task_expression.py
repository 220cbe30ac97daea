"""Expressions over the control instants of a task, such as `exp(-norm(goal/x, goal/y)) - 0.1*rate(qpos/hip)`.

The language is that of `mjrun.probe.row_expression`, with values of one instant and without aggregates. In addition:

    previous(x)         the value of x at the control instant before; at the first instant of an episode, x itself
    rate(x)             (x − previous(x)) / control_dt
    control_dt          the control period [s]

`previous(previous(x))` is the value two control instants ago. Any number of worlds are evaluated at once; the values of
one do not depend on the others, to the last bit.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UsageError
from mjrun.probe import expression as tree
from mjrun.probe.episode_columns import EPISODE_GROUPS, within_task
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import SourceText
from mjrun.probe.vocabularies import ModelVocabulary

Ids = Sequence[int] | np.ndarray | None  # ids of worlds; None for all


class TaskVocabulary(ModelVocabulary):
    """Every column that can be measured of a model, and the columns of a task: `action/left`, `command/goal/0`."""

    def __init__(self, model: mujoco.MjModel, others: Iterable[str], control_dt: float) -> None:
        super().__init__(model, others)
        self.control_dt = control_dt
        self.constants = tree.CONSTANTS | {"control_dt": control_dt}

    def missing(self, name: str, position: int, source: SourceText) -> UsageError:
        if name.partition("/")[0] in {*EPISODE_GROUPS} - self.groups:
            return within_task(name)
        return super().missing(name, position, source)


class TaskExpression(tree.ParsedExpression):
    """A number, or a condition, per control instant."""

    def evaluator(self, count: int) -> "TaskEvaluator":
        """Returns a new evaluation for `count` worlds, none of which has begun."""
        return TaskEvaluator(self.root, count)


class TaskEvaluator:
    """An evaluator of an expression in several worlds, at one control instant after another.

    It must be called within `np.errstate(all="ignore")`: 1/0 is inf, as in assertions.

    Attributes:
      root: the expression.
    """

    def __init__(self, root: tree.NumericExpression | tree.BooleanExpression, count: int) -> None:
        self.root = root
        self._count = count
        is_truth = isinstance(root, tree.BooleanExpression)
        self._type = np.dtype(bool if is_truth else np.float64)
        self._evaluation = tree.truth_evaluation(root) if is_truth else tree.evaluation(root)
        previous = [node for node in tree.walk(root) if isinstance(node, tree.PreviousValue)]
        operands = {node: tree.evaluation(node.operand) for node in previous}
        self._previous = [  # inner ones first, each once
            (node, operands[node], np.full((count, node.width) if node.width else count, np.nan))
            for node in dict.fromkeys(previous)
        ]

    @property
    def previous(self) -> list[tuple[tree.PreviousValue, np.ndarray]]:
        """The calls of `previous`, inner ones first, each with its values of the worlds `(count, …)`."""
        return [(node, before) for node, _, before in self._previous]

    @property
    def memory(self) -> list[np.ndarray]:
        """The stored values of each world `(count, …)`."""
        return [before for _, _, before in self._previous]

    def begin(self, columns: Mapping[str, Any], ids: Ids = None) -> np.ndarray:
        """Returns the values at the first control instant of the worlds `ids`, and drops their earlier values.

        Args:
          columns: columns of the k worlds `ids`, or of all of them, `(k,)` each, by name.

        Returns:
          `(k,)` float64, or bool for a condition.
        """
        return self._evaluate(columns, ids, first=True)

    def advance(self, columns: Mapping[str, Any], ids: Ids = None) -> np.ndarray:
        """Returns the values at the next control instant of the worlds `ids`; see `begin`."""
        return self._evaluate(columns, ids, first=False)

    def _evaluate(self, columns: Mapping[str, Any], ids: Ids, first: bool) -> np.ndarray:
        worlds = slice(None) if ids is None else np.asarray(ids, int)
        count = self._count if ids is None else len(ids)
        known: tree.KnownValues = {}
        for node, operand, before in self._previous:
            now = operand(columns, known)
            known[node] = now if first else np.array(before[worlds])  # a copy: `before` changes now
            before[worlds] = now
        values = np.asarray(self._evaluation(columns, known), self._type)
        return values if values.shape == (count,) else np.array(np.broadcast_to(values, count))


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
