"""Columns in Arrow, beside pyarrow."""

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet as pq
import pytest

from mjrun.errors import FileError
from mjrun.formats.arrow_columns import cast_texts, column_numbers, parquet_columns, parquet_groups
from mjrun.formats.table_reader import read_table
from tests.formats.table_files import bits, lists, write


@pytest.mark.parametrize("read", [pq.read_schema, lambda path: pyarrow.feather.read_table(path).schema])
def test_arrow_fields_say_unit_meaning_and_object(tmp_path: Path, read: Callable[[Path], pa.Schema]) -> None:
    schema = read(write(tmp_path / ("t.parquet" if read is pq.read_schema else "t.feather"), []))
    assert [field.type for field in schema] == [pa.float64()] * 3
    assert schema.field("qpos/knee").metadata == {
        b"unit": b"rad",
        b"meaning": b"joint angle",
        b"kind": b"joint",
        b"id": b"3",
    }


ARROW = {
    "time": pa.array([0.5, np.nan, 1e300]),
    "int": pa.array([1, -2, 3], pa.int8()),
    "uint": pa.array([1, 2, 2**64 - 1], pa.uint64()),
    "half": pa.array(np.array([0.5, 1, 2], np.float16)),
    "single": pa.array([0.1, 1, 2], pa.float32()),
    "bool": pa.array([True, False, True]),
    "decimal": pa.array([Decimal("0.001"), Decimal("-12.300"), Decimal(7)], pa.decimal128(18, 3)),
    "category": pa.array([0.1, 5, 0.1]).dictionary_encode(),
    "a": pa.array([1.0, 2.0, 3.0]),
    "a.b": pa.array([4.0, 5.0, 6.0]),
    "nested": pa.array([{"b": 1}, {"b": None}, None]),
    "note": pa.array(["x", None, "z"]),
    "when": pa.array([1, 2, 3], pa.timestamp("ns")),
}


NUMBERS = list(ARROW)[: list(ARROW).index("nested")]


def expected(name: str) -> list[int]:
    return bits([float(value) for value in ARROW[name].to_pylist()])


@pytest.mark.parametrize("suffix", [".parquet", ".feather", ".arrow"])
@pytest.mark.parametrize("names", [NUMBERS, ["a"], ["a.b"], ["category", "int"]])
def test_every_type_of_number_in_arrow_is_read(tmp_path: Path, suffix: str, names: list[str]) -> None:
    path, table = tmp_path / f"t{suffix}", pa.table(ARROW)
    if suffix == ".parquet":
        pq.write_table(table, path, row_group_size=2)
    else:
        pyarrow.feather.write_feather(table, path, compression="zstd", chunksize=2)
    found = lists(path, *names)
    assert list(found) == [name for name in NUMBERS if name in names]
    assert {name: bits(values) for name, values in found.items()} == {name: expected(name) for name in found}


def test_columns_of_a_table_are_what_pyarrow_reads_unless_it_would_fill_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.parquet"
    table = pa.table({"a": np.zeros(2**18), "text": ["the same"] * 2**18})
    pq.write_table(table, path)
    with path.open("rb") as file:
        assert {field.name: column for field, column in parquet_columns(path, file)} == {
            name: table[name] for name in table.column_names
        }
    with path.open("rb") as file:
        texts = {field.name: column for field, column in parquet_columns(path, file, ["text"])}["text"]
        assert pa.types.is_dictionary(texts.type)
        assert texts.to_pylist() == table["text"].to_pylist()
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with path.open("rb") as file, pytest.raises(FileError, match=r"a\.parquet: would expand to [\d.]+ GB in memory"):
        list(parquet_columns(path, file))


def by_mjrun(path: Path, file: BinaryIO) -> list[list[float]]:
    return [table[name].tolist() for table in [read_table(path)] for name in table.names]


def as_columns(path: Path, file: BinaryIO) -> list[list[float]]:
    return [column_numbers(column).tolist() for _, column in parquet_columns(path, file)]


def as_groups(path: Path, file: BinaryIO) -> list[list[float]]:
    return [column_numbers(column).tolist() for table in parquet_groups(path, file) for column in table.columns]


@pytest.mark.parametrize("read", [by_mjrun, as_columns, as_groups])
def test_a_flipped_bit_of_a_parquet_file_ends_no_process_and_changes_no_number(
    tmp_path: Path, read: Callable[[Path, BinaryIO], list[list[float]]]
) -> None:
    path = tmp_path / "t.parquet"
    rows = np.arange(12).reshape(4, 3) / 7
    write(path, [rows])
    content, damages = path.read_bytes(), 0
    footer = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    for place in (*range(4, 300, 3), *range(footer, footer + 48)):  # in pages, and at the beginning of the metadata
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            with path.open("rb") as file:
                found = read(path, file)
        except (FileError, OSError, ValueError):
            damages += 1
        else:
            assert found == rows.T.tolist()
    assert damages > 60


def test_casting_texts_gives_the_table_that_arrow_casts() -> None:
    codes = pa.array([1, 0, 1, 2], pa.int32())
    texts = pa.DictionaryArray.from_arrays(codes, pa.array(["µ", "ab", ""]))
    with_null = pa.DictionaryArray.from_arrays(pa.array([0, None, 0, 0], pa.int32()), ["x"])
    parts = [pa.table({"a": texts, "b": with_null, "c": [1, 2, 3, 4]})] * 2
    table = pa.concat_tables([parts[0], parts[1].slice(1, 2)])
    schema = pa.schema({"a": pa.string(), "b": pa.string(), "c": pa.int64()}, {"study": "s"})
    assert cast_texts(table, schema).equals(table.cast(schema), check_metadata=True)
