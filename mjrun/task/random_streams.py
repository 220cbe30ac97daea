"""Random numbers of an episode, in separate streams, so that no purpose changes those of another.

Among these are the random ones of commands, whose values over the control instants of n worlds are computed here.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, clean, concerning, option
from mjrun.formats.table_reader import read_table
from mjrun.physics.random_distribution import draw_numbers
from mjrun.physics.timed_rows import TimedRows
from mjrun.task.task import Command
from mjrun.timeline import unrounded

MODEL, START, COMMANDS, OBSERVATIONS = range(4)
WORD = 2**32 - 1  # the largest seed of one word
BLOCK = 16  # control periods whose noise is drawn in one call
TIME = "time"


def stream(seed: int, purpose: int) -> "np.random.Generator":
    """Returns the random numbers for one purpose in the episode of `seed`: `default_rng(seed).spawn(4)[purpose]`."""
    if 0 <= seed <= WORD:  # entropy identical to that of a spawned child, in half the time
        sequence = np.random.SeedSequence(np.array([seed, 0, 0, 0, purpose], np.uint32))
    else:
        sequence = np.random.SeedSequence(seed, spawn_key=(purpose,))
    return np.random.Generator(np.random.PCG64(sequence))


class ObservationNoise:
    """Noise on some columns of the observations of n worlds, drawn world by world in blocks of instants.

    Args:
      distributions: the distribution of each column `(columns,)`, as text; None if there is no noise.

    Attributes:
      columns: the indices of the noisy columns.
      streams: the generator of each world; None before its first episode.
    """

    def __init__(self, distributions: Sequence[str | None], count: int) -> None:
        noisy = [(column, text) for column, text in enumerate(distributions) if text is not None]
        self.columns = np.array([column for column, _ in noisy], int)
        self.streams: list[np.random.Generator | None] = [None] * count
        self._texts = [text for _, text in noisy]
        self._block = np.zeros((count, BLOCK, len(noisy)))
        self._used = np.full(count, BLOCK)

    def begin(self, world: int, seed: int) -> None:
        """Begins the episode of `seed` in a world."""
        self.streams[world] = stream(seed, OBSERVATIONS)
        self._used[world] = BLOCK

    @property
    def memory(self) -> list[np.ndarray]:
        """The noise drawn in each world `(count, …)`, and the number of instants used of it."""
        return [self._block, self._used]

    def next(self, rows: np.ndarray | int) -> np.ndarray:
        """Returns the noise `(k, noisy columns)` of the worlds `rows` `(k,)` at their next instant."""
        worlds = np.atleast_1d(rows)
        for world in worlds[self._used[worlds] == BLOCK].tolist():
            generator = self.streams[world]
            assert generator
            for column, text in enumerate(self._texts):
                self._block[world, :, column] = draw_numbers(text, generator, BLOCK)
            self._used[world] = 0
        noise = self._block[rows, self._used[rows]]
        self._used[rows] += 1
        return noise


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
    periods = unrounded(every / control_dt)
    if periods.denominator != 1:
        message = f"{float(every):g} s is not a whole number of control periods of {float(control_dt):g} s"
        raise UsageError(f"{option('every')}: {message}")
    return int(periods)
