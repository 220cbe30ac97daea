"""Writers of tables: text, standard output, refusals, memory."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter, metadata, metadata_path, units_beside
from mjrun.model.table_column import Column
from tests.formats.table_files import COLUMNS, columns, names, put, stored, write

ROOT = Path(__file__).parents[2]
FORMATS = ["csv", "jsonl", "parquet", "feather", "npz", "mat", "hdf5"]


def test_text_is_what_other_programs_expect(tmp_path: Path) -> None:
    data = np.array([[0.0, 0.1, -0.0], [0.002, np.nan, 3], [1e-7, np.inf, -np.inf]])
    assert write(tmp_path / "t.csv", [data]).read_text() == (
        "time,qpos/knee,qpos/torso/x\n0.0,0.1,-0.0\n0.002,nan,3.0\n1e-7,inf,-inf\n"
    )
    assert write(tmp_path / "t.jsonl", [data]).read_text() == (
        '{"time":0.0,"qpos/knee":0.1,"qpos/torso/x":-0.0}\n'
        '{"time":0.002,"qpos/knee":null,"qpos/torso/x":3.0}\n'
        '{"time":1e-7,"qpos/knee":null,"qpos/torso/x":null}\n'
    )


def test_a_sink_that_cannot_open_leaves_no_trace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(FileError, match=r"t.npz: cannot be written: No space left on device"):
        TableWriter(str(tmp_path / "t.npz"), "npz", COLUMNS)
    assert names(tmp_path) == []


def test_rows_are_counted_and_others_refused(tmp_path: Path) -> None:
    with TableWriter(str(tmp_path / "t.csv"), "csv", COLUMNS) as out:
        for count in (2, 0, 3):
            out.write(np.zeros((count, 3)))
        assert out.rows == 5
        for wrong in (np.zeros((2, 4)), np.zeros(3), np.zeros((1, 3), np.float32)):
            with pytest.raises(ValueError, match=r"rows must be float64 \(n, 3\)"):
                out.write(wrong)


def test_no_two_columns_have_one_name(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        TableWriter(str(tmp_path / "t.csv"), "csv", columns("time", "time"))
    assert names(tmp_path) == []


def test_nothing_is_printed_before_the_first_row(capfd: pytest.CaptureFixture[str]) -> None:
    with TableWriter(None, "csv", COLUMNS):
        pass
    assert capfd.readouterr().out == ""
    with TableWriter(None, "csv", COLUMNS) as out:
        out.publish()
    print("later")  # noqa: T201  (standard output stays open)
    assert capfd.readouterr().out == "time,qpos/knee,qpos/torso/x\nlater\n"


MEMORY = """
import gc, sys, tracemalloc
import numpy as np
from mjrun.formats import table_writer
from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column

table_writer.GROUP = 2**14
folder, *forms = sys.argv[1:]
block = np.random.default_rng(2).standard_normal((500, 20))
block[:, 1:3] = 1

def write(form, labels, blocks):
    columns = [Column(f"c{i}", labels=labels if i in (1, 2) else ()) for i in range(20)]
    with TableWriter(f"{folder}/t.{form}", form, columns) as out:
        for _ in range(blocks):
            out.write(block)
        out.publish()

def peak(*table):
    gc.collect()
    tracemalloc.start()
    write(*table)
    size = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return size

for form in forms:
    for labels in ((), ("floor", "torso")) if form == "csv" else (("floor", "torso"),):
        write(form, labels, 2)  # with the imports, which tracing would slow down
        print(form, peak(form, labels, 5), peak(form, labels, 20))
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_table(tmp_path: Path) -> None:
    forms = [form for form in FORMATS if form != "mat"]
    command = [sys.executable, "-c", MEMORY, str(tmp_path), *forms]  # a process in which nothing else allocates
    found = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, check=True)
    measured = [line.split() for line in found.stdout.decode().splitlines()]
    assert [form for form, *_ in measured] == ["csv", *forms]  # csv without labels too
    for form, short, long in measured:
        assert int(long) < int(short) + 2**19, form  # bytes; the longer table is 1.2 MB longer


def test_a_manifest_may_hold_what_json_does_not_know(tmp_path: Path) -> None:
    with TableWriter(str(tmp_path / "t.npz"), "npz", COLUMNS, {"model": Path("a.xml"), "name": "\udcff"}) as out:
        out.publish()
    assert stored(tmp_path / "t.npz").manifest == {"model": "a.xml", "name": "\udcff"}


def test_units_are_those_of_the_columns(tmp_path: Path) -> None:
    table, columns = tmp_path / "t.csv", [Column("time", "s", "simulated time"), Column("n"), Column("a\nb", "m")]
    assert units_beside(table) == {}
    metadata_path(table).write_bytes(metadata(table, columns))
    assert units_beside(table) == {"time": "s", r"a\nb": "m"}


@pytest.mark.parametrize(
    "content", ["", "[]", '{"tableSchema": 3}', '{"tableSchema": {"columns": [1, {"titles": 2}]}}']
)
def test_metadata_without_units_states_none(tmp_path: Path, content: str) -> None:
    path = put(tmp_path / "t.csv", "a\n1\n")
    put(tmp_path / "t.csv-metadata.json", content)
    assert read_table(path).units == {"a": ""}


def test_metadata_of_other_programs_has_several_titles(tmp_path: Path) -> None:
    path = put(tmp_path / "t.csv", "a\n1\n")
    column = {"titles": ["Höhe", "a"], "schema:unitText": "km"}
    put(tmp_path / "t.csv-metadata.json", json.dumps({"tableSchema": {"columns": [column]}}))
    assert read_table(path).units == {"a": "km"}
