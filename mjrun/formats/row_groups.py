"""Rows turned into columns, for the formats that hold a table by column.

Rows arrive in blocks and are transposed in groups of bounded size. Parquet and Feather take one group after the
other; npz and mat need whole columns, so their groups wait in an unnamed file beside the table.
"""

import contextlib
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

GROUP = 2**21  # values in a group: 16 MiB
FIRST_ROWS = 2**9  # rows for which there is room at first: a short table needs little memory


class RowGroups:
    """Takes rows, yields groups `(columns, rows)` of at most `GROUP` values, each valid until the next one."""

    def __init__(self, columns: int) -> None:
        self._rows = max(1, GROUP // columns)  # in a full group
        self._group = np.empty((columns, min(self._rows, FIRST_ROWS)))
        self._filled = 0

    def add(self, block: np.ndarray) -> Iterator[np.ndarray]:
        """Takes the rows of `block` `(n, columns)` and yields every group they fill."""
        while len(block):
            part, block = np.split(block, [self._rows - self._filled])
            end = self._filled + len(part)
            if end > self._group.shape[1]:
                self._grow(end)
            self._group[:, self._filled : end] = part.T
            self._filled = end
            if self._filled == self._rows:
                self._filled = 0
                yield self._group

    def rest(self) -> Iterator[np.ndarray]:
        """The rows that fill no group, if there are any."""
        if self._filled:
            yield self._group[:, : self._filled]
            self._filled = 0

    def close(self) -> None:
        """Frees the memory, which would otherwise last as long as anything refers to the writer of the table."""
        self._group = np.empty((0, 0))

    def _grow(self, rows: int) -> None:
        """Makes room for `rows` rows and, as more are to come, for twice as many as before."""
        before = self._group
        self._group = np.empty((len(before), min(self._rows, max(rows, 2 * before.shape[1]))))
        self._group[:, : self._filled] = before[:, : self._filled]


class ColumnSpill:
    """A table on disk, written by row and read by column, in a file without a name, which no failure leaves behind.

    Args:
      folder: where the file is; that of the table, whose disk must have the space.
    """

    def __init__(self, folder: Path, columns: int) -> None:
        self.rows = 0
        self._groups = RowGroups(columns)
        self._sizes: list[int] = []  # rows in each group
        self._columns = columns
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (closed by close)

    def write(self, block: np.ndarray) -> None:
        """Adds the rows of `block` `(n, columns)`."""
        self.rows += len(block)
        self._store(self._groups.add(block))

    def end(self) -> None:
        """Stores the last rows; `column` can be called then."""
        self._store(self._groups.rest())

    def column(self, index: int) -> Iterator[np.ndarray]:
        """The values of one column, in pieces."""
        before = 0
        for size in self._sizes:
            self._file.seek(8 * (self._columns * before + index * size))
            yield np.frombuffer(self._file.read(8 * size))
            before += size

    def is_complete(self, index: int) -> bool:
        """Whether no number of a column is missing."""
        return not any(np.isnan(piece).any() for piece in self.column(index))

    def close(self) -> None:
        """Frees memory and disk space."""
        self._groups.close()
        with contextlib.suppress(OSError):
            self._file.close()

    def _store(self, groups: Iterable[np.ndarray]) -> None:
        for group in groups:
            self._file.write(np.ascontiguousarray(group).data)
            self._sizes.append(group.shape[1])
