"""Parquet: flat float64 columns in zstd row groups, with units and the manifest; see `arrow_columns`.

The manifest is also in the file's own key-value metadata, where DuckDB finds it.
"""

from __future__ import annotations

import base64
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.formats.table_format import Cells, ColumnFilter, TableContents, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np


BUFFER = 2**16  # bytes of a column that are read at a time; otherwise all of a row group


class ParquetWriter:
    """Writes row groups of bounded size."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import pyarrow.parquet

        from mjrun.formats.arrow_columns import schema
        from mjrun.formats.row_groups import RowGroups

        self._columns, self._groups = columns, RowGroups(len(columns))
        self._schema = schema(columns)
        texts: Any = [column.name for column in columns if column.labels]
        self._writer = pyarrow.parquet.ParquetWriter(file, self._schema, compression="zstd", use_dictionary=texts)

    def write(self, block: np.ndarray) -> None:
        for group in self._groups.add(block):
            self._write(group)

    def finish(self, manifest: str) -> None:
        from mjrun.formats.arrow_columns import MANIFEST

        for group in self._groups.rest():
            self._write(group)
        # Arrow keeps its own schema, metadata included, beside that of Parquet: both get the same manifest.
        final = base64.b64encode(self._schema.with_metadata({MANIFEST: manifest}).serialize())
        self._writer.add_key_value_metadata({MANIFEST: manifest, "ARROW:schema": final})
        self._writer.close()

    def close(self) -> None:
        self._groups.close()
        with contextlib.suppress(Exception):  # it may have stopped anywhere
            self._writer.close()
        self._writer.is_open = False  # or its finalizer would try once more

    def _write(self, group: np.ndarray) -> None:
        import pyarrow

        from mjrun.formats.arrow_columns import record_batch

        self._writer.write_table(pyarrow.Table.from_batches([record_batch(group, self._columns, self._schema)]))


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
    """The columns that the filter accepts."""
    import pyarrow.parquet

    from mjrun.expansion import require_expandable
    from mjrun.formats.arrow_columns import MANIFEST, block_rows, blocks, row_group_sizes, select_columns, units
    from mjrun.formats.column_checks import require_plausible_size, unreadable
    from mjrun.formats.input_file import decoded, decoding
    from mjrun.formats.manifest import parse_manifest

    with decoding(path, unreadable(path)):
        parquet = pyarrow.parquet.ParquetFile(file, pre_buffer=False, buffer_size=BUFFER)
        schema, metadata = parquet.schema_arrow, parquet.metadata.metadata or {}
    indices = select_columns(path, schema, wanted, cells)
    names = list(indices)
    require_plausible_size(path, parquet.metadata.num_rows, len(names))
    with decoding(path, unreadable(path)):
        # A page is whole in memory, and may be all of a column in a row group.
        require_expandable(path, max(row_group_sizes(parquet.metadata, set(names)), default=0))
    batches = parquet.iter_batches(block_rows(len(names)), columns=names)
    ordered = (batch.select(names) for batch in batches)
    rows = decoded(path, unreadable(path), blocks(path, names, ordered, cells))
    return TableContents(names, rows, units(schema, indices), parse_manifest(metadata.get(MANIFEST.encode())))


FORMAT = TableFormat("parquet", (".parquet",), ParquetWriter, read, library="pyarrow", extra="parquet")
