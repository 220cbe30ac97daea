"""Feather: an Arrow IPC file, lz4, with units and the manifest given at opening; see `arrow_columns`.

The schema comes first in the file, and the manifest with it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mjrun.formats.table_format import Cells, ColumnFilter, TableContents, TableFormat
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


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
    """The columns that the filter accepts."""
    from pyarrow import ipc

    from mjrun.expansion import require_expandable
    from mjrun.formats.arrow_columns import MANIFEST, blocks, select_columns, units
    from mjrun.formats.arrow_sizes import batch_sizes
    from mjrun.formats.column_checks import unreadable
    from mjrun.formats.input_file import decoded, decoding
    from mjrun.formats.manifest import parse_manifest

    with decoding(path, unreadable(path)):
        require_expandable(path, max(batch_sizes(file)))  # dictionaries, or a batch, are whole in memory
        file.seek(0)
        schema = ipc.open_file(file).schema
    indices = select_columns(path, schema, wanted, cells)
    batches = _batches(file, list(indices.values()))
    rows = decoded(path, unreadable(path), blocks(path, list(indices), batches, cells))
    manifest = parse_manifest((schema.metadata or {}).get(MANIFEST.encode()))
    return TableContents(list(indices), rows, units(schema, indices), manifest)


def _batches(file: BinaryIO, fields: list[int]) -> Iterator[pyarrow.RecordBatch]:
    """The batches of the fields, whose offsets and indices come from the file and are checked first."""
    from pyarrow import ipc

    if not fields:  # no field included would mean all
        return
    arrow = ipc.open_file(file, options=ipc.IpcReadOptions(included_fields=fields))
    for index in range(arrow.num_record_batches):
        batch = arrow.get_batch(index)
        batch.validate(full=True)
        yield batch


FORMAT = TableFormat("feather", (".feather", ".arrow"), FeatherWriter, read, library="pyarrow", extra="parquet")
