"""Rows turned into columns, for the formats that hold a table by column.

Rows arrive in blocks and are transposed in groups of bounded size. Parquet and Feather take one group after the
other; npz, mat and hdf5 need whole columns, so their groups wait in an unnamed file beside the table.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.formats.table_format import RowWriter
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

GROUP = 2**21  # values in a group: 16 MiB
FIRST_ROWS = 2**9  # rows for which there is room at first: a short table needs little memory


class RowGroups:
    """Takes rows, yields groups `(columns, rows)` of at most `GROUP` values, each valid until the next one."""

    def __init__(self, columns: int) -> None:
        import numpy as np

        self._rows = max(1, GROUP // columns)  # in a full group
        self._group = np.empty((columns, min(self._rows, FIRST_ROWS)))
        self._filled = 0

    def add(self, block: np.ndarray) -> Iterator[np.ndarray]:
        """Takes the rows of `block` `(n, columns)` and yields every group they fill."""
        while len(block):
            part, block = block[: self._rows - self._filled], block[self._rows - self._filled :]
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
        self._group = self._group[:0, :0].copy()

    def _grow(self, rows: int) -> None:
        """Makes room for `rows` rows and, as more are to come, for twice as many as before."""
        import numpy as np

        before = self._group
        self._group = np.empty((len(before), min(self._rows, max(rows, 2 * before.shape[1]))))
        self._group[:, : self._filled] = before[:, : self._filled]


class GroupWriter(RowWriter):
    """Base of the writers that take one group after the other.

    Attributes:
      writer: of the library, which `close` closes whatever has happened.
    """

    writer: Any

    def __init__(self, columns: Sequence[Column]) -> None:
        self.columns, self._groups = columns, RowGroups(len(columns))

    def write(self, block: np.ndarray) -> None:
        for group in self._groups.add(block):
            self.write_group(group)

    def finish(self, manifest: str) -> None:
        for group in self._groups.rest():
            self.write_group(group)
        self.end(manifest)
        self.writer.close()

    def close(self) -> None:
        self._groups.close()
        with contextlib.suppress(Exception):  # it may have stopped anywhere
            self.writer.close()

    def write_group(self, group: np.ndarray) -> None:
        """Writes the rows of `group` `(columns, rows)`."""
        raise NotImplementedError

    def end(self, manifest: str) -> None:
        """Writes what comes after the last group."""


class ColumnWriter(RowWriter):
    """Base of the writers that need whole columns.

    Rows wait in a file without a name, which no failure leaves behind. It is beside the table, whose disk must have the
    space.

    Attributes:
      rows: so far.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import tempfile  # which help does without

        self.file, self.columns, self.rows = file, columns, 0
        self._groups = RowGroups(len(columns))
        self._sizes: list[int] = []  # rows in each group
        self._stored = tempfile.TemporaryFile(dir=Path(file.name).parent)  # noqa: SIM115  (closed by close)

    def write(self, block: np.ndarray) -> None:
        self.rows += len(block)
        for group in self._groups.add(block):
            self._store(group)

    def finish(self, manifest: str) -> None:
        for group in self._groups.rest():
            self._store(group)
        self.save(manifest)

    def close(self) -> None:
        self._groups.close()
        with contextlib.suppress(OSError):
            self._stored.close()

    def save(self, manifest: str) -> None:
        """Writes the table, whose columns are known now."""
        raise NotImplementedError

    def values(self, index: int) -> Iterator[np.ndarray]:
        """The values of one column, in pieces."""
        import numpy as np

        before = 0
        for size in self._sizes:
            self._stored.seek(8 * (len(self.columns) * before + index * size))
            yield np.frombuffer(self._stored.read(8 * size))
            before += size

    def is_whole(self, index: int) -> bool:
        """Whether a column has integers, and none is missing."""
        import numpy as np

        return self.columns[index].integer and not any(np.isnan(piece).any() for piece in self.values(index))

    def _store(self, group: np.ndarray) -> None:
        import numpy as np

        self._stored.write(np.ascontiguousarray(group).data)
        self._sizes.append(group.shape[1])
