"""How many points make a chunk: as many as take seconds, as measured on chunks that are done."""

import numpy as np

SECONDS = 3.0  # that a chunk takes, which are lost when it is killed
LEAST_SECONDS = 0.2  # of the last chunks, which are smaller so that all workers end together
GROWTH = 4  # from the largest measured chunk to the next: few points tell little of many
MOST = 4096  # points in a chunk


class ChunkSizes:
    """The sizes of the chunks of a study, each decided when it is handed out.

    A point is expected to take the mean time of points, or the mean time of its steps where that is more.

    Args:
      size: of all chunks; measured when None.
      ahead: chunks in flight, a multiple of the workers.
      seconds: that a chunk should take [s].
      first: points of a chunk before anything is measured.
    """

    def __init__(self, size: int | None, ahead: int, seconds: float = SECONDS, first: int = 1) -> None:
        self._size, self._ahead, self._target, self._largest = size, ahead, seconds, first
        self._points = self._steps = self._seconds = 0.0

    def next(self, steps: np.ndarray) -> int:
        """How many points the next chunk takes of those that are left, which have so many steps `(n,)`, n > 0."""
        left = len(steps)
        if self._size:
            return min(self._size, left)
        share = -(-left // self._ahead)
        if not self._points:
            return min(self._largest, share)
        of_step = self._seconds / self._steps if self._steps else 0.0
        ends = np.cumsum(np.maximum(self._seconds / self._points, of_step * steps[:MOST]))
        fair = max(share, int(np.searchsorted(ends, LEAST_SECONDS, "right")))
        return max(1, min(fair, int(np.searchsorted(ends, self._target, "right")), GROWTH * self._largest))

    def add(self, points: int, steps: int, seconds: float) -> None:
        """Takes the measurement of a chunk: its wall time [s] in the worker. Earlier ones count half with each."""
        self._points = self._points / 2 + points
        self._steps = self._steps / 2 + steps
        self._seconds = self._seconds / 2 + seconds
        self._largest = max(self._largest, points)
