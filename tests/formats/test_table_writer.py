"""Tables, read back by others: the csv and json modules, pyarrow, numpy, scipy."""

import contextlib
import csv
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mjrun.errors import FileError, clean
from mjrun.formats import row_writer, text_columns
from mjrun.formats.table_writer import TableWriter
from mjrun.model.column import Column
from tests.formats.table_files import BROKEN, COLUMNS, MANIFEST, ODD, bits, columns, names, read_csv, write

ROOT = Path(__file__).parents[2]
FINAL = {"mjrun": "0.1.0", "seed": 7, "rows": 3}
FORMATS = ["csv", "jsonl", "parquet", "feather", "npz", "mat", "hdf5"]
TEXT, EMBEDDING = ("csv", "jsonl"), ("parquet", "feather", "npz", "mat", "hdf5")


def read_jsonl(path: Path) -> dict[str, list[float]]:
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    return {name: [row[name] for row in rows] for name in rows[0]}


def read_mat(path: Path) -> dict[str, np.ndarray]:
    found = scipy.io.loadmat(path)
    names, variables = ([str(cell[0]) for cell in found[key].ravel()] for key in ("columns", "variables"))
    assert all(found[variable].shape[1:] == (1,) for variable in variables)
    return {name: found[variable].ravel() for name, variable in zip(names, variables, strict=True)}


def read_npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as found:
        return {name: found[name] for name in found.files if not name.startswith("__")}


def read_hdf5(path: Path) -> dict[str, np.ndarray]:
    columns: list[tuple[int, str, np.ndarray]] = []

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            values = np.asarray(item.asstr()[:] if item.dtype.kind == "O" else item[:])
            attributes: Any = item.attrs
            columns.append((int(attributes["index"]), attributes.get("name", name.encode()).decode(), values))

    with h5py.File(path) as found:
        found.visititems(visit)
    return {name: values for _, name, values in sorted(columns, key=lambda column: column[0])}


READERS: dict[str, Callable[[Path], Any]] = {
    "csv": read_csv,
    "jsonl": read_jsonl,
    "parquet": lambda path: {n: c.to_numpy() for n, c in zip(*_arrow(pq.read_table(path)), strict=True)},
    "feather": lambda path: {n: c.to_numpy() for n, c in zip(*_arrow(pyarrow.feather.read_table(path)), strict=True)},
    "npz": read_npz,
    "mat": read_mat,
    "hdf5": read_hdf5,
}


def _arrow(found: pa.Table) -> tuple[list[str], list[pa.ChunkedArray]]:
    found.validate(full=True)
    assert all(column.null_count == 0 for column in found.columns)
    return found.column_names, found.columns


def assert_equal(found: dict[str, Any], names: list[str], data: np.ndarray) -> None:
    assert list(found) == names
    for name, column in zip(names, data.T, strict=True):
        assert bits(found[name]) == bits(column)


