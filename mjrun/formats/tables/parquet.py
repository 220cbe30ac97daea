"""Parquet: flat float64 columns in zstd row groups, with units and the manifest; see `arrow_columns`.

The manifest is also in the file's own key-value metadata, where DuckDB finds it.
"""

import base64
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow.parquet

from mjrun.decompression_limits import excess, require_expandable
from mjrun.formats import arrow_columns as arrow
from mjrun.formats import table_read_stream as tables
from mjrun.formats.input_file import decoded, decoding, parse_manifest
from mjrun.formats.table_writer import RowGroupWriter
from mjrun.model.table_column import Column

BUFFER = 2**16  # bytes of a column that are read at a time; without it, a whole row group


class ParquetWriter(RowGroupWriter):
    """A writer of row groups of bounded size."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        super().__init__(columns)
        self._schema = arrow.schema_of(columns)
        texts: Any = [column.name for column in columns if column.labels]
        self.writer = pyarrow.parquet.ParquetWriter(
            file, self._schema, compression="zstd", use_dictionary=texts, write_page_checksum=True
        )

    def write_group(self, group: np.ndarray) -> None:
        self.writer.write_table(pyarrow.Table.from_batches([arrow.record_batch(group, self.columns, self._schema)]))

    def end(self, manifest: str) -> None:
        # Arrow stores its own schema, metadata included, beside that of Parquet: both get the same manifest.
        final = base64.b64encode(self._schema.with_metadata({arrow.MANIFEST: manifest}).serialize())
        self.writer.add_key_value_metadata({arrow.MANIFEST: manifest, "ARROW:schema": final})

    def close(self) -> None:
        super().close()
        self.writer.is_open = False  # otherwise its finalizer would try once more


def read(
    path: Path, file: BinaryIO, wanted: tables.ColumnFilter, cells: tables.AcceptedCells
) -> tables.TableReadStream:
    """Reads the accepted columns."""
    with decoding(path):
        parquet = pyarrow.parquet.ParquetFile(
            file, pre_buffer=False, buffer_size=BUFFER, page_checksum_verification=True
        )
        schema, metadata = parquet.schema_arrow, parquet.metadata.metadata or {}
    indices = arrow.select_columns(path, schema, wanted, cells)
    names = list(indices)
    tables.require_plausible_size(path, parquet.metadata.num_rows, len(names), file)
    with decoding(path):
        # A page is whole in memory, and may be all of a column in a row group.
        size = max(arrow.row_group_sizes(parquet.metadata), default=0)
        if excess(path, size, file):
            size = max(arrow.column_sizes(parquet.metadata, set(names)))
        require_expandable(path, size, file)
    rows = decoded(path, arrow.blocks(path, names, _batches(parquet, names), cells))
    manifest = parse_manifest(metadata.get(arrow.MANIFEST.encode()))
    return tables.TableReadStream(names, rows, arrow.units(schema, indices), manifest)


def _batches(parquet: pyarrow.parquet.ParquetFile, names: list[str]) -> Iterator[pyarrow.RecordBatch]:
    """Yields the rows of columns."""
    rows = 0
    for batch in parquet.iter_batches(arrow.block_rows(len(names)), columns=names):
        rows += batch.num_rows
        yield batch.select(names)
    arrow.require_rows(rows, parquet.metadata.num_rows)
