"""Every table format, beside independent readers: what goes out comes back."""

import json
import tracemalloc
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
import scipy.io
from hypothesis import example, given
from hypothesis import strategies as st

from mjrun.errors import UnknownNameError, clean
from mjrun.formats import number_text, table_read_stream, table_writer
from mjrun.formats.table_reader import open_table, read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import FORMATS
from mjrun.model.table_column import Column
from tests.formats.table_files import (
    BROKEN,
    COLUMNS,
    MANIFEST,
    ODD,
    bits,
    columns,
    exact,
    hypothesis,
    lists,
    numbers,
    put,
    stored,
    write,
)

TEXT = [name for name, known in FORMATS.items() if known.is_text]
every_format = pytest.mark.parametrize("form", FORMATS)
NAMES = [column.name for column in COLUMNS]
floats = st.floats(width=64) | st.sampled_from([*ODD, *BROKEN])
text_of_a_model = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)  # UTF-8 without NUL


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows to a piece of text and to a group of columns, so that small tables have many."""
    monkeypatch.setattr(number_text, "PIECE", 10)
    monkeypatch.setattr(number_text, "ROWS", 3)
    monkeypatch.setattr(table_read_stream, "PIECE", 5)
    monkeypatch.setattr(table_writer, "GROUP", 12)


def laid_out(data: np.ndarray, layout: str) -> np.ndarray:
    """The same numbers in another order in memory."""
    if layout != "strided":
        return np.array(data, order=layout)  # type: ignore[call-overload]
    rows = np.zeros((2 * len(data), 6))[::2, ::2]
    rows[:] = data
    return rows


@every_format
@given(
    data=st.lists(st.tuples(floats, floats, floats), max_size=24).map(lambda rows: np.array(rows).reshape(-1, 3)),
    cuts=st.lists(st.integers(0, 24), max_size=4).map(sorted),
    layout=st.sampled_from(["C", "F", "strided"]),
    picked=st.sets(st.sampled_from(NAMES)),
)
@hypothesis
def test_every_number_reads_back_as_the_same_bits_however_the_rows_come(
    tmp_path: Path, small_pieces: None, form: str, data: np.ndarray, cuts: list[int], layout: str, picked: set[str]
) -> None:
    path = write(tmp_path / f"t.{form}", np.split(laid_out(data, layout), cuts))
    if form == "jsonl":
        if not len(data):
            assert path.read_bytes() == b""
            return
        data = np.where(np.isfinite(data), data, np.nan)  # null is all JSON has
    assert {name: bits(numbers(cells)) for name, cells in stored(path).columns.items()} == {
        name: bits(column) for name, column in zip(NAMES, data.T, strict=True)
    }
    table = read_table(path, picked.__contains__, missing="nan")
    assert table.names == [name for name in NAMES if name in picked]
    for name, column in table.columns.items():
        assert (column.dtype, column.shape) == (np.float64, (len(data),))
        assert bits(column) == bits(data[:, NAMES.index(name)])
        column += 1  # it may be changed


hostile = st.sampled_from(
    ['"a"', "b,c", "d\ne\r", "\x1b[31mred", "é 日本 🚗", "=1+1", "@x", "-x", "ü\u202e", "a;b", " a ", "\u2028"]
)


@every_format
@given(
    named=st.lists(
        text_of_a_model.filter(bool) | hostile, min_size=1, max_size=5, unique_by=lambda n: clean(n).strip(" ")
    )
)
@example(named=["qpos/a", "qpos/a/x", "qpos/a/x/y", "a//b", "."])  # in HDF5, a dataset is no group
@example(named=["/a", "a/", ".", "a/../b", "a/./b"])
@example(named=["column_0", "column_1/", "column_1"])
@example(named=["z/1", "a", "z/2", "m"])
@example(named=["joint\n", "Größe/μ", "=1+1", " "])
@hypothesis
def test_names_read_back_exactly_but_cleaned_in_csv(tmp_path: Path, form: str, named: list[str]) -> None:
    path = write(tmp_path / f"t.{form}", [np.arange(2.0 * len(named)).reshape(2, -1)], columns(*named))
    assert list(stored(path).columns) == [clean(name) if form == "csv" else name for name in named]
    if form in TEXT:
        lines = path.read_text("utf-8").removesuffix("\n").split("\n")
        assert len(lines) == 2 + (form == "csv")
        assert all(clean(line) == line for line in lines)

    is_read_as_text = form == "csv" and len(named) == 1 and any(mark in clean(named[0]) for mark in ";\t")
    is_number = form == "csv" and all(_is_number(name) for name in named)
    if not is_read_as_text and not is_number:
        expected = [clean(name).strip(" ") for name in named] if form == "csv" else named
        assert lists(path) == {name: [i, i + len(named)] for i, name in enumerate(expected)}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


# Between texts and at the end of a row, numbers and none: every way in which columns can follow one another.
TEXTS = {"geom1": 1, "geom2": 2, "body": 5}
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
    " =x",
    "＝x",
    "a;=x;b",
    "a;b",
)
LABELS += ("", "nan", "null", "1.5", "\u2028\u202e", "floor")
ABSENT = {"csv": "", "jsonl": None, "parquet": None, "feather": None, "npz": "", "mat": "", "hdf5": ""}
every_label = (LABELS, [(i, len(LABELS) - 2 - i, i // 2) for i in range(-1, len(LABELS))])
labels_and_rows = st.lists(text_of_a_model | st.sampled_from(LABELS), min_size=1, max_size=6).flatmap(
    lambda labels: st.tuples(
        st.just(tuple(labels)), st.lists(st.tuples(*[st.integers(-1, len(labels) - 1)] * 3), max_size=9)
    )
)


def labelled(labels: tuple[str, ...]) -> list[Column]:
    """Six columns, those in `TEXTS` with labels."""
    made = columns("time", "geom1", "geom2", "dist", "force", "body")
    return [Column(column.name, labels=labels) if column.name in TEXTS else column for column in made]


@every_format
@given(case=labels_and_rows, cuts=st.lists(st.integers(0, 9), max_size=3).map(sorted))
@example(case=every_label, cuts=[2, 7])
@hypothesis
def test_labels_read_back_in_the_place_of_their_numbers(
    tmp_path: Path, small_pieces: None, form: str, case: tuple[tuple[str, ...], list[tuple[int, ...]]], cuts: list[int]
) -> None:
    labels, indices = case[0], np.array(case[1], int).reshape(-1, 3)
    data = np.resize([*ODD, *BROKEN[: 1 if form == "jsonl" else 3]], (len(indices), 6))
    data[:, list(TEXTS.values())] = indices
    path = write(tmp_path / f"t.{form}", np.split(data, cuts), labelled(labels))
    if form == "jsonl" and not len(data):
        return
    cells = stored(path).columns
    for index, name in ((0, "time"), (3, "dist"), (4, "force")):
        assert bits(numbers(cells[name])) == bits(data[:, index])
    read = exact(path) if form != "csv" else {}  # there, a label may look like a number
    for name, index in TEXTS.items():
        expected = [labels[int(i)] if i >= 0 else ABSENT[form] for i in data[:, index]]
        if form == "csv":
            assert [cell.replace("'", "") for cell in cells[name]] == [clean(t).replace("'", "") for t in expected]
            parts = [part.lstrip() for cell in cells[name] for part in cell.split(";")]
            assert not any(part.startswith(("=", "+", "-", "@", "＝", "＋", "－", "＠")) for part in parts)
        else:
            assert cells[name] == expected
            assert [cell if isinstance(cell, str) else "" for cell in read[name]] == [text or "" for text in expected]
    if form in TEXT:
        lines = path.read_text("utf-8").removesuffix("\n").split("\n")
        assert len(lines) == len(data) + (form == "csv")
        assert all(clean(line) == line for line in lines)


@every_format
def test_integers_are_integers_where_no_gap_prevents_it(tmp_path: Path, form: str) -> None:
    some = [Column("seed", integer=True), Column("x"), Column("how", labels=("ok",)), Column("steps", integer=True)]
    path = write(tmp_path / f"t.{form}", [np.array([[2**53, 1.0, 0, 3], [-7, 0.5, -1, np.nan]])], some)
    cells = stored(path).columns
    if form == "csv":
        assert path.read_text() == f"seed,x,how,steps\n{2**53},1.0,ok,3\n-7,0.5,,nan\n"
    else:
        assert repr(cells["seed"]) == repr([2**53, -7])
        assert repr(cells["steps"]) == ("[3.0, nan]" if ABSENT[form] == "" else "[3, None]")
        assert repr(cells["x"]) == "[1.0, 0.5]"
    assert exact(path)["seed"] == [2**53, -7]


BIG = [2**60 + 1, -3]


@pytest.mark.parametrize("suffix", [".csv", ".jsonl", ".parquet", ".feather", ".npz", ".mat", ".h5"])
def test_integers_beyond_those_of_float64_are_read_exactly_if_that_is_asked_for(tmp_path: Path, suffix: str) -> None:
    path, values = tmp_path / f"t{suffix}", np.array(BIG)
    match suffix:
        case ".csv":
            put(path, f"n\n{BIG[0]}\n{BIG[1]}\n")
        case ".jsonl":
            put(path, "".join(json.dumps({"n": value}) + "\n" for value in BIG))
        case ".parquet":
            pq.write_table(pa.table({"n": values}), path)
        case ".feather":
            pyarrow.feather.write_feather(pa.table({"n": values}), path)
        case ".npz":
            np.savez(path, n=values)
        case ".mat":
            scipy.io.savemat(path, {"n": values[:, None]})
        case ".h5":
            with h5py.File(path, "w") as archive:
                archive["n"] = values
    assert exact(path) == {"n": BIG}
    assert lists(path) == {"n": [float(value) for value in BIG]}


@pytest.mark.slow
@every_format
def test_a_long_table_of_full_size_groups_reads_back_in_blocks(tmp_path: Path, form: str) -> None:
    rng, rows = np.random.default_rng(5), 2_000 if form in TEXT else 15_000  # text is written in smaller pieces
    data = rng.standard_normal((rows, 80)) * 10.0 ** rng.integers(-12, 12, 80)
    data[rng.integers(0, rows, 50), rng.integers(0, 80, 50)] = np.nan
    many = columns("time", *(f"qpos/{i}" for i in range(79)))
    with open_table(write(tmp_path / f"t.{form}", np.array_split(data, 7), many), missing="nan") as table:
        blocks = list(table.blocks())
    assert len(blocks) > 1
    assert np.array_equal(np.concatenate(blocks), data, equal_nan=True)


@every_format
def test_the_same_rows_make_the_same_bytes_however_they_are_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    data = np.arange(3000.0).reshape(-1, 3) / 7
    one = write(tmp_path / f"a.{form}", [data])
    monkeypatch.setattr("time.asctime", lambda *_: "later")
    other = write(tmp_path / f"b.{form}", np.array_split(data, 9))
    assert one.read_bytes() == other.read_bytes()


@every_format
def test_columns_are_read_by_name_in_the_order_of_the_file_with_their_units(tmp_path: Path, form: str) -> None:
    path = write(tmp_path / f"t.{form}", [np.arange(6.0).reshape(2, 3)])
    units = dict.fromkeys(NAMES, "") if form in TEXT else {column.name: column.unit for column in COLUMNS}
    assert read_table(str(path)).units == units
    assert stored(path).units == ({} if form in TEXT else units)
    table = read_table(path, ["qpos/torso/x", "time"])
    assert table.names == ["time", "qpos/torso/x"]
    assert table.units == {name: units[name] for name in table}
    with pytest.raises(
        UnknownNameError, match=r"no column 'tim' in .* \(did you mean 'time'\?\)\ncolumns: time, qpos/"
    ):
        read_table(path, ["qpos/knee", "tim"])


@every_format
def test_the_manifest_is_embedded_and_the_last_one_counts_where_the_format_allows(tmp_path: Path, form: str) -> None:
    path, final = tmp_path / f"t.{form}", {"mjrun": "0.1.0", "seed": 7, "rows": 3}
    for first, last, expected in ((MANIFEST, None, MANIFEST), (MANIFEST, final, final), (None, None, {})):
        with TableWriter(str(path), form, COLUMNS, first) as out:
            out.write(np.zeros((3, 3)))
            out.publish(last)
        embedded: Any = None if form in TEXT else MANIFEST if form == "feather" and first else expected
        assert stored(path).manifest == embedded
        with open_table(path) as table:
            assert table.manifest == embedded


@pytest.mark.slow
@pytest.mark.parametrize("form", [form for form in FORMATS if form != "mat"])
def test_memory_does_not_grow_with_the_length_of_a_table_that_is_read(tmp_path: Path, form: str) -> None:
    rows = np.random.default_rng(3).standard_normal((60_000 if form in TEXT else 300_000, 3))

    def peak(length: int) -> int:
        path = write(tmp_path / f"{length}.{form}", [rows[:length]])
        tracemalloc.start()
        try:
            with open_table(path) as table:
                assert sum(len(block) for block in table.blocks()) == length
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(1000)  # imports
    limit = 1.25 if form in TEXT else 6  # text is read in smaller blocks
    assert peak(len(rows)) < limit * 2**20  # bytes; the columns have 1.4 or 7.2 MB