@pytest.fixture
def small_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows to a piece of text and to a group of columns, so that small tables have many."""
    monkeypatch.setattr(text_columns, "PIECE", 10)
    monkeypatch.setattr(row_writer, "GROUP", 12)


floats = st.floats(width=64) | st.sampled_from([*ODD, *BROKEN])


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMATS)
@given(
    data=st.lists(st.tuples(floats, floats, floats), min_size=1, max_size=24).map(lambda rows: np.array(rows)),
    cuts=st.lists(st.integers(0, 24), max_size=4).map(sorted),
    layout=st.sampled_from(["C", "F", "strided"]),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_number_reads_back_as_the_same_bits_however_the_rows_come(
    tmp_path: Path, small_groups: None, form: str, data: np.ndarray, cuts: list[int], layout: str
) -> None:
    if layout == "strided":
        laid = np.zeros((2 * len(data), 6))[::2, ::2]
        laid[:] = data
    else:
        laid = np.array(data, order=layout)  # type: ignore[arg-type]
    path = write(tmp_path / f"t.{form}", np.split(laid, cuts))
    if form == "jsonl":  # null is all JSON has
        data = np.where(np.isfinite(data), data, np.nan)
    assert_equal(READERS[form](path), [c.name for c in COLUMNS], data)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMATS)
def test_a_long_table_of_full_size_groups_reads_back(tmp_path: Path, form: str) -> None:
    rng, rows = np.random.default_rng(5), 3_000 if form in TEXT else 30_000  # text is written in smaller pieces
    data = rng.standard_normal((rows, 80)) * 10.0 ** rng.integers(-12, 12, 80)
    data[rng.integers(0, rows, 50), rng.integers(0, 80, 50)] = np.nan
    many = columns("time", *(f"qpos/{i}" for i in range(79)))
    path = write(tmp_path / f"t.{form}", np.array_split(data, 7), many)
    assert_equal(READERS[form](path), [c.name for c in many], data)


@pytest.mark.parametrize("form", FORMATS)
def test_a_table_of_one_column_or_of_no_rows_is_a_table(tmp_path: Path, form: str) -> None:
    one = write(tmp_path / f"one.{form}", [np.array([[1.0], [np.nan], [-0.0]])], columns("time"))
    assert bits(READERS[form](one)["time"]) == bits([1.0, np.nan, -0.0])
    none = write(tmp_path / f"none.{form}", [])
    if form == "jsonl":
        assert none.read_bytes() == b""
    else:
        assert_equal(READERS[form](none), [c.name for c in COLUMNS], np.empty((0, 3)))


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_rows_make_the_same_bytes_however_they_are_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    data = np.arange(3000.0).reshape(-1, 3) / 7
    one = write(tmp_path / f"a.{form}", [data])
    monkeypatch.setattr("time.asctime", lambda *_: "later")
    other = write(tmp_path / f"b.{form}", np.array_split(data, 9))
    assert one.read_bytes() == other.read_bytes()


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


@pytest.mark.parametrize("form", [f for f in FORMATS if f != "csv"])
def test_hostile_names_read_back_exactly(tmp_path: Path, form: str) -> None:
    data = np.arange(20.0).reshape(2, 10)
    assert_equal(READERS[form](write(tmp_path / f"t.{form}", [data], columns(*HOSTILE))), HOSTILE, data)


@given(st.lists(st.text(st.characters(codec="utf-8"), max_size=12), min_size=1, max_size=5, unique_by=clean))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.parametrize("form", TEXT)
def test_text_has_a_line_per_row_and_steers_no_terminal_whatever_the_names(
    tmp_path: Path, form: str, named: list[str]
) -> None:
    path = write(tmp_path / f"t.{form}", [np.ones((2, len(named)))], columns(*named))
    lines = path.read_text("utf-8").removesuffix("\n").split("\n")
    assert len(lines) == 2 + (form == "csv")
    assert all(clean(line) == line for line in lines)
    assert list(READERS[form](path)) == [clean(name) if form == "csv" else name for name in named]


LABELS = (
    "floor",
    'a "b"',
    "c,d",
    "e\nf\r",
    "\x1b[31mred",
    "é 日本 🚗",
    "=1+1",
    "@x",
    "-x",
    "+x",
    " =x",
    "＝x",
    "a;=x;b",
    "a;b",
    "a=b",
    "'x",
    "",
    "nan",
    "null",
    "\u2028\u202e",
    "floor",
)
IN_CSV = (
    "floor",
    'a "b"',
    "c,d",
    r"e\nf\r",
    r"\x1b[31mred",
    "é 日本 🚗",
    "'=1+1",
    "'@x",
    "'-x",
    "'+x",
    "' =x",
    "'＝x",
    "a;'=x;b",
    "a;b",
    "a=b",
    "'x",
    "",
    "nan",
    "null",
    r"\u2028\u202e",
    "floor",
)


def read_csv_texts(path: Path) -> dict[str, list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file, strict=True)
    return {name: [row[i] for row in rows] for i, name in enumerate(head)}


def read_mat_texts(path: Path) -> dict[str, list[Any]]:
    found = {name: column.tolist() for name, column in read_mat(path).items()}
    return {name: [str(c[0]) if len(c) else "" for c in column] for name, column in found.items() if name in TEXTS}


def read_arrow_texts(found: pa.Table) -> dict[str, list[Any]]:
    found.validate(full=True)
    assert [pa.types.is_dictionary(kind) for kind in found.schema.types] == [False, True, True, False, False, True]
    return {name: found[name].to_pylist() for name in TEXTS}


# Between texts and at the end of a row, numbers and none: every way in which columns can follow one another.
TEXTS = {"geom1": 1, "geom2": 2, "body": 5}
TEXT_READERS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "csv": read_csv_texts,
    "jsonl": read_jsonl,
    "parquet": lambda path: read_arrow_texts(pq.read_table(path)),
    "feather": lambda path: read_arrow_texts(pyarrow.feather.read_table(path)),
    "npz": lambda path: {name: column.tolist() for name, column in read_npz(path).items()},
    "mat": read_mat_texts,
    "hdf5": lambda path: {name: column.tolist() for name, column in read_hdf5(path).items()},
}
NO_TEXT = {"csv": "", "jsonl": None, "parquet": None, "feather": None, "npz": "", "mat": "", "hdf5": ""}


def labelled(labels: tuple[str, ...]) -> list[Column]:
    """Six columns, those in `TEXTS` with labels."""
    found = columns("time", "geom1", "geom2", "dist", "force", "body")
    return [Column(c.name, labels=labels) if c.name in TEXTS else c for c in found]


def rows_of(texts: np.ndarray) -> np.ndarray:
    """Rows `(n, 6)` with the indices `(n, 3)` in the columns of `TEXTS`."""
    rows = np.linspace(-1, 1, 6 * len(texts)).reshape(-1, 6)
    rows[:, list(TEXTS.values())] = texts
    return rows


@pytest.mark.parametrize("form", FORMATS)
def test_labels_read_back_in_the_place_of_their_numbers(tmp_path: Path, small_groups: None, form: str) -> None:
    count = len(LABELS)
    every = np.arange(-1, count)
    data = rows_of(np.stack([every, every[::-1], np.roll(every, 5)], axis=1))
    data[3, 3:5] = np.nan, np.inf
    found = TEXT_READERS[form](write(tmp_path / f"t.{form}", np.array_split(data, 4), labelled(LABELS)))
    shown = (*(IN_CSV if form == "csv" else LABELS), NO_TEXT[form])  # the last is at −1
    for name, index in TEXTS.items():
        assert found[name] == [shown[int(i)] for i in data[:, index]]


@pytest.mark.parametrize("form", FORMATS)
def test_numbers_beside_labels_read_back_as_the_same_bits(tmp_path: Path, small_groups: None, form: str) -> None:
    data = rows_of(np.zeros((30, 3)))
    data[:, 3] = [*ODD, *BROKEN, *range(17)]
    path = write(tmp_path / f"t.{form}", [data], labelled(("1.5",)))
    readers = READERS | {"csv": read_csv_texts, "parquet": pq.read_table, "feather": pyarrow.feather.read_table}
    found = readers[form](path)
    if form == "jsonl":
        data = np.where(np.isfinite(data), data, np.nan)
    for index, name in ((0, "time"), (3, "dist"), (4, "force")):
        assert bits(found[name]) == bits(data[:, index])


# What a name in a model can be: UTF-8 without NUL.
text_of_a_model = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
labels_and_rows = st.lists(text_of_a_model | st.sampled_from(LABELS), min_size=1, max_size=6).flatmap(
    lambda labels: st.tuples(
        st.just(tuple(labels)), st.lists(st.tuples(*[st.integers(-1, len(labels) - 1)] * 3), min_size=1, max_size=9)
    )
)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMATS)
@given(given=labels_and_rows, cuts=st.lists(st.integers(0, 9), max_size=3).map(sorted))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_labels_read_back_exactly_and_in_csv_cleaned(
    tmp_path: Path, small_groups: None, form: str, given: tuple[tuple[str, ...], list[tuple[int, ...]]], cuts: list[int]
) -> None:
    labels, data = given[0], rows_of(np.array(given[1]))
    path = write(tmp_path / f"t.{form}", np.split(data, cuts), labelled(labels))
    found = TEXT_READERS[form](path)
    for name, index in TEXTS.items():
        expected = [labels[int(i)] if i >= 0 else NO_TEXT[form] for i in data[:, index]]
        if form == "csv":
            assert [cell.replace("'", "") for cell in found[name]] == [clean(t).replace("'", "") for t in expected]
            parts = [part.lstrip() for cell in found[name] for part in cell.split(";")]
            assert not any(part.startswith(("=", "+", "-", "@", "＝", "＋", "－", "＠")) for part in parts)
        else:
            assert found[name] == expected
    if form in TEXT:
        lines = path.read_text("utf-8").removesuffix("\n").split("\n")
        assert len(lines) == len(data) + (form == "csv")
        assert all(clean(line) == line for line in lines)


@pytest.mark.parametrize("form", [f for f in FORMATS if f != "jsonl"])
def test_a_table_of_labels_without_rows_has_columns_of_text(tmp_path: Path, form: str) -> None:
    path = write(tmp_path / f"t.{form}", [], labelled(LABELS))
    assert {name: list(TEXT_READERS[form](path)[name]) for name in TEXTS} == {name: [] for name in TEXTS}
    if form == "npz":
        assert {column.dtype.kind for name, column in read_npz(path).items() if name in TEXTS} == {"U"}


def manifest_of(path: Path) -> dict[str, Any]:
    text = {
        ".parquet": lambda: pq.read_table(path).schema.metadata[b"mjrun"],
        ".feather": lambda: pyarrow.feather.read_table(path).schema.metadata[b"mjrun"],
        ".npz": lambda: str(np.load(path)["__manifest__"]),
        ".mat": lambda: str(scipy.io.loadmat(path)["manifest"][0]),
        ".hdf5": lambda: bytes(h5py.File(path).attrs["manifest"]).decode(),  # type: ignore[arg-type]
    }[path.suffix]()
    return json.loads(text)


def test_integers_are_integers_where_a_format_knows_them(tmp_path: Path) -> None:
    some = [Column("seed", integer=True), Column("x"), Column("how", labels=("ok",)), Column("steps", integer=True)]
    rows = np.array([[2**53, 1.0, 0, 3], [-7, 0.5, -1, np.nan]])
    for form in ("csv", "jsonl", "parquet", "feather"):
        with TableWriter(str(tmp_path / f"t.{form}"), form, some) as writer:
            writer.write(rows)
            writer.publish()

    assert (tmp_path / "t.csv").read_text() == f"seed,x,how,steps\n{2**53},1.0,ok,3\n-7,0.5,,nan\n"
    lines = (tmp_path / "t.jsonl").read_text().splitlines()
    assert lines[0] == f'{{"seed":{2**53},"x":1.0,"how":"ok","steps":3}}'
    assert json.loads(lines[1]) == {"seed": -7, "x": 0.5, "how": None, "steps": None}
    for table in (pq.read_table(tmp_path / "t.parquet"), pyarrow.feather.read_table(tmp_path / "t.feather")):
        assert table.schema.field("seed").type == pa.int64()
        assert table.column("seed").to_pylist() == [2**53, -7]
        assert table.column("steps").to_pylist() == [3, None]


@pytest.mark.parametrize("form", EMBEDDING)
def test_the_manifest_is_embedded_and_the_last_word_counts_where_the_format_allows(tmp_path: Path, form: str) -> None:
    path = tmp_path / f"t.{form}"
    for first, last, expected in ((MANIFEST, None, MANIFEST), (MANIFEST, FINAL, FINAL), (None, None, {})):
        with TableWriter(str(path), form, COLUMNS, first) as out:
            out.write(np.zeros((3, 3)))
            out.publish(last)
        assert manifest_of(path) == (MANIFEST if form == "feather" and first else expected)


def test_units_go_with_npz_and_mat(tmp_path: Path) -> None:
    with np.load(write(tmp_path / "t.npz", [])) as found:
        assert json.loads(str(found["__units__"])) == {"time": "s", "qpos/knee": "rad", "qpos/torso/x": "m"}
    found = scipy.io.loadmat(write(tmp_path / "t.mat", []))
    assert [cell[0] for cell in found["units"].ravel()] == ["s", "rad", "m"]
    assert found["__header__"] == b"MATLAB 5.0 MAT-file, written by mjrun"


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


PROGRAM = """
import sys
import numpy as np
from mjrun.errors import ClosedPipeError, FileError
from mjrun.formats.table_writer import TableWriter
from mjrun.model.column import Column

