"""The commands of n worlds over the control instants of their episodes."""

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, clean, concerning, option
from mjrun.formats.table_reader import read_table
from mjrun.physics.random_distribution import draw_numbers
from mjrun.physics.timed_rows import TimedRows
from mjrun.task.random_streams import COMMANDS, stream
from mjrun.task.task import Command

TIME = "time"


class CommandSignals:
    """The values of all commands, side by side.

    Args:
      commands: the commands by name.
      control_dt: [s].
      periods: control periods of an episode.
      count: the number of worlds.

    Attributes:
      names: the names of the values: `goal`, or `goal/0`, `goal/1`.
      slices: the places of each command among the values.

    Raises:
      UsageError: an invalid table, or an interval that is not a whole number of control periods.
      FileError: a table cannot be read.
    """

    def __init__(self, commands: Mapping[str, Command], control_dt: Fraction, periods: int, count: int) -> None:
        self.names: list[str] = []
        self.slices: dict[str, slice] = {}
        self._random: list[tuple[np.ndarray, slice, tuple[str, ...], int]] = []
        instants = periods + 1
        columns = [np.zeros((instants, 0))]
        for name, command in commands.items():
            with concerning("commands", name):
                values = _fixed_values(command, control_dt, instants)
                every = _periods(command.every, control_dt) if command.every is not None else instants
            width = values.shape[1]
            place = slice(len(self.names), len(self.names) + width)
            self.slices[name] = place
            self.names += [name] if width == 1 else [f"{name}/{i}" for i in range(width)]
            columns.append(values)
            if command.random is not None:
                texts = command.random * (width if len(command.random) == 1 else 1)
                drawn = np.zeros((count, -(-instants // every), width))
                self._random.append((drawn, place, texts, every))
        self._fixed = np.concatenate(columns, axis=1)

    def begin(self, world: int, seed: int) -> None:
        """Draws the random commands of the episode of `seed` in a world."""
        if not self._random:
            return
        generator = stream(seed, COMMANDS)
        for drawn, _, texts, _ in self._random:
            for column, text in enumerate(texts):
                drawn[world, :, column] = draw_numbers(text, generator, drawn.shape[1])

    @property
    def memory(self) -> list[np.ndarray]:
        """The random commands of each world `(count, …)`."""
        return [drawn for drawn, _, _, _ in self._random]

    def at(self, worlds: np.ndarray | int, instants: np.ndarray | int) -> np.ndarray:
        """Returns the values in the worlds `(k,)` at their control instants `(k,)`: `(k, len(names))`.

        The last values of an episode hold beyond its end. For a single world they are `(len(names),)`.
        """
        if not self.names:
            return np.empty((*np.shape(instants), 0))
        instants = np.minimum(instants, len(self._fixed) - 1)
        values = self._fixed.take(instants, axis=0)
        for drawn, place, _, every in self._random:
            values[..., place] = drawn[worlds, instants // every]
        return values


def _fixed_values(command: Command, control_dt: Fraction, instants: int) -> np.ndarray:
    """Returns the values at every control instant `(instants, width)`; zeros of a random command."""
    if command.constant is not None:
        return np.tile(command.constant, (instants, 1))
    if command.schedule is not None:
        starts = [time for time, _ in command.schedule]
        rows = [sum(start <= control_dt * k for start in starts) - 1 for k in range(instants)]
        return np.array([values for _, values in command.schedule])[rows]
    if command.table is not None:
        times = np.array([float(control_dt * k) for k in range(instants)])
        with concerning("table"):
            return _table(command.table, times, command.interpolation == "linear", float(control_dt))
    assert command.random is not None
    return np.zeros((instants, command.size or len(command.random)))


def _table(file: str, times: np.ndarray, linear: bool, control_dt: float) -> np.ndarray:
    """Returns the values of a table at `times`; between rows they hold, or follow a straight line."""
    columns = dict(read_table(Path(file)).columns)
    if TIME not in columns or len(columns) == 1:
        raise UsageError(f"{clean(file)}: a table of commands needs a column time [s], and one for each value")
    known = columns.pop(TIME)
    return TimedRows(known, columns, file, linear).at(times, control_dt)


def _periods(every: Fraction, control_dt: Fraction) -> int:
    periods = every / control_dt
    if periods.denominator != 1:
        message = f"{float(every):g} s is not a whole number of control periods of {float(control_dt):g} s"
        raise UsageError(f"{option('every')}: {message}")
    return int(periods)
