"""Feather: an Arrow IPC file, lz4, with units and the manifest given at opening; see `arrow_columns`.

The schema comes first in the file, and the manifest with it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mjrun.formats.table import Table
from mjrun.formats.table_format import ColumnFilter, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np
    import pyarrow


class FeatherWriter:
    """Writes record batches of bounded size."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import pyarrow

        from mjrun.formats.arrow_columns import MANIFEST, schema
        from mjrun.formats.row_groups import RowGroups

        self._columns, self._groups = columns, RowGroups(len(columns))
        self._schema = schema(columns).with_metadata({MANIFEST: manifest})
        options = pyarrow.ipc.IpcWriteOptions(compression="lz4")
        self._writer = pyarrow.ipc.new_file(file, self._schema, options=options)

    def write(self, block: np.ndarray) -> None:
        for group in self._groups.add(block):
            self._write(group)

    def finish(self, manifest: str) -> None:
        for group in self._groups.rest():
            self._write(group)
        self._writer.close()

    def close(self) -> None:
        self._groups.close()
        with contextlib.suppress(Exception):  # it may have stopped anywhere
            self._writer.close()

    def _write(self, group: np.ndarray) -> None:
        from mjrun.formats.arrow_columns import record_batch

        self._writer.write_batch(record_batch(group, self._columns, self._schema))


def read(path: Path, wanted: ColumnFilter) -> Table:
    """The columns that the filter accepts."""
    from pyarrow import ipc

    from mjrun.formats.arrow_columns import select_numbers, table
    from mjrun.formats.column_checks import unreadable
    from mjrun.formats.input_file import decoding

    with path.open("rb") as file:
        with decoding(path, unreadable(path)):
            schema = ipc.open_file(file).schema
        indices = select_numbers(path, schema, wanted)
        if not indices:  # no field included would mean all
            return Table({})
        with decoding(path, unreadable(path)):
            options = ipc.IpcReadOptions(included_fields=list(indices.values()))
            arrow = ipc.open_file(file, options=options)
            batches = (_valid(arrow.get_batch(index)) for index in range(arrow.num_record_batches))
            return table(path, schema, indices, batches)


def _valid(batch: pyarrow.RecordBatch) -> list[pyarrow.Array]:
    """The columns of a batch, whose offsets and indices come from the file and are checked first."""
    batch.validate(full=True)
    return batch.columns


FORMAT = TableFormat("feather", (".feather", ".arrow"), FeatherWriter, read, library="pyarrow", extra="parquet")
