"""Statistics of numbers and of colours that arrive piece by piece."""

import numpy as np

from mjrun.dataclass import dataclass

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
SAMPLED = 2**16  # rows at most that quantiles are computed from
MOST = 255  # of a colour


@dataclass(frozen=True)
class RowStatistics:
    """Statistics of rows of numbers.

    Attributes:
      count: number of rows.
      min, max, mean, std: the statistics of each column `(n,)`.
      quantiles: those in `QUANTILES`, of each column `(n,)`.
    """

    count: int
    min: np.ndarray
    max: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    quantiles: dict[str, np.ndarray]


class RunningStatistics:
    """Statistics of rows that arrive piece by piece.

    Quantiles are those of all rows, or of `SAMPLED` rows at most at equal distances. Memory does not grow with the
    number of rows.
    """

    def __init__(self) -> None:
        self._count, self._distance = 0, 1
        self._mean = self._squares = np.zeros(0)  # `squares`: sum of the squared deviations from the mean
        self._min = self._max = np.zeros(0)
        self._sample = np.zeros((0, 0))

    def add(self, rows: np.ndarray) -> None:
        """Adds rows `(k, n)` of finite numbers.

        The formulas of Chan, Golub and LeVeque combine means and deviations without loss of digits.
        """
        if not len(rows):
            return
        rows = rows.astype(float)
        if not self._count:
            self._mean, self._squares = np.zeros((2, rows.shape[1]))
            self._min, self._max = rows[0], rows[0]
            self._sample = np.zeros((0, rows.shape[1]))
        mean = rows.mean(axis=0)
        before, self._count = self._count, self._count + len(rows)
        self._squares = self._squares + ((rows - mean) ** 2).sum(axis=0)
        self._squares += (mean - self._mean) ** 2 * before * len(rows) / self._count
        self._mean = self._mean + (mean - self._mean) * len(rows) / self._count
        self._min, self._max = np.minimum(self._min, rows.min(axis=0)), np.maximum(self._max, rows.max(axis=0))
        self._keep(rows[-before % self._distance :: self._distance])

    def result(self) -> RowStatistics:
        """Returns the statistics of all rows, at least one."""
        values = np.quantile(self._sample, list(QUANTILES.values()), axis=0)
        quantiles = dict(zip(QUANTILES, values, strict=True))
        std = np.sqrt(self._squares / self._count)
        return RowStatistics(self._count, self._min, self._max, self._mean, std, quantiles)

    def _keep(self, rows: np.ndarray) -> None:
        """Adds rows to the sample, and halves it when it is full."""
        self._sample = np.concatenate([self._sample, rows])
        while len(self._sample) > SAMPLED:
            self._sample, self._distance = self._sample[::2], 2 * self._distance


def color_statistics(counts: np.ndarray, images: int) -> RowStatistics:
    """Returns the statistics of the channels of images, from 0 to 1.

    Args:
      counts: the number of pixels with each value of each channel `(3, 256)`.
      images: number of images.
    """
    values = np.arange(MOST + 1) / MOST
    totals = counts.sum(axis=1)
    mean = counts @ values / totals
    std = np.sqrt(np.maximum(counts @ values**2 / totals - mean**2, 0))
    present = counts > 0
    low, high = values[present.argmax(axis=1)], values[MOST - present[:, ::-1].argmax(axis=1)]
    below = np.cumsum(counts, axis=1)
    quantiles = {
        name: np.array([values[np.searchsorted(row, share * row[-1])] for row in below])
        for name, share in QUANTILES.items()
    }
    return RowStatistics(images, low, high, mean, std, quantiles)
