"""A table of positions in time as the states of a model."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import UsageError, clean, option
from mjrun.formats.table_reader import open_table
from mjrun.physics.motion import Motion
from mjrun.physics.motion_samples import Interpolation, MotionSamples
from mjrun.simulation.column_map import ColumnMap, column_map, time_hint
from mjrun.timeline import seconds


@dataclass(frozen=True)
class MotionReading:
    """How tables of motions are read.

    Attributes:
      texts: the map, as `column_map` takes it.
      quat: the order of quaternions that are not named.
      rate: rows per second [Hz] of a table without times.
      interpolation: between the rows.
    """

    texts: Sequence[str] = ()
    quat: str = "wxyz"
    rate: Fraction | None = None
    interpolation: Interpolation = field(default_factory=Interpolation)

    def read(self, path: Path, model: mujoco.MjModel, start: mujoco.MjData) -> Motion:
        """The motion of `model` in the table at `path`; `start` holds what it does not give.

        Raises:
          UsageError: it has no positions of this model, no times, or what no motion can be; the map cannot be meant.
          FileError: it cannot be read.
        """
        names = _names(path)
        found = column_map(model, names, self.texts, self.quat, str(path))
        if found.time is None and self.rate is None:
            raise UsageError(f"{clean(str(path))} has no column 'time'\n{time_hint(names)}")
        if found.time is not None and self.rate is not None:
            raise UsageError(
                f"{clean(str(path))} has a column 'time', and {option('replay_rate')} is for tables without one\n"
                f"{option('map')} can say another time: time=EXPRESSION"
            )
        return Motion(model, start, self._samples(path, found, names), self.interpolation)

    def _samples(self, path: Path, found: ColumnMap, names: Sequence[str]) -> MotionSamples:
        """What the map gives on all rows; the rest of the table is never in memory as a whole."""
        expressions = {(f, i): source for f, sources in found.sources.items() for i, source in sources.items()}
        evaluators = {place: expression.evaluator() for place, expression in expressions.items()}
        clock = found.time.evaluator() if found.time else None
        parts: dict[tuple[str, int], list[np.ndarray]] = {place: [] for place in evaluators}
        times: list[np.ndarray] = []
        rows = 0
        with open_table(path, found.read or names[:1], missing="nan") as table:
            for block in table.blocks():
                columns = dict(zip(table.names, block.T, strict=True))
                for place, evaluator in evaluators.items():
                    parts[place].append(evaluator.feed(columns))
                times += [clock.feed(columns)] if clock else []
                rows += len(block)

        time = np.concatenate([np.empty(0), *times]) if clock else self._times(rows)
        values: dict[str, dict[int, np.ndarray]] = {}
        for f, i in expressions:
            values.setdefault(f, {})[i] = np.concatenate([np.empty(0), *parts.pop((f, i))])
        return MotionSamples(str(path), time, found.columns, values)

    def _times(self, rows: int) -> np.ndarray:
        assert self.rate
        return np.array(seconds(np.arange(rows), 1 / self.rate), float)


def _names(path: Path) -> list[str]:
    names: list[str] = []

    def note(name: str) -> bool:
        names.append(name)
        return False

    with open_table(path, note):
        return names
