"""Parquet tables, beside pyarrow."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column
from tests.formats.table_files import COLUMNS, MANIFEST, write

FINAL = {"mjrun": "0.1.0", "seed": 7, "rows": 3}


def test_in_parquet_labels_are_kept_once_to_a_group(tmp_path: Path) -> None:
    data = np.random.default_rng(3).integers(-1, 2, (50_000, 1)).astype(float)
    found = pq.read_metadata(write(tmp_path / "t.parquet", [data], [Column("geom1", labels=("floor", "torso"))]))
    column = found.row_group(0).column(0)
    assert column.has_dictionary_page
    assert column.total_uncompressed_size < 50_000 / 2  # 2 bits a row


def test_parquet_tells_the_same_manifest_to_readers_without_arrow(tmp_path: Path) -> None:
    with TableWriter(str(tmp_path / "t.parquet"), "parquet", COLUMNS, MANIFEST) as out:
        out.publish(FINAL)
    assert json.loads(pq.read_metadata(tmp_path / "t.parquet").metadata[b"mjrun"]) == FINAL


def test_parquet_s_groups_do_not_follow_the_blocks(tmp_path: Path) -> None:
    found = pq.read_metadata(write(tmp_path / "t.parquet", [np.zeros((10, 3))] * 500))
    assert (found.num_row_groups, found.num_rows) == (1, 5000)
    assert found.row_group(0).column(0).compression == "ZSTD"
