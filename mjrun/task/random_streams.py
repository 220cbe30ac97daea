"""The random numbers of an episode: separate streams, so that one purpose never changes the numbers of another."""

from collections.abc import Sequence

import numpy as np

from mjrun.physics.random_distribution import draw_numbers

MODEL, START, COMMANDS, OBSERVATIONS = range(4)
WORD = 2**32 - 1  # the largest seed of one word
BLOCK = 16  # control periods whose noise is drawn in one call


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