try:
    with TableWriter(None, sys.argv[1], [Column("time"), Column("qpos/a")]) as out:
        for k in range(int(sys.argv[2])):
            out.write(np.full((1000, 2), k, float))
        out.publish()
except ClosedPipeError as end:
    sys.exit(end.exit_code)
except FileError as error:
    sys.exit(str(error))
assert sys.modules.keys().isdisjoint({"pyarrow", "scipy"})
"""


def piped(form: str, blocks: int, stdout: Any = subprocess.PIPE) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-W", "error", "-c", PROGRAM, form, str(blocks)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=stdout, stderr=subprocess.PIPE)


@pytest.mark.parametrize("form", TEXT)
def test_standard_output_gets_the_table_and_needs_no_other_library(tmp_path: Path, form: str) -> None:
    out, errors = piped(form, 3).communicate()
    assert errors == b""
    data = np.repeat([[k, k] for k in (0.0, 1.0, 2.0)], 1000, axis=0)
    path = write(tmp_path / f"t.{form}", [data], columns("time", "qpos/a"))
    assert out == path.read_bytes()


@pytest.mark.parametrize("form", TEXT)
def test_a_reader_that_goes_away_ends_the_writing_without_a_word(form: str) -> None:
    with piped(form, 10**6) as child:
        assert child.stdout
        assert child.stderr
        assert child.stdout.read(10)
        child.stdout.close()
        assert child.stderr.read() == b""
    assert child.returncode == 141


def test_a_full_device_on_standard_output_is_told() -> None:
    with Path("/dev/full").open("wb") as full, piped("csv", 3, stdout=full) as child:
        assert child.stderr
        assert child.stderr.read() == b"-: cannot be written: No space left on device\n"


def test_a_table_may_go_to_a_terminal() -> None:
    ours, theirs = os.openpty()
    with piped("csv", 1, stdout=theirs) as child:
        os.close(theirs)
        shown = b""
        with contextlib.suppress(OSError):  # Linux ends a terminal so
            while part := os.read(ours, 4096):
                shown += part
    os.close(ours)
    assert child.returncode == 0
    assert shown == b"time,qpos/a\r\n" + 1000 * b"0.0,0.0\r\n"


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
from mjrun.formats import row_writer
from mjrun.formats.table_writer import TableWriter
from mjrun.model.column import Column

row_writer.GROUP = 2**14
path, form, *labels = sys.argv[1:]
block = np.random.default_rng(2).standard_normal((500, 20))
block[:, 1:3] = 1
columns = [Column(f"c{i}", labels=tuple(labels) if i in (1, 2) else ()) for i in range(20)]

def peak(blocks):
    gc.collect()
    tracemalloc.start()
    with TableWriter(path, form, columns) as out:
        for _ in range(blocks):
            out.write(block)
        out.publish()
    found = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found

peak(2)
print(peak(10), peak(100))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "labels"), [("csv", ()), *((f, ("floor", "torso")) for f in FORMATS if f != "mat")], ids=str
)
def test_memory_does_not_grow_with_the_table(tmp_path: Path, form: str, labels: tuple[str, ...]) -> None:
    command = [sys.executable, "-c", MEMORY, str(tmp_path / f"t.{form}"), form, *labels]  # where nobody else allocates
    found = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, check=True)
    short, long = map(int, found.stdout.split())
    assert long < short + 2**19  # bytes; the longer table is 7 MB longer


def test_a_manifest_may_hold_what_json_does_not_know(tmp_path: Path) -> None:
    with TableWriter(str(tmp_path / "t.npz"), "npz", COLUMNS, {"model": Path("a.xml"), "name": "\udcff"}) as out:
        out.publish()
    assert manifest_of(tmp_path / "t.npz") == {"model": "a.xml", "name": "\udcff"}


@pytest.mark.parametrize("form", ["npz", "mat", "h5"])
def test_columns_of_integers_are_int64_unless_a_number_is_missing(tmp_path: Path, form: str) -> None:
    made = [Column("n", integer=True), Column("gaps", integer=True), Column("x")]
    path = write(tmp_path / f"t.{form}", [np.array([[2.0**53, 1, 1], [-3, np.nan, 2]])], made)
    found: dict[str, Any]
    if form == "npz":
        found = dict(np.load(path))
    elif form == "mat":
        found = scipy.io.loadmat(path)
    else:
        with h5py.File(path) as file:
            found = {name: np.array(file[name]) for name in ("n", "gaps", "x")}
    assert [found[name].dtype for name in ("n", "gaps", "x")] == [np.int64, np.float64, np.float64]
    assert found["n"].ravel().tolist() == [2**53, -3]
