"""CSV tables, beside the csv module, numpy, pyarrow and spreadsheets."""

import codecs
import csv
import io
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import FileError, clean
from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column
from mjrun.options.trace import UNIT_PLACES
from tests.formats.table_files import BROKEN, ODD, bits, columns, exact, hypothesis, lists, put, stored, write

HOSTILE = [
    "time",
    'qpos/"a"',
    "qpos/b,c",
    "qpos/d\ne\r",
    "qpos/\x1b[31mred",
    "qpos/é 日本 🚗",
    "=1+1",
    "@x",
    "-x",
    "ü\u202e",
]


def test_names_in_csv_are_cleaned_and_quoted_where_they_must_be(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", [np.zeros((1, 10))], columns(*HOSTILE))
    assert list(stored(path).columns) == [clean(name) for name in HOSTILE]
    head = path.read_text("utf-8").splitlines()[0]
    assert head.startswith(
        r'time,"qpos/""a""","qpos/b,c",qpos/d\ne\r,qpos/\x1b[31mred,qpos/é 日本 🚗,"=1+1","@x","-x",'
    )


def test_labels_are_quoted_and_marked_in_csv_only_where_they_must_be(tmp_path: Path) -> None:
    labels = ("floor", 'a "b"', "c,d", "=1+1", "a;b", "", " =x", "＝x", "a;=x;b", "a=b", "'x", "e\n", "nan")
    count = len(labels)
    made = [Column(str(index), labels=labels) for index in range(count + 1)]
    path = write(tmp_path / "t.csv", [np.array([[*range(count), -1.0]])], made)
    line = path.read_text().splitlines()[1]
    assert line == r'''floor,"a ""b""","c,d",'=1+1,"a;b","",' =x,'＝x,"a;'=x;b",a=b,'x,e\n,nan,'''


@pytest.mark.parametrize("place", UNIT_PLACES)
def test_units_are_stated_beside_csv_where_other_readers_pass_over_them(tmp_path: Path, place: str) -> None:
    path, rows = tmp_path / "t.csv", np.array([[0.0, *BROKEN[:2]], [1.0, 1 / 3, ODD[3]]])
    named = [Column("time", "s"), Column("ü", "N m"), Column("qpos/b,c")]
    with TableWriter(str(path), "csv", named, units=place) as out:
        out.write(rows)
        assert not list(tmp_path.glob("t.csv*"))
        out.publish()
    table, beside = read_table(path), tmp_path / "t.csv-metadata.json"
    assert table.units == {"time": "s", "ü": "N m", "qpos/b,c": ""}
    lines = list(csv.reader(path.read_text("utf-8").splitlines()))
    if place == "comment":
        assert lines[1] == ["# units: s", "N m", ""]
        assert not beside.exists()
    else:
        described = json.loads(beside.read_text("utf-8"))["tableSchema"]["columns"]
        assert [column["titles"] for column in described] == lines[0] == ["time", "ü", "qpos/b,c"]
        assert [column.get("schema:unitText") for column in described] == ["s", "N m", None]
    readers = [
        table.to_pandas(),
        pd.read_csv(path, comment="#"),
        np.genfromtxt(path, delimiter=",", skip_header=1),
    ]
    for values in readers:
        np.testing.assert_allclose(values, rows, rtol=1e-14)


@pytest.mark.parametrize(
    ("content", "units"),
    [
        ("a,b\r\n# units:  deg , \r\n1,2\r\n", {"a": "deg", "b": ""}),  # as a spreadsheet writes it
        ("a,b\n# units: deg\n1,2\n", {"a": "deg", "b": ""}),
        ("a,b\n# units:\n1,2\n", {"a": "", "b": ""}),
        ("a,b\r# units: x\r1,2\r", None),  # lines of old Macintoshes
        ("a,b\n# unit,2\n1,2\n", None),
        ('a,b\n# units: "deg\n1,2\n', None),
        (f"a,b\n# units: {'m' * 200_000}\n1,2\n", None),
    ],
)
def test_only_the_line_below_the_header_states_units(
    tmp_path: Path, content: str, units: dict[str, str] | None
) -> None:
    path = put(tmp_path / "t.csv", content)
    if units is None:
        with pytest.raises(FileError, match=r"t\.csv:2"):
            read_table(path)
        return
    assert read_table(path).units == units
    assert lists(path) == {"a": [1.0], "b": [2.0]}


def test_texts_that_begin_like_a_comment_are_rows(tmp_path: Path) -> None:
    path = put(tmp_path / "t.csv", "name,x\n#1,2\n#2,3\n")
    assert exact(path) == {"name": ["#1", "#2"], "x": [2.0, 3.0]}


@pytest.mark.parametrize(
    "content",
    [
        "time,ctrl/a\n0,1\n0.5,-2.5e-3\n",
        "time,ctrl/a\r\n0,1\r\n0.5,-2.5e-3",
        "time,ctrl/a\r0,1\r0.5,-2.5e-3\r",
        codecs.BOM_UTF8 + b"time,ctrl/a\n0,1\n0.5,-2.5e-3\n",
        codecs.BOM_UTF8 + b'"time","ctrl/a"\r\n"0","1"\r\n"0.5","-2.5e-3"\r\n',
        " time ,\tctrl/a\t\n 0 , 1 \n 0.5 ,\t-2.5e-3 \n",
        'time, "ctrl/a"\n0, "1"\n0.5, "-.0025"\n',
        "\n\ntime,ctrl/a\n0,1\n\n0.5,-2.5e-3\n\n   \n\r\n",
        'note,time,ctrl/a,note\n"a, ""b""\nc",+0.,1E0,\n,.5,-25e-4,=1+1\n',
        b"\xb0C,time,ctrl/a\n20,0,1\n\xff,0.5,-0.0025\n",
    ],
)
def test_csv_of_spreadsheets_and_scripts_is_read(tmp_path: Path, content: str | bytes) -> None:
    assert lists(put(tmp_path / "t.csv", content), "time", "ctrl/a") == {"time": [0, 0.5], "ctrl/a": [1, -0.0025]}


def test_csv_of_pyarrow_and_of_numpy_is_read(tmp_path: Path) -> None:
    table = pa.table({"time": [0.1, 0.2], "ctrl/a": pa.array([1, 2]), "note": ['x, "y"', None]})
    pyarrow.csv.write_csv(table, tmp_path / "arrow.csv")
    assert lists(tmp_path / "arrow.csv", "time", "ctrl/a") == {"time": [0.1, 0.2], "ctrl/a": [1, 2]}
    data = np.array([[1 / 3, np.nan], [-np.inf, 2.0]])
    np.savetxt(tmp_path / "numpy.csv", data, "%.18e", ",", header="time,ctrl/a", comments="")
    assert bits(list(lists(tmp_path / "numpy.csv").values())) == bits(data.T)


@given(
    st.lists(
        st.tuples(st.text(max_size=6), st.floats(width=64) | st.sampled_from([*ODD, *BROKEN])), min_size=1, max_size=20
    )
)
@hypothesis
def test_csv_is_read_as_the_csv_module_and_float_read_it(tmp_path: Path, rows: list[tuple[str, float]]) -> None:
    text = io.StringIO(newline="")
    csv.writer(text, quoting=csv.QUOTE_NONNUMERIC).writerows([("note", "time"), *rows])
    path = put(tmp_path / "t.csv", text.getvalue().encode("utf-8", "replace"))
    assert bits(lists(path, "time")["time"]) == bits([value for _, value in rows])
