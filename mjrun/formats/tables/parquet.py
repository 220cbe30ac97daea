"""Parquet: flat float64 columns in zstd row groups, with units and the manifest; see `arrow_columns`.

The manifest is also in the file's own key-value metadata, where DuckDB finds it.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.expansion import require_expandable
from mjrun.formats.input_file import decoded, decoding, parse_manifest
from mjrun.formats.row_groups import GroupWriter
from mjrun.formats.table_format import Cells, ColumnFilter, TableContents, TableFormat, require_plausible_size
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

BUFFER = 2**16  # bytes of a column that are read at a time; otherwise all of a row group


class ParquetWriter(GroupWriter):
    """Writes row groups of bounded size."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import pyarrow.parquet

        from mjrun.formats.arrow_columns import schema_of

        super().__init__(columns)
        self._schema = schema_of(columns)
        texts: Any = [column.name for column in columns if column.labels]
        self.writer = pyarrow.parquet.ParquetWriter(file, self._schema, compression="zstd", use_dictionary=texts)

    def write_group(self, group: np.ndarray) -> None:
        import pyarrow

        from mjrun.formats.arrow_columns import record_batch

        self.writer.write_table(pyarrow.Table.from_batches([record_batch(group, self.columns, self._schema)]))

    def end(self, manifest: str) -> None:
        from mjrun.formats.arrow_columns import MANIFEST

        # Arrow keeps its own schema, metadata included, beside that of Parquet: both get the same manifest.
        final = base64.b64encode(self._schema.with_metadata({MANIFEST: manifest}).serialize())
        self.writer.add_key_value_metadata({MANIFEST: manifest, "ARROW:schema": final})

    def close(self) -> None:
        super().close()
        self.writer.is_open = False  # or its finalizer would try once more


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
    """The columns that the filter accepts."""
    import pyarrow.parquet

    from mjrun.formats import arrow_columns as arrow

    with decoding(path):
        parquet = pyarrow.parquet.ParquetFile(file, pre_buffer=False, buffer_size=BUFFER)
        schema, metadata = parquet.schema_arrow, parquet.metadata.metadata or {}
    indices = arrow.select_columns(path, schema, wanted, cells)
    names = list(indices)
    require_plausible_size(path, parquet.metadata.num_rows, len(names))
    with decoding(path):
        # A page is whole in memory, and may be all of a column in a row group.
        require_expandable(path, max(arrow.row_group_sizes(parquet.metadata, set(names)), default=0))
    batches = parquet.iter_batches(arrow.block_rows(len(names)), columns=names)
    rows = decoded(path, arrow.blocks(path, names, (batch.select(names) for batch in batches), cells))
    return TableContents(
        names, rows, arrow.units(schema, indices), parse_manifest(metadata.get(arrow.MANIFEST.encode()))
    )


FORMAT = TableFormat("parquet", (".parquet",), ParquetWriter, read, library="pyarrow", extra="parquet")
