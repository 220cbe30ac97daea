"""Numbers as text: lines and places of bad cells."""

import json
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet as pq
import pytest

from mjrun.errors import FileError
from mjrun.formats import text_columns
from mjrun.formats.table_reader import read_table
from mjrun.formats.tables import npz as npz_format


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def everything(name: str) -> bool:
    return True


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows to a piece, so that small tables have many."""
    monkeypatch.setattr(text_columns, "ROWS", 3)
    monkeypatch.setattr(npz_format, "PIECE", 5)


@pytest.mark.parametrize("row", [1, 2, 3, 4, 7, 11])
@pytest.mark.parametrize("form", ["csv", "jsonl", "parquet", "feather"])
def test_the_place_of_a_bad_cell_is_right_in_every_piece(
    tmp_path: Path, small_pieces: None, form: str, row: int
) -> None:
    cells: list[float | None] = [0.5] * 12
    cells[row - 1] = None
    table, path = pa.table({"note": ["a\nb"] * 12, "time": pa.array(cells, pa.float64())}), tmp_path / f"t.{form}"
    if form == "csv":
        pyarrow.csv.write_csv(table, path)
    elif form == "jsonl":
        put(path, "".join(json.dumps(record) + "\n" for record in table.to_pylist()))
    elif form == "parquet":
        pq.write_table(table, path, row_group_size=5)
    else:
        pyarrow.feather.write_feather(table, path, chunksize=5)
    place = {"csv": f":{2 * row}: ", "jsonl": f":{row}: "}.get(form, f": row {row}: ")
    with pytest.raises(FileError, match=f"^{re.escape(str(path))}{place}column 'time': "):
        read_table(path, "time".__eq__)


def test_a_line_without_end_is_refused_before_it_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_columns, "LINE", 2**10)
    for name, content in (("t.csv", "time,x\n0,"), ("t.jsonl", '{"time":0}\n{"time":')):
        path = put(tmp_path / name, content + "0" * 2**20)
        with pytest.raises(FileError, match=f"^{re.escape(str(path))}:2: is a line of more than 1024 bytes"):
            read_table(path, everything)
