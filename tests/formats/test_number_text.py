"""Numbers as text: lines and places of bad cells."""

import io
import json
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet as pq
import pytest

from mjrun.errors import FileError
from mjrun.formats import number_text, table_read_stream, text_lines
from mjrun.formats.table_reader import read_table
from mjrun.formats.text_lines import WholeLinePieces
from tests.formats.table_files import everything, put


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows to a piece, so that small tables have many."""
    monkeypatch.setattr(number_text, "ROWS", 3)
    monkeypatch.setattr(table_read_stream, "PIECE", 5)


@pytest.mark.parametrize("row", [0, 1, 2, 3, 6, 10])
@pytest.mark.parametrize("form", ["csv", "jsonl", "parquet", "feather"])
def test_the_place_of_a_bad_cell_is_right_in_every_piece(
    tmp_path: Path, small_pieces: None, form: str, row: int
) -> None:
    cells: list[float | None] = [0.5] * 12
    cells[row] = None
    table, path = pa.table({"note": ["a\nb"] * 12, "time": pa.array(cells, pa.float64())}), tmp_path / f"t.{form}"
    if form == "csv":
        pyarrow.csv.write_csv(table, path)
    elif form == "jsonl":
        put(path, "".join(json.dumps(record) + "\n" for record in table.to_pylist()))
    elif form == "parquet":
        pq.write_table(table, path, row_group_size=5)
    else:
        pyarrow.feather.write_feather(table, path, chunksize=5)
    place = {"csv": f":{2 * row + 2}: ", "jsonl": f":{row + 1}: "}.get(form, f": row {row}: ")
    with pytest.raises(FileError, match=f"^{re.escape(str(path))}{place}column 'time': "):
        read_table(path, "time".__eq__)


def test_a_line_without_end_is_refused_before_it_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_lines, "LINE", 2**10)
    for name, content in (("t.csv", "time,x\n0,"), ("t.jsonl", '{"time":0}\n{"time":')):
        path = put(tmp_path / name, content + "0" * 2**20)
        with pytest.raises(FileError, match=f"^{re.escape(str(path))}:2: is a line of more than 1024 bytes"):
            read_table(path, everything)


def line_pieces(path: Path, content: bytes, width: int = 2) -> WholeLinePieces:
    return WholeLinePieces(path, io.BytesIO(content), 1, (width, (0, 1)))


@pytest.mark.parametrize(
    ("a", "b", "skipped"),
    [
        (b"1,2\n3,4\n", b"1,2\n3,4\n", 2),
        (b"1,2\n3,4\n5,6\n", b"1,2\n3,4\n5,7\n", 2),
        (b"1,2\n3,4", b"1,2\n3,4", 1),
        (b"1,2\n\n3,4\n", b"1,2\n\n3,4\n", 0),
        (b'1,2\n"3",4\n', b'1,2\n"3",4\n', 0),
        (b"1,2,3\n4\n", b"1,2,3\n4\n", 2),  # which parsing another piece would tell
        (b"1,2\n", b"", 0),
    ],
)
def test_equal_lines_are_counted_and_passed_over(tmp_path: Path, a: bytes, b: bytes, skipped: int) -> None:
    one, other = line_pieces(tmp_path, a), line_pieces(tmp_path, b)
    assert one.skip_equal(other) == skipped
    rest = b"".join(a.splitlines(keepends=True)[skipped:])
    assert list(one) == ([(1 + skipped, rest)] if rest else [])
    assert one.skip_equal(line_pieces(tmp_path, a, 3)) == 0


def test_lines_are_looked_at_ever_less_often_where_files_differ_everywhere(tmp_path: Path) -> None:
    class Counted(io.BytesIO):
        reads = 0

        def read(self, *size: int | None) -> bytes:
            self.reads += 1
            return super().read(*size)

    files = Counted(b"1,2\n" * 9), Counted(b"1,3\n" * 9)
    one, other = (WholeLinePieces(tmp_path, file, 1, (2, (0, 1))) for file in files)
    assert [one.skip_equal(other) for _ in range(200)] == [0] * 200
    assert files[0].reads < 12
