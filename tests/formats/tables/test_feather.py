"""Feather tables, beside pyarrow."""

import contextlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pytest
from pyarrow import ipc

from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables.feather import batch_sizes
from mjrun.model.table_column import Column


def test_batches_are_compressed_and_do_not_follow_the_blocks(tmp_path: Path) -> None:
    with TableWriter(str(tmp_path / "t.arrow"), "feather", [Column("time", "s"), Column("qpos/a", "rad")]) as out:
        for _ in range(100):
            out.write(np.zeros((50, 2)))
        out.publish()
    with ipc.open_file(tmp_path / "t.arrow") as file:
        assert file.num_record_batches == 1
        assert file.read_all().num_rows == 5000
    assert (tmp_path / "t.arrow").stat().st_size < 5000


def test_a_file_of_many_batches_with_other_columns_is_read(tmp_path: Path) -> None:
    time = np.random.default_rng(0).standard_normal(100)
    table = pa.table({"note": ["x"] * 100, "time": time})
    pyarrow.feather.write_feather(table, tmp_path / "t.feather", chunksize=7)
    found = read_table(tmp_path / "t.feather", ["time"])
    assert np.array_equal(found["time"], time)
    assert read_table(tmp_path / "t.feather", []).names == []


def write(path: Path, compression: str | None, rows: int = 1000) -> Path:
    """A file of three batches, with numbers, gaps, and texts in a dictionary."""
    numbers = np.random.default_rng(0).standard_normal(rows)
    texts = pa.array(["one", "two"] * (rows // 2)).dictionary_encode()
    table = pa.table({"a": numbers, "zeros": np.zeros(rows), "gaps": [None, 1.5] * (rows // 2), "text": texts})
    options = ipc.IpcWriteOptions(compression=compression)
    with ipc.new_file(path, table.schema, options=options) as file:
        file.write_table(table, max_chunksize=400)
    return path


@pytest.mark.parametrize("compression", [None, "lz4", "zstd"])
def test_sizes_are_those_of_the_buffers_in_memory(tmp_path: Path, compression: str | None) -> None:
    path = write(tmp_path / "a.arrow", compression)
    with path.open("rb") as file:
        dictionaries, *batches = batch_sizes(file)
    with ipc.open_file(path) as file:
        expected = [file.get_batch(index) for index in range(file.num_record_batches)]
    assert len(batches) == len(expected) == 3
    for size, batch in zip(batches, expected, strict=True):
        own = batch.drop_columns(["text"]).get_total_buffer_size()
        assert own <= size <= own + 4 * batch.num_rows + 512  # and the indices of texts, and padding
    assert 6 <= dictionaries <= 512


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_file_is_an_error_or_sizes(tmp_path: Path, seed: int) -> None:
    content = bytearray(write(tmp_path / "a.arrow", "lz4").read_bytes())
    random = np.random.default_rng(seed)
    for at in random.integers(len(content) - 400, len(content), 8):
        content[at] = random.integers(256)
    path = tmp_path / "b.arrow"
    path.write_bytes(content[: random.integers(1, len(content) + 1)] if seed % 2 else content)
    with path.open("rb") as file, contextlib.suppress(ValueError):
        assert all(isinstance(size, int) for size in batch_sizes(file))


def test_what_is_no_file_of_arrow_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"")
    with (tmp_path / "a").open("rb") as file, pytest.raises(ValueError, match="outside the file"):
        batch_sizes(file)
