"""Feather: an Arrow IPC file, lz4, with units and the manifest given at opening; see `arrow_columns`.

The schema comes first in the file, and the manifest with it.
"""

import os
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow
from pyarrow import ipc

from mjrun.decompression_limits import require_expandable
from mjrun.formats import arrow_columns as arrow
from mjrun.formats import table_read_stream as tables
from mjrun.formats.input_file import decoded, decoding, parse_manifest
from mjrun.formats.table_writer import RowGroupWriter
from mjrun.model.table_column import Column

MAGIC = b"ARROW1"
MARK = 0xFFFFFFFF  # precedes the length of metadata, since version 0.15
DICTIONARY_BATCH = 2  # type of a message
LENGTH = 8  # bytes before a compressed buffer with its size; -1 if the buffer is stored uncompressed


class FeatherWriter(RowGroupWriter):
    """A writer of record batches of bounded size."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        super().__init__(columns)
        self._schema = arrow.schema_of(columns).with_metadata({arrow.MANIFEST: manifest})
        options = ipc.IpcWriteOptions(compression="lz4", use_threads=False)
        self.writer = ipc.new_file(file, self._schema, options=options)

    def write_group(self, group: np.ndarray) -> None:
        self.writer.write_batch(arrow.record_batch(group, self.columns, self._schema))


def read(
    path: Path, file: BinaryIO, wanted: tables.ColumnFilter, cells: tables.AcceptedCells
) -> tables.TableReadStream:
    """Reads the accepted columns."""
    with decoding(path):
        require_expandable(path, max(batch_sizes(file)), file)  # dictionaries, or a batch, are whole in memory
        file.seek(0)
        schema = ipc.open_file(file).schema
    indices = arrow.select_columns(path, schema, wanted, cells)
    rows = decoded(path, arrow.blocks(path, list(indices), _batches(file, list(indices.values())), cells))
    manifest = parse_manifest((schema.metadata or {}).get(arrow.MANIFEST.encode()))
    return tables.TableReadStream(list(indices), rows, arrow.units(schema, indices), manifest)


def _batches(file: BinaryIO, fields: list[int]) -> Iterator[pyarrow.RecordBatch]:
    """Yields the batches of the fields; their offsets and indices come from the file, and are checked first."""
    if not fields:  # no field included would mean all
        return
    reader = ipc.open_file(file, options=ipc.IpcReadOptions(included_fields=fields))
    for index in range(reader.num_record_batches):
        batch = reader.get_batch(index)
        batch.validate(full=True)
        yield batch


def batch_sizes(file: BinaryIO) -> list[int]:
    """Returns the decompressed bytes of all dictionaries of a file, and of each batch.

    Raises:
      ValueError: the file is damaged.
    """
    end = file.seek(0, os.SEEK_END) - len(MAGIC)
    (length,) = struct.unpack("<i", _bytes(file, end - 4, 4))
    footer = _Table.root(_bytes(file, end - 4 - length, length))
    blocks = [footer.structures(field, "<qi4xq") for field in (2, 3)]  # offset, and bytes of metadata, of each message
    dictionaries, batches = ([_size(file, offset, length) for offset, length, _ in each] for each in blocks)
    return [sum(dictionaries), *batches]


class _Table:
    """A table of a FlatBuffer, at a position in its bytes."""

    def __init__(self, content: bytes, at: int) -> None:
        self.content, self.at = content, at

    @classmethod
    def root(cls, content: bytes) -> "_Table":
        table = cls(content, 0)
        return cls(content, table.number("<I", 0))

    def field(self, number: int) -> int | None:
        """Returns the position of a field; None if it has its default."""
        fields = self.at - self.number("<i", self.at)
        if 4 + 2 * number >= self.number("<H", fields):
            return None
        offset = self.number("<H", fields + 4 + 2 * number)
        return self.at + offset if offset else None

    def table(self, number: int) -> "_Table | None":
        """Returns the table that a field refers to."""
        at = self.field(number)
        return None if at is None else _Table(self.content, at + self.number("<I", at))

    def structures(self, number: int, layout: str) -> Iterator[tuple[int, ...]]:
        """Yields the structures in the vector that a field refers to."""
        if (vector := self.table(number)) is None:
            return
        count = self.number("<I", vector.at)
        size = struct.calcsize(layout)
        if vector.at + 4 + count * size > len(self.content):
            raise ValueError("its metadata are truncated")
        yield from struct.iter_unpack(layout, self.content[vector.at + 4 :][: count * size])

    def number(self, layout: str, at: int) -> int:
        if not 0 <= at <= len(self.content) - struct.calcsize(layout):
            raise ValueError("its metadata are truncated")
        (value,) = struct.unpack_from(layout, self.content, at)
        return value


def _size(file: BinaryIO, offset: int, length: int) -> int:
    """Returns the decompressed bytes of the buffers of the message at `offset`."""
    content = _bytes(file, offset, length)
    is_marked = content[:4] == struct.pack("<I", MARK)
    message = _Table.root(content[8 if is_marked else 4 :])
    kind = message.field(1)
    batch = message.table(2)
    if batch is not None and kind is not None and message.content[kind] == DICTIONARY_BATCH:
        batch = batch.table(1)
    if batch is None:
        return 0
    places = [(offset + length + at, size) for at, size in batch.structures(2, "<qq")]
    if batch.table(3) is None:
        return sum(size for _, size in places)
    sizes = [struct.unpack("<q", _bytes(file, at, LENGTH))[0] if size else 0 for at, size in places]
    if min(sizes, default=0) < -1:
        raise ValueError("a buffer has a negative size")
    return sum(size if unpacked == -1 else unpacked for unpacked, (_, size) in zip(sizes, places, strict=True))


def _bytes(file: BinaryIO, at: int, count: int) -> bytes:
    """Returns the bytes at a place of the file.

    Raises:
      ValueError: the file ends before.
    """
    if at < 0 or count < 0 or at + count > os.fstat(file.fileno()).st_size:
        raise ValueError("its metadata point outside the file")
    file.seek(at)
    return file.read(count)
