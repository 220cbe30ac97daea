"""Events: when a condition such as `speed(box) > 0.02` begins to hold.

The language is that of assertions (`mjrun.probe.assertion`), with the values of one instant: there are no aggregates.
What is more:

    speed(box)                  the column `speed/box`
    xpos(top).z                 the column `xpos/top/z`
    contact(ball, floor)        the column `contact/ball/floor`, the number of contacts between the two

An object is written as a column is, quoted where it needs quotes: `speed('left (upper)')`. All columns that can be
asked for as probes are there, by each of their names. A number of contacts may stand where a comparison may, and holds
above zero: `not contact(ball, floor)`.
"""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from mjrun.probe.available import AvailableProbes
from mjrun.probe.episode import EpisodeColumns
from mjrun.probe.evaluation import evaluate_truth
from mjrun.probe.expression import BooleanExpression, columns_read
from mjrun.probe.parser import Parser
from mjrun.probe.scanner import SourceText


@dataclass(frozen=True, eq=False)
class Condition:
    """A condition that is well formed.

    Attributes:
      text: as it was written.
      columns: what to measure, without `time`, in the order in which it is written.
    """

    text: str
    columns: tuple[str, ...]
    _truth: BooleanExpression = field(repr=False)

    def holds(self, values: np.ndarray) -> np.ndarray:
        """At which of n instants it holds: `(n,)` bool. No comparison with NaN does.

        Args:
          values: `(n, 1 + len(columns))`, the time [s] first.

        Raises:
          ValueError: the values are those of other columns.
        """
        names = ("time", *self.columns)
        if values.ndim != 2 or values.shape[1] != len(names):
            raise ValueError(f"values of shape {values.shape} for {len(names)} columns")
        with np.errstate(all="ignore"):
            return evaluate_truth(self._truth, dict(zip(names, np.ascontiguousarray(values.T), strict=True)), {})


def condition(
    text: str, model: mujoco.MjModel, label: str = "when", episode: EpisodeColumns | None = None
) -> Condition:
    """The condition that `text` says of a simulation of `model`.

    Args:
      label: what messages call it.
      episode: what a policy that acts adds to what can be measured.

    Raises:
      UnknownNameError: a name is that of no column, object or function; the message lists near and valid ones.
      UsageError: the text is none of the language; the message says where, what was found and what is valid.
    """
    available = AvailableProbes(model, episode.names if episode else ())
    truth = Parser(SourceText(text, label), available, aggregates=False).truth()
    read = columns_read(truth)
    return Condition(text, tuple(name for name in read if name != "time"), truth)


class RisingEdgeDetector:
    """Where a condition begins to hold, while rows come by in blocks."""

    def __init__(self) -> None:
        self.indices: list[int] = []  # of rows, counted from the first
        self._count, self._held = 0, False

    def feed(self, holds: np.ndarray) -> None:
        """Takes the next rows: `(n,)` bool, whether it holds at each."""
        before = np.concatenate([[self._held], holds])
        begins = holds & ~before[:-1]
        self.indices += (self._count + np.flatnonzero(begins)).tolist()
        self._count, self._held = self._count + len(holds), bool(before[-1])
