"""A comparison of a simulation with a golden table, block by block while it is measured, in constant memory."""

import queue
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from mjrun.diff.result import TableDifference
from mjrun.diff.tables import compare_rows
from mjrun.diff.tolerances import Tolerances
from mjrun.errors import UsageError, clean, listing
from mjrun.formats.manifest import read_sidecar
from mjrun.formats.table_reader import open_table
from mjrun.model.table_column import Column

TIME = "time"
QUEUED_BLOCKS = 4  # that may wait for their comparison


class GoldenComparison:
    """The comparison of a golden table with rows that are still to come.

    The golden table is opened at once, and read while rows come, in a thread that ends with `finish` or `close`.

    Args:
      path: the path of the golden table.
      columns: the columns of the measured rows.
      tolerances: the tolerances within which numbers agree.

    Attributes:
      manifest: the manifest of the golden table, in it or next to it, or None.

    Raises:
      FileError: the golden table cannot be read.
      UsageError: it has no column except time in common with the rows, or a tolerance applies to none of them.
    """

    def __init__(self, path: str, columns: Sequence[Column], tolerances: Tolerances) -> None:
        golden_names: list[str] = []
        names = {*(column.name for column in columns), *(clean(column.name) for column in columns)}

        def is_common(name: str) -> bool:
            golden_names.append(name)
            return name in names

        self._table = open_table(path, is_common, exact=True)
        try:
            self.manifest = self._table.manifest or read_sidecar(Path(path))
            self._rows = _ComingRows(columns, golden_names)
            self._names = golden_names, list(self._rows.names)
            self._key = TIME if TIME in golden_names else None
            self._columns = [name for name in self._rows.names if name in golden_names and name != self._key]
            if not self._columns:
                raise UsageError(_nothing_in_common(path, *self._names))
            tolerances.require([*self._columns, *([self._key] if self._key else [])])
        except BaseException:
            self._table.close()
            raise

        self._tolerances = tolerances
        self._result: TableDifference | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._compare, name="golden table")
        self._thread.start()

    def add(self, block: np.ndarray) -> None:
        """Adds rows, float64 `(n, columns)`, which may be changed afterwards.

        Raises:
          FileError: the golden table cannot be read further.
        """
        self._raise_failure()
        self._rows.add(np.array(block))

    def finish(self) -> TableDifference:
        """Returns the differences between the golden table, `a`, and all rows, `b`.

        Raises:
          FileError: the golden table cannot be read to its end.
        """
        self._end(completely=True)
        self._raise_failure()
        assert self._result
        return self._result

    def close(self) -> None:
        """Cancels the comparison, unless it is finished."""
        self._end(completely=False)

    def _end(self, *, completely: bool) -> None:
        if self._thread.is_alive():
            self._rows.end(completely=completely)
        self._thread.join()
        self._table.close()

    def _compare(self) -> None:
        try:
            self._result = compare_rows(
                self._table, self._rows, self._columns, self._key, self._tolerances, *self._names
            )
            self._table.require_unchanged()
        except BaseException as failure:  # handed to the thread that adds rows
            self._failure = failure
        self._rows.drain()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure


class _GivenUpError(Exception):
    """The comparison was cancelled: no more rows come, and the result is unused."""


class _ComingRows:
    """Rows that one thread adds and another reads; the last item of the queue is whether the rows are complete."""

    path = Path("the simulation")

    def __init__(self, columns: Sequence[Column], golden_names: Sequence[str]) -> None:
        # .csv contains cleaned names.
        self.names = [c.name if c.name in golden_names else clean(c.name) for c in columns]
        self.units: Mapping[str, str] = {n: c.unit for n, c in zip(self.names, columns, strict=True)}
        self._queue: queue.Queue[np.ndarray | bool] = queue.Queue(QUEUED_BLOCKS)
        self._is_ended = False

    def add(self, block: np.ndarray) -> None:
        if len(block):
            self._queue.put(block)

    def end(self, *, completely: bool) -> None:
        self._queue.put(completely)

    def blocks(self) -> Iterator[np.ndarray]:
        while not isinstance(block := self._queue.get(), bool):
            yield block
        self._is_ended = True
        if not block:
            raise _GivenUpError

    def drain(self) -> None:
        """Discards the remaining rows, so that adding never blocks."""
        while not self._is_ended:
            self._is_ended = isinstance(self._queue.get(), bool)


def _nothing_in_common(path: str, golden: Sequence[str], measured: Sequence[str]) -> str:
    lists = [f"{clean(path)}: {listing(golden) or 'none'}", f"measured: {listing(measured)}"]
    fault = f"the golden table {clean(path)} and the measured columns have nothing except time in common"
    return "\n".join([fault, *lists])
