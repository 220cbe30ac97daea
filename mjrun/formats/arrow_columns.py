"""Columns as Apache Arrow holds them, for the formats that pyarrow writes and reads: Parquet and Feather.

A text column is a dictionary of strings, null for no text. The metadata of a field has `unit`, `meaning`, `kind` and
`id`; that of the schema has the manifest under `mjrun`. pyarrow is imported inside functions: it is an extra.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjrun.errors import FileError, clean
from mjrun.formats.column_checks import select, shown
from mjrun.formats.input_file import cut
from mjrun.formats.table import Table
from mjrun.formats.table_format import ColumnFilter
from mjrun.model.column import Column

if TYPE_CHECKING:
    import pyarrow

MANIFEST = "mjrun"  # the key of the manifest


def schema(columns: Sequence[Column]) -> "pyarrow.Schema":
    """The Arrow schema of `columns`."""
    import pyarrow

    number, text = pyarrow.float64(), pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
    fields = [pyarrow.field(c.name, text if c.labels else number, metadata=_metadata(c)) for c in columns]
    return pyarrow.schema(fields)


def record_batch(group: np.ndarray, columns: Sequence[Column], schema: "pyarrow.Schema") -> "pyarrow.RecordBatch":
    """The rows in `group` `(columns, rows)`."""
    import pyarrow

    return pyarrow.record_batch([_array(*pair) for pair in zip(group, columns, strict=True)], schema=schema)


def select_numbers(path: Path, schema: "pyarrow.Schema", wanted: ColumnFilter) -> dict[str, int]:
    """The columns that the filter accepts, each with its index.

    Raises:
      FileError: two of them have one name, or one does not hold numbers.
    """
    from pyarrow import types

    indices = select(path, schema.names, wanted)
    for name, index in indices.items():
        kind = schema.field(index).type
        inner = kind.value_type if types.is_dictionary(kind) else kind
        numeric = (types.is_floating, types.is_integer, types.is_boolean, types.is_decimal)
        if not any(is_kind(inner) for is_kind in numeric):
            raise FileError(path, f"column {shown(name)} holds {clean(cut(str(inner)))}, not numbers")
    return indices


def table(
    path: Path, schema: "pyarrow.Schema", indices: dict[str, int], batches: Iterable[Sequence["pyarrow.Array"]]
) -> Table:
    """The selected columns, from batches that hold these alone.

    Raises:
      FileError: a value is null; the message says in which row.
    """
    parts = {name: [np.empty(0)] for name in indices}
    before = 0
    for arrays in batches:
        for name, array in zip(indices, arrays, strict=True):
            parts[name].append(_floats(path, name, array, before))
        before += len(arrays[0]) if indices else 0
    units = {name: _unit(schema.field(index)) for name, index in indices.items()}
    return Table({name: np.concatenate(parts.pop(name)) for name in list(parts)}, units)


def _metadata(column: Column) -> dict[str, str]:
    return {"unit": column.unit, "meaning": column.meaning, "kind": column.kind, "id": str(column.id)}


def _unit(field: "pyarrow.Field") -> str:
    return (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")


def _array(values: np.ndarray, column: Column) -> "pyarrow.Array":
    import pyarrow

    if not column.labels:
        return pyarrow.array(values, from_pandas=False)
    indices = pyarrow.array(values.astype(np.int32), mask=values < 0)
    return pyarrow.DictionaryArray.from_arrays(indices, pyarrow.array(column.labels, pyarrow.string()))


def _floats(path: Path, name: str, array: "pyarrow.Array", before: int) -> np.ndarray:
    from pyarrow import types

    plain = array.dictionary_decode() if types.is_dictionary(array.type) else array
    if plain.null_count:
        row = before + int(plain.is_null().to_numpy(zero_copy_only=False).argmax()) + 1
        raise FileError(path, f"row {row}: column {shown(name)}: null is not a number")
    return plain.to_numpy(zero_copy_only=False).astype(np.float64)
