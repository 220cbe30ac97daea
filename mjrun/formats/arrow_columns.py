"""Columns as Apache Arrow holds them, for the formats that pyarrow writes and reads: Parquet and Feather.

A text column is a dictionary of strings, null for no text; a column of integers has 64 bits, null for NaN. The metadata
of a field has `unit`, `meaning`, `kind` and `id`; the metadata of the schema has the manifest under `mjrun`.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow
import pyarrow.parquet
from numpy.typing import DTypeLike
from pyarrow import types

from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, clean, shortened
from mjrun.formats import table_read_stream as tables
from mjrun.formats.number_text import exact_cells
from mjrun.formats.table_read_stream import AcceptedCells
from mjrun.model.table_column import Column

MANIFEST = "mjrun"  # the key of the manifest


def schema_of(columns: Sequence[Column]) -> pyarrow.Schema:
    """Returns the Arrow schema of `columns`."""
    text = pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
    fields: list[pyarrow.Field] = []
    for column in columns:
        kind = text if column.labels else pyarrow.int64() if column.integer else pyarrow.float64()
        metadata = {"unit": column.unit, "meaning": column.meaning, "kind": column.kind, "id": str(column.id)}
        fields.append(pyarrow.field(column.name, kind, metadata=metadata))
    return pyarrow.schema(fields)


def record_batch(group: np.ndarray, columns: Sequence[Column], schema: pyarrow.Schema) -> pyarrow.RecordBatch:
    """Returns the rows in `group` `(columns, rows)`."""
    return pyarrow.record_batch([_array(*pair) for pair in zip(group, columns, strict=True)], schema=schema)


def select_columns(
    path: Path, schema: pyarrow.Schema, wanted: tables.ColumnFilter, cells: AcceptedCells
) -> dict[str, int]:
    """Returns the columns that the filter accepts, each with its index.

    Raises:
      FileError: two of them have one name, or one holds something other than the accepted cells.
    """
    indices = tables.select(path, schema.names, wanted)
    for name, index in indices.items():
        kind = schema.field(index).type
        inner = kind.value_type if types.is_dictionary(kind) else kind
        kinds = [types.is_floating, types.is_integer, types.is_boolean, types.is_decimal]
        if cells is AcceptedCells.ANY:
            kinds += [_is_text, types.is_null]
        if not any(is_kind(inner) for is_kind in kinds):
            raise tables.not_numbers(path, name, clean(shortened(str(inner))))
    return indices


def block_rows(columns: int) -> int:
    """Returns the number of rows in a block of `columns` columns."""
    return max(1, tables.PIECE // max(1, columns))


def blocks(
    path: Path, names: Sequence[str], batches: Iterable[pyarrow.RecordBatch], cells: AcceptedCells
) -> Iterator[np.ndarray]:
    """Yields the rows of `batches`, which hold the columns `names` and nothing else, in blocks `(n, columns)`.

    Raises:
      FileError: a value is null, and gaps are not accepted; the message names the row.
    """
    before = 0
    for batch in batches:
        size = block_rows(len(names))
        for piece in (batch.slice(start, size) for start in range(0, batch.num_rows, size)):
            pairs = zip(names, piece.columns, strict=True)
            columns = [_cells(path, name, array, before, cells) for name, array in pairs]
            before += piece.num_rows
            yield tables.side_by_side(columns, piece.num_rows)


def row_group_sizes(metadata: pyarrow.parquet.FileMetaData) -> list[int]:
    """Returns the decompressed bytes of the pages in each row group, as a Parquet file states them."""
    return [metadata.row_group(index).total_byte_size for index in range(metadata.num_row_groups)]


def column_sizes(metadata: pyarrow.parquet.FileMetaData, names: Collection[str]) -> list[int]:
    """Returns the decompressed bytes of the pages of columns in each row group, as a Parquet file states them.

    If these metadata are damaged, pyarrow ends the process; it raises no error before they are read for the data.
    """
    groups = [metadata.row_group(index) for index in range(metadata.num_row_groups)]
    chunks = [[group.column(index) for index in range(group.num_columns)] for group in groups]
    return [sum(each.total_uncompressed_size for each in row if each.path_in_schema in names) for row in chunks]


def require_rows(rows: int, stated: int) -> None:
    """Raises ValueError if a table has other than its stated number of rows: a damaged page can be skipped."""
    if rows != stated:
        raise ValueError(f"it has {rows} of {stated} rows")


def parquet_columns(
    path: Path, file: BinaryIO, repeated: Sequence[str] = ()
) -> Iterator[tuple[pyarrow.Field, pyarrow.ChunkedArray]]:
    """Yields the columns of the table in a Parquet file, one after the other.

    Args:
      path: the path of the file, for messages.
      repeated: text columns to read as dictionaries, which have equal texts in memory once.

    Raises:
      FileError: it would fill the memory.
    """
    content = pyarrow.parquet.ParquetFile(file, read_dictionary=[*repeated], page_checksum_verification=True)
    numbers = 8 * content.metadata.num_rows * content.metadata.num_columns  # bytes
    require_expandable(path, numbers + sum(row_group_sizes(content.metadata)), file)
    for index, name in enumerate(content.schema_arrow.names):
        column = content.read([name], use_threads=False).column(name)
        require_rows(len(column), content.metadata.num_rows)
        yield content.schema_arrow.field(index), column


def parquet_groups(
    path: Path, file: BinaryIO, repeated: Sequence[str] = (), without: Collection[str] = ()
) -> Iterator[pyarrow.Table]:
    """Yields the row groups of a Parquet file.

    Args:
      path: the path of the file, for messages.
      repeated: text columns to read as dictionaries, if they exist.
      without: columns to leave out.

    Raises:
      FileError: one of them would fill the memory.
    """
    texts = [field.name for field in pyarrow.parquet.read_schema(file) if _is_text(field.type)]
    dictionaries = [name for name in repeated if name in texts]
    content = pyarrow.parquet.ParquetFile(file, read_dictionary=dictionaries, page_checksum_verification=True)
    metadata = content.metadata
    names = [name for name in content.schema_arrow.names if name not in without]
    for index, size in enumerate(row_group_sizes(metadata)):
        require_expandable(path, size + 8 * metadata.row_group(index).num_rows * metadata.num_columns, file)
        yield content.read_row_group(index, names, use_threads=False)  # which would decode all columns at once


def units(schema: pyarrow.Schema, indices: dict[str, int]) -> dict[str, str]:
    """Returns the units of the selected columns, as far as mjrun wrote them."""
    metadata = {name: schema.field(index).metadata or {} for name, index in indices.items()}
    return {name: values.get(b"unit", b"").decode("utf-8", "replace") for name, values in metadata.items()}


def number_array(values: np.ndarray, valid: np.ndarray | None = None) -> pyarrow.Array:
    """Returns an Arrow array of `values` `(n,)`; those that are not `valid` are null.

    `pyarrow.array` does the same, but imports pandas where it is installed, to recognize its types.
    """
    mask = None
    if valid is not None and not valid.all():
        mask = pyarrow.py_buffer(np.packbits(valid, bitorder="little"))
    data = pyarrow.py_buffer(np.ascontiguousarray(values))
    return pyarrow.Array.from_buffers(pyarrow.from_numpy_dtype(values.dtype), len(values), [mask, data])


def array_numbers(array: pyarrow.Array, dtype: DTypeLike) -> np.ndarray:
    """Returns the numbers of an Arrow array `(n,)`, whatever they are where the array is null.

    Its method `to_numpy` does the same, but imports pandas where it is installed.
    """
    return np.frombuffer(array.buffers()[1] or b"", dtype)[array.offset : array.offset + len(array)]


def column_numbers(column: pyarrow.ChunkedArray) -> np.ndarray:
    """Returns a column as floats `(n,)`, NaN where it is null; numbers of other kinds as `to_numpy`, see above."""
    if not (types.is_float64(column.type) or types.is_int64(column.type)):
        return column.to_numpy().astype(float)
    values, start = np.empty(len(column)), 0
    for chunk in column.chunks:
        part = values[start : start + len(chunk)]
        part[:] = array_numbers(chunk, np.int64 if types.is_int64(column.type) else np.float64)
        part[~array_validity(chunk)] = np.nan
        start += len(chunk)
    return values


def array_validity(array: pyarrow.Array) -> np.ndarray:
    """Returns whether each value of an Arrow array exists, `(n,)`."""
    bits = array.buffers()[0]
    if bits is None or not array.null_count:
        return np.ones(len(array), bool)
    valid = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little").astype(bool)
    return valid[array.offset : array.offset + len(array)]


def cast_texts(table: pyarrow.Table, schema: pyarrow.Schema) -> pyarrow.Table:
    """Returns a table whose dictionaries of texts are plain texts where `schema`, of the same columns, says so.

    Its method `cast` does the same, but imports `pyarrow.compute`, which takes longer than a small study.
    """
    columns = list[pyarrow.ChunkedArray]()
    for column, kind in zip(table.columns, schema.types, strict=True):
        if column.type == kind:
            columns.append(column)
        elif types.is_dictionary(column.type) and not column.null_count:
            columns.append(pyarrow.chunked_array([_plain_texts(chunk) for chunk in column.chunks], kind))
        else:
            columns.append(column.cast(kind))
    return pyarrow.Table.from_arrays(columns, schema=schema)


def _plain_texts(array: pyarrow.DictionaryArray) -> pyarrow.Array:
    texts = array.dictionary.to_pylist()
    return text_array([texts[code] for code in array_numbers(array.indices, np.int32)])


def text_array(texts: Sequence[str]) -> pyarrow.Array:
    """Returns an Arrow array of texts."""
    encoded = [text.encode() for text in texts]
    offsets = np.zeros(len(encoded) + 1, np.int32)
    np.cumsum([len(text) for text in encoded], out=offsets[1:])
    return pyarrow.StringArray.from_buffers(
        len(encoded), pyarrow.py_buffer(offsets), pyarrow.py_buffer(b"".join(encoded))
    )


def _array(values: np.ndarray, column: Column) -> pyarrow.Array:
    if column.integer:
        gaps = np.isnan(values)
        return number_array(np.where(gaps, 0, values).astype(np.int64), ~gaps)
    if not column.labels:
        return number_array(values)
    indices = number_array(values.astype(np.int32), values >= 0)
    return pyarrow.DictionaryArray.from_arrays(indices, text_array(column.labels))


def _cells(path: Path, name: str, array: pyarrow.Array, before: int, cells: AcceptedCells) -> np.ndarray:
    if types.is_dictionary(array.type) and _is_text(array.type.value_type):
        texts = array.dictionary.to_pylist()  # each is in memory once, however often it occurs
        return tables.text_cells([None if index is None else texts[index] for index in array.indices.to_pylist()])
    plain = array.dictionary_decode() if types.is_dictionary(array.type) else array
    if _is_text(plain.type):
        return tables.text_cells(plain.to_pylist())
    if types.is_decimal(plain.type) and cells is AcceptedCells.ANY:
        return exact_cells(plain.to_pylist(), _floats)
    if not plain.null_count:
        return tables.number_cells(plain.to_numpy(zero_copy_only=False), cells)

    null = plain.is_null().to_numpy(zero_copy_only=False)
    if cells < AcceptedCells.GAPS:
        row = before + int(null.argmax())
        raise FileError(path, f"row {row}: column {tables.shown(name)}: null is not a number")
    numbers = tables.number_cells(plain.drop_null().to_numpy(zero_copy_only=False), cells)
    values = np.full(len(null), np.nan, numbers.dtype)
    values[~null] = numbers
    return values


def _is_text(kind: pyarrow.DataType) -> bool:
    return types.is_string(kind) or types.is_large_string(kind)


def _floats(values: list[Any]) -> np.ndarray:
    return np.array([np.nan if value is None else float(value) for value in values])
