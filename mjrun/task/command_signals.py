"""Commands over the control instants of episodes, for n worlds."""

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, clean, concerning, option
from mjrun.formats.table_reader import read_table
from mjrun.physics.control import SLACK, require_times
from mjrun.physics.distribution import draw_numbers
from mjrun.task.random_streams import COMMANDS, stream
from mjrun.task.terms import Command

TIME = "time"


class CommandSignals:
    """The values of all commands, side by side.

    Args:
      commands: by name.
      control_dt: [s].
      periods: control periods of an episode.
      count: worlds.

    Attributes:
      names: of the values: `goal`, or `goal/0`, `goal/1`.
      slices: where the values of each command are.

    Raises:
      UsageError: a table that cannot be used, or times that are no whole number of control periods.
      FileError: a table cannot be read.
    """

    def __init__(self, commands: Mapping[str, Command], control_dt: Fraction, periods: int, count: int) -> None:
        self.names: list[str] = []
        self.slices: dict[str, slice] = {}
        self._random: list[tuple[np.ndarray, slice, tuple[str, ...], int]] = []
        instants = periods + 1
        columns: list[np.ndarray] = []
        for name, command in commands.items():
            with concerning("commands", name):
                values = _known(command, control_dt, instants)
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
        self._known = np.concatenate(columns, axis=1) if columns else np.zeros((instants, 0))

    def begin(self, world: int, seed: int) -> None:
        """Draws what is random in the episode of `seed`, in a world."""
        if not self._random:
            return
        generator = stream(seed, COMMANDS)
        for drawn, _, texts, _ in self._random:
            for column, text in enumerate(texts):
                drawn[world, :, column] = draw_numbers(text, generator, drawn.shape[1])

    @property
    def memory(self) -> list[np.ndarray]:
        """What it has drawn in each world `(count, …)`."""
        return [drawn for drawn, _, _, _ in self._random]

    def at(self, worlds: np.ndarray | int, instants: np.ndarray | int) -> np.ndarray:
        """The values in the worlds `(k,)` at these control instants `(k,)` of theirs: `(k, len(names))`.

        Beyond the end of an episode its last values hold. Those of one world alone are `(len(names),)`.
        """
        if not self.names:
            return np.empty((*np.shape(instants), 0))
        instants = np.minimum(instants, len(self._known) - 1)
        values = self._known.take(instants, axis=0)
        for drawn, place, _, every in self._random:
            values[..., place] = drawn[worlds, instants // every]
        return values


def _known(command: Command, control_dt: Fraction, instants: int) -> np.ndarray:
    """The values at all control instants `(instants, width)`, as far as they are known; else zeros."""
    times = [float(control_dt * k) for k in range(instants)]
    if command.constant is not None:
        return np.tile(command.constant, (instants, 1))
    if command.schedule is not None:
        starts = [time for time, _ in command.schedule]
        rows = [sum(start <= control_dt * k for start in starts) - 1 for k in range(instants)]
        return np.array([values for _, values in command.schedule])[rows]
    if command.table is not None:
        with concerning("table"):
            return _table(command.table, np.array(times), command.interpolation == "linear", float(control_dt))
    assert command.random is not None
    return np.zeros((instants, command.size or len(command.random)))


def _table(file: str, times: np.ndarray, linear: bool, control_dt: float) -> np.ndarray:
    """The values of a table at `times`: each row holds until the next, or goes there in a straight line."""
    columns = dict(read_table(Path(file)).columns)
    if TIME not in columns or len(columns) == 1:
        raise UsageError(f"{clean(file)}: a table of commands has a column time [s], and one for each value")
    known = columns.pop(TIME)
    require_times(known, file)
    if known[0] > 0:
        raise UsageError(f"{clean(file)} begins at {known[0]:.9g} s, and does not say what the command is from 0 on")
    values = np.column_stack([*columns.values()]).astype(float)
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        raise UsageError(f"{clean(file)}, row {row}: {clean([*columns][column])} is {values[row, column]}")
    if linear:
        return np.column_stack([np.interp(times, known, column) for column in values.T])
    return values[np.searchsorted(known, times + SLACK * control_dt, side="right") - 1]


def _periods(every: Fraction, control_dt: Fraction) -> int:
    periods = every / control_dt
    if periods.denominator != 1:
        message = f"{float(every):g} s is no whole number of control periods of {float(control_dt):g} s"
        raise UsageError(f"{option('every')}: {message}")
    return int(periods)
