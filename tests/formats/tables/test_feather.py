"""Feather tables, beside pyarrow."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
from pyarrow import ipc

from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.model.column import Column


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
