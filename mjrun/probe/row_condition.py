"""Conditions on each row of a table, such as `contact/ncon > 0`: the language of events over the columns there are.

As in `mjrun.probe.event`, `xpos(top).z` is the column `xpos/top/z`, and `contact(ball, floor)` holds where the number
of contacts is above zero.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.errors import UsageError
from mjrun.probe.evaluation import evaluate_truth
from mjrun.probe.expression import BooleanExpression, columns_read
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import ProbeReference, SourceText, Vocabulary
from mjrun.probe.select import PAIRS


@dataclass(frozen=True, eq=False)
class RowCondition:
    """A condition that is well formed.

    Attributes:
      text: as it was written.
      columns: the names of the columns that it reads, in the order in which it first mentions them.
    """

    text: str
    columns: tuple[str, ...]
    _truth: BooleanExpression = field(repr=False)

    def holds(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """At which of n rows it holds: `(n,)` bool; `columns` are `(n,)` each, by name. No comparison with NaN does."""
        with np.errstate(all="ignore"):
            return evaluate_truth(self._truth, dict(columns), {})


class TableColumns(Vocabulary):
    """The columns of a table, by their own names and as `group(object).component`."""

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(name.partition("/")[0] for name in self.names if "/" in name)

    def is_count(self, column: str) -> bool:
        return column.startswith(f"{PAIRS}/")

    def accessed(self, accessor: ProbeReference, source: SourceText) -> str:
        objects = "/".join(token.text for token in accessor.objects)
        name = f"{accessor.group.text}/{objects}" + accessor.component.text.replace(".", "/")
        if self.column(name) is None:
            raise self.missing(name, accessor.group.start, source)
        return name


def parse_row_condition(text: str, columns: Sequence[str], label: str) -> RowCondition:
    """The condition that `text` is over a table of `columns`.

    Args:
      label: what messages call the text: `option("mark_event")`.

    Raises:
      UnknownNameError: a name is that of no column or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    truth = Parser(SourceText(text, label), TableColumns(columns), aggregates=False).truth()
    read = columns_read(truth)
    if not read:
        raise UsageError(f"{label}: a condition reads columns")
    return RowCondition(text, read, truth)
