"""Reading tables: broken and missing files, gaps, standard input, memory; see `tables` for the formats."""

import functools
import importlib.util
import io
import os
import pickle
import re
import struct
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

import mjrun
from mjrun.errors import FileError, MissingExtraError, MjrunError, UnknownNameError, UsageError, clean
from mjrun.formats import text_lines
from mjrun.formats.table_reader import open_table, read_table
from mjrun.formats.tables import FORMATS, suffixes
from tests.formats.table_files import bits, everything, hypothesis, lists, put, write

Broken = tuple[str, Callable[[], bytes], str]


@pytest.mark.parametrize("form", FORMATS)
def test_nothing_wanted_is_nothing(tmp_path: Path, form: str) -> None:
    assert read_table(write(tmp_path / f"t.{form}", [np.zeros((2, 3))]), lambda name: False).columns == {}


def test_the_suffix_may_be_in_capitals(tmp_path: Path) -> None:
    assert lists(write(tmp_path / "T.CSV", [np.ones((1, 3))]), "time") == {"time": [1.0]}


# --- tables that cannot be read ----------------------------------------------------------------------


def arrow(write: Callable[[pa.Table, Any], None] = pq.write_table, **columns: Any) -> Callable[[], bytes]:
    return lambda: _written(lambda file: write(pa.table(columns), file))


def npz(**arrays: Any) -> Callable[[], bytes]:
    return lambda: _written(lambda file: np.savez(file, **arrays))


def hdf5(**arrays: Any) -> Callable[[], bytes]:
    def write(file: io.BytesIO) -> None:
        with h5py.File(file, "w") as archive:
            for name, array in arrays.items():
                archive[name] = array

    return lambda: _written(write)


def mat(*packed: bool, **variables: Any) -> Callable[[], bytes]:
    return lambda: _written(lambda file: savemat(file, variables, do_compression=bool(packed)))


def _written(write: Callable[[io.BytesIO], Any]) -> bytes:
    file = io.BytesIO()
    write(file)
    return file.getvalue()


def text(content: str | bytes) -> Callable[[], bytes]:
    return lambda: content.encode() if isinstance(content, str) else content


def zipped(*members: tuple[str, bytes]) -> Callable[[], bytes]:
    def write(file: io.BytesIO) -> None:
        with zipfile.ZipFile(file, "w") as archive:
            for name, content in members:
                archive.writestr(zipfile.ZipInfo(name), content)

    return lambda: _written(write)


def npy(shape: str, content: bytes = b"", descr: str = "<f8", version: bytes = b"\1\0") -> bytes:
    head = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY" + version + struct.pack("<H", len(head)) + head + content


def cut(content: Callable[[], bytes], at: int) -> Callable[[], bytes]:
    return lambda: content()[:at]


def with_byte(content: Callable[[], bytes], at: int, byte: int) -> Callable[[], bytes]:
    def changed() -> bytes:
        whole = bytearray(content())
        whole[at] = byte
        return bytes(whole)

    return changed


CELLS = {"columns": np.array(["ctrl/a"], object), "variables": np.array(["ctrl_a"], object)}
LONG = '{"time":1,"x":"' + "long" * 30 + '"}'
TEXTS: list[Broken] = [
    ("t.csv", text(""), "{}: is empty: a table begins with the names of its columns"),
    ("t.csv", text("\n \n\r\n"), "{}: is empty: a table begins with the names of its columns"),
    ("t.csv", text("0.0,1\n0.1,2\n"), "{}:1: holds numbers: a table begins with the names of its columns"),
    ("t.csv", text("time;x\n0;1\n"), "{}:1: 'time;x' is one column: separate columns by commas, decimals by points"),
    (
        "t.csv",
        text("\ntime\tx\n0\t1\n"),
        r"{}:2: 'time\tx' is one column: separate columns by commas, decimals by points",
    ),
    ("t.csv", text("time,x\n0,1\n".encode("utf-16")), "{}:1: is not text in UTF-8"),
    ("t.csv", text("time,x\n0,1\n2\n"), "{}:3: expected 2 cells, as in the header, got 1"),
    ("t.csv", text("time,x\n0,1\n\n2,3,\n"), "{}:4: expected 2 cells, as in the header, got 3"),
    ("t.csv", text("time,x\n0,1\n1,abc\nd,2\n"), "{}:3: column 'x': 'abc' is not a number"),
    ("t.csv", text("time,x\n0,1\nd,e\n"), "{}:3: column 'time': 'd' is not a number"),
    ("t.csv", text("time,x\n0,1\n1,\n"), "{}:3: column 'x': an empty cell is not a number"),
    ("t.csv", text('time,x\n0,1\n1,"2,5"\n'), "{}:3: column 'x': '2,5' is not a number; decimals need a point"),
    ("t.csv", text("time,x\n0,1_000\n"), "{}:2: column 'x': '1_000' is not a number"),
    ("t.csv", text("time,x\n0,１\n"), "{}:2: column 'x': '１' is not a number"),
    ("t.csv", text("time,x\n0,0x10\n"), "{}:2: column 'x': '0x10' is not a number"),
    ("t.csv", text("time,x\n0,\x1b[31m\u202e\n"), r"{}:2: column 'x': '\x1b[31m\u202e' is not a number"),
    ("t.csv", text(b"time,x\n0,\xb0\n"), r"{}:2: column 'x': '\udcb0' is not a number"),
    ("t.csv", text("time,x\n0," + "y" * 99), f"{{}}:2: column 'x': '{'y' * 79}…' is not a number"),
    ("t.csv", text('"ti\nme",x\n"1\n",2\n3,"4\r\n\n"\n5,"6 7"\n'), "{}:8: column 'x': '6 7' is not a number"),
    ("t.csv", text('time,note,x\n0,"a\nb\n",1\n1,"c\n",y\n'), "{}:5: column 'x': 'y' is not a number"),
    ("t.csv", text('time,note\n0,"a\nb"\n1\n'), "{}:4: expected 2 cells, as in the header, got 1"),
    ("t.csv", text("time,x, time\n0,1,2\n"), "{}: two columns are called 'time'"),
    ("t.csv", text('time,x\n0,1\n1,"2\n3,4\n'), "{}:3: cannot be read as .csv: unexpected end of data"),
    ("t.csv", text('time,x\n0,"1"2\n'), "{}:2: cannot be read as .csv: ',' expected after '\"'"),
    ("t.csv", text("time\n0,1\n"), "{}:2: expected 1 cell, as in the header, got 2"),
    ("t.jsonl", text(""), "{}: is empty: its first row has the names of the columns"),
    ("t.jsonl", text('{"time":1}\n\n{"time":}\n'), "{}:3: cannot be read as JSON: unexpected character*"),
    ("t.jsonl", text('{"time":1}\n{"time":'), "{}:2: cannot be read as JSON: unexpected end of data*"),
    ("t.jsonl", text(b'{"time":1}\n{"\xff":1}\n'), "{}:2: cannot be read as JSON: *"),
    ("t.jsonl", text('[{"time":1}]\n'), '{}:1: is not an object, as in {{"time": 0.0}}'),
    ("t.jsonl", text('{"time":1}\n2\n'), '{}:2: is not an object, as in {{"time": 0.0}}'),
    ("t.jsonl", text('{"time":1,"x":0,"time":2}\n'), "{}:1: two columns are called 'time'"),
    ("t.jsonl", text('{"time":1,"x":0}\n{"time":1}\n'), "{}:2: column 'x' is missing"),
    ("t.jsonl", text('{"time":1}\n{"time":1,"x":0}\n'), "{}:2: column 'x' is not in the first row"),
    ("t.jsonl", text('{"time":1}\n\n{"time":null}\n'), "{}:3: column 'time': null is not a number"),
    ("t.jsonl", text('{"time":1}\n{"time":"2"}\n'), "{}:2: column 'time': '2' is not a number"),
    ("t.jsonl", text('{"time":[1]}\n'), "{}:1: column 'time': a list is not a number"),
    ("t.jsonl", text('{"time":{}}\n'), "{}:1: column 'time': an object is not a number"),
    ("t.jsonl", text(LONG), f"{{}}:1: column 'x': '{'long' * 19}lon…' is not a number"),
]
COLUMNAR: list[Broken] = [
    ("t.parquet", text(""), "{}: cannot be read as .parquet: *"),
    ("t.parquet", text("time,x\n0,1\n"), "{}: cannot be read as .parquet: *"),
    ("t.parquet", cut(arrow(time=[1.0]), -20), "{}: cannot be read as .parquet: *"),
    ("t.parquet", with_byte(arrow(time=[1.0]), -7, 99), "{}: cannot be read as .parquet: *"),
    ("t.parquet", arrow(time=[1.0], x=["a"]), "{}: column 'x' holds string, not numbers"),
    ("t.parquet", arrow(x=pa.array(["a"]).dictionary_encode()), "{}: column 'x' holds string, not numbers"),
    ("t.parquet", arrow(time=pa.array([0], pa.timestamp("s"))), "{}: column 'time' holds timestamp[ms], not numbers"),
    ("t.parquet", arrow(x=[[1.0]]), "{}: column 'x' holds list<element: double>, not numbers"),
    ("t.parquet", arrow(time=[1, 2], x=[1.0, None]), "{}: row 1: column 'x': null is not a number"),
    ("t.parquet", arrow(x=pa.array([None, 1.5]).dictionary_encode()), "{}: row 0: column 'x': null is not a number"),
    ("t.feather", text(""), "{}: cannot be read as .feather: *"),
    ("t.arrow", arrow(time=[1.0]), "{}: cannot be read as .arrow: *"),
    ("t.feather", cut(arrow(pyarrow.feather.write_feather, time=[1.0]), -9), "{}: cannot be read as .feather: *"),
    ("t.feather", arrow(pyarrow.feather.write_feather, x=[1, None]), "{}: row 1: column 'x': null is not a number"),
    ("t.npz", text(""), "{}: cannot be read as .npz: File is not a zip file"),
    ("t.npz", cut(npz(time=np.zeros(3)), -9), "{}: cannot be read as .npz: File is not a zip file"),
    ("t.npz", with_byte(npz(time=np.zeros(3)), 170, 1), "{}: cannot be read as .npz: Bad CRC-32 for file 'time.npy'"),
    ("t.npz", npz(x=np.zeros((2, 3, 4))), "{}: column 'x' has the shape (2, 3, 4), not (n,) or (n, k)"),
    ("t.npz", npz(x=np.zeros(())), "{}: column 'x' has the shape (), not (n,) or (n, k)"),
    ("t.npz", npz(x=np.array(["a", "b"])), "{}: column 'x' holds text, not numbers"),
    ("t.npz", npz(x=np.array([1j])), "{}: column 'x' holds complex values, not numbers"),
    ("t.npz", npz(x=np.array([{}])), "{}: column 'x' holds objects, not numbers"),
    ("t.npz", npz(x=np.zeros(2, "M8[s]")), "{}: column 'x' holds datetime64[s], not numbers"),
    ("t.npz", npz(x=np.zeros(2, [("a", float)])), "{}: column 'x' holds void64, not numbers"),
    ("t.npz", npz(time=np.zeros(2), x=np.zeros(3)), "{}: columns differ in rows: 'time' 2 and 'x' 3"),
    (
        "t.npz",
        lambda: zipped(("x.npy", b""), ("y.npy", b""))().replace(b"y.npy", b"x.npy"),
        "{}: two columns are called 'x'",
    ),
    ("t.npz", zipped(("x.npy", b"")), "{}: cannot be read as .npz: EOF: *"),
    ("t.npz", zipped(("x.npy", pickle.dumps([1.0]))), "{}: cannot be read as .npz: *"),
    ("t.npz", zipped(("x.npy", npy("(2,)", bytes(8)))), "{}: cannot be read as .npz: buffer is smaller than*"),
    (
        "t.npz",
        zipped(("x.npy", npy("(2,)", bytes(17)))),
        "{}: cannot be read as .npz: an array is longer than its shape",
    ),
    ("t.npz", zipped(("x.npy", npy("(-2,)"))), "{}: cannot be read as .npz: *"),
    ("t.npz", zipped(("x.npy", npy(f"({2**80},)"))), "{}: cannot be read as .npz: *"),
    ("t.npz", zipped(("x.npy", npy(f"({2**55},)"))), "{}: cannot be read as .npz: buffer is smaller*"),
    ("t.npz", zipped(("x.npy", npy("(0,)", version=b"\7\0"))), "{}: cannot be read as .npz: *version*"),
    ("t.h5", text(""), "{}: cannot be read as .h5: *"),
    ("t.h5", cut(hdf5(time=np.zeros(9)), -9), "{}: cannot be read as .h5: *"),
    ("t.h5", hdf5(x=np.zeros((2, 3, 4))), "{}: column 'x' has the shape (2, 3, 4), not (n,) or (n, k)"),
    ("t.h5", hdf5(x=np.zeros(())), "{}: column 'x' has the shape (), not (n,) or (n, k)"),
    ("t.h5", hdf5(x="text"), "{}: column 'x' holds text, not numbers"),
    ("t.h5", hdf5(x=np.array([1j])), "{}: column 'x' holds complex values, not numbers"),
    ("t.h5", hdf5(time=np.zeros(2), x=np.zeros(3)), "{}: columns differ in rows: 'time' 2 and 'x' 3"),
    (
        "t.mat",
        text(""),
        "{}: cannot be read as .mat: it is not a MAT-file of version 5 to 7.2; save it with -v7 in MATLAB",
    ),
    (
        "t.mat",
        text(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(600)),
        "{}: cannot be read as .mat: it is not a MAT-file*",
    ),
    ("t.mat", cut(mat(x=np.zeros((9, 1))), -8), "{}: cannot be read as .mat: it is cut off"),
    ("t.mat", cut(mat(x=np.zeros((9, 1))), 131), "{}: cannot be read as .mat: *"),
    (
        "t.mat",
        with_byte(mat(x=np.zeros((9, 1))), 128, 99),
        "{}: cannot be read as .mat: it holds data of the unknown type 99",
    ),
    ("t.mat", with_byte(mat(x=np.zeros((9, 1))), 160, 8), "{}: cannot be read as .mat: the size of a matrix is not*"),
    (
        "t.mat",
        with_byte(mat(x=np.zeros((9, 1))), 180, 99),
        "{}: cannot be read as .mat: a part of a variable is longer*",
    ),
    (
        "t.mat",
        with_byte(mat(True, x=np.zeros((9, 1))), -1, 99),
        "{}: cannot be read as .mat: Error -3 while decompressing*",
    ),
    (
        "t.mat",
        mat(x=np.zeros((2, 3, 4))),
        "{}: column 'x' has the shape (2, 3, 4), not (n, 1), (1, n) or (n, k)",
    ),
    ("t.mat", mat(x="text"), "{}: column 'x' holds text, not numbers"),
    ("t.mat", mat(x={"a": 1}), "{}: column 'x' holds a structure, not numbers"),
    ("t.mat", mat(x=np.array([1, "a"], object)), "{}: column 'x' holds cells, not numbers"),
    ("t.mat", mat(x=scipy.sparse.csc_matrix(np.eye(2))), "{}: column 'x' holds a sparse matrix, not numbers"),
    ("t.mat", mat(x=np.array([[1j]])), "{}: column 'x' holds complex values, not numbers"),
    ("t.mat", mat(a=np.zeros((2, 1)), b=np.zeros((3, 1))), "{}: columns differ in rows: 'a' 2 and 'b' 3"),
    ("t.mat", mat(**CELLS), "{}: cannot be read as .mat: a column has no variable"),
    ("t.mat", lambda: mat(x=np.ones((1, 1)))() + mat(x=np.ones((1, 1)))()[128:], "{}: two columns are called 'x'"),
]


@pytest.mark.parametrize(("name", "content", "message"), [*TEXTS, *COLUMNAR])
def test_a_broken_table_is_reported_in_a_sentence(
    tmp_path: Path, name: str, content: Callable[[], bytes], message: str
) -> None:
    path = put(tmp_path / name, content())
    with pytest.raises(FileError) as error:
        read_table(path, lambda column: column != "note")
    told, pattern = str(error.value), re.escape(message.format(path)).replace(r"\*", ".*")
    assert re.fullmatch(pattern, told), told
    assert error.value.exit_code == 7
    assert "\n" not in told
    assert clean(told) == told


def test_columns_that_are_not_wanted_may_be_anything(tmp_path: Path) -> None:
    files = [
        put(tmp_path / "t.csv", "x,time,x,\na,1,,b\n"),
        put(tmp_path / "t.jsonl", '{"x":"a","time":1,"y":null}\n'),
        put(tmp_path / "t.npz", zipped(("x.npy", b""), ("time.npy", npy("(1,)", struct.pack("<d", 1))), ("x", b""))()),
        put(tmp_path / "t.h5", hdf5(x="a", time=np.ones(1), y=np.zeros((2, 2, 2)))()),
        put(tmp_path / "t.mat", mat(x="a", time=1.0, y=np.zeros((2, 2)))()),
    ]
    pq.write_table(pa.table([["a"], [1.0], [None]], ["x", "time", "x"]), tmp_path / "t.parquet")
    for path in [*files, tmp_path / "t.parquet"]:
        assert lists(path, "time") == {"time": [1]}


SOUND: dict[str, list[Callable[[], bytes]]] = {
    "csv": [text('time,"a,b"\n0.5,nan\n"1",-2e5\n')],
    "jsonl": [text('{"time":0.5,"a":1}\n{"time":1,"a":-2e5}\n')],
    "parquet": [arrow(time=[0.5, 1.0], a=pa.array([1, 2]).dictionary_encode(), note=["x", None])],
    "feather": [arrow(pyarrow.feather.write_feather, time=[0.5, 1.0], a=pa.array([1.5, 2]).dictionary_encode())],
    "npz": [npz(time=np.zeros(2), a=np.arange(2)), lambda: _written(lambda file: np.savez_compressed(file, a=[1.0]))],
    "hdf5": [hdf5(time=np.zeros(2), a=np.arange(2)), hdf5(**{"qpos/a": np.zeros((2, 3))})],
    "mat": [mat(x=np.zeros((3, 1)), ctrl_a=np.ones((3, 1)), **CELLS), mat(True, ctrl_a=np.ones((3, 1)), **CELLS)],
}


@functools.cache
def sound_files(form: str) -> list[bytes]:
    """The contents of `SOUND`, written once."""
    return [content() for content in SOUND[form]]


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMATS)
@given(data=st.data())
@settings(hypothesis, max_examples=25)
def test_whatever_happens_to_a_file_it_is_read_or_refused(tmp_path: Path, form: str, data: st.DataObject) -> None:
    content = bytearray(data.draw(st.sampled_from(sound_files(form))))
    for _ in range(data.draw(st.integers(1, 3))):
        at, length = data.draw(st.integers(0, len(content))), data.draw(st.sampled_from([0, 0, 1, 4, 8, 10**6]))
        content[at : at + length] = data.draw(st.binary(max_size=4) if length < 10**6 else st.just(b""))
    path = put(tmp_path / f"t.{form}", bytes(content))
    try:
        lists(path)
    except MjrunError as error:
        assert str(error).startswith(str(path))  # noqa: PT017
        assert all(clean(line) == line for line in str(error).split("\n"))  # noqa: PT017


# --- files that are not there ------------------------------------------------------------------------


def test_a_file_that_is_not_there_is_reported_with_one_that_is(tmp_path: Path) -> None:
    put(tmp_path / "throw.csv", "time\n0\n")
    put(tmp_path / "throw.txt", "")
    with pytest.raises(FileError) as error:
        read_table(tmp_path / "thrwo.csv", everything)
    assert str(error.value) == f"{tmp_path}/thrwo.csv: no such file (did you mean 'throw.csv'?)"
    for missing in (tmp_path / "none/t.csv", tmp_path / "throw.csv/t.csv"):
        with pytest.raises(FileError) as error:
            read_table(missing, everything)
        assert str(error.value) == f"{missing}: no such file"


def test_what_is_no_file_is_reported(tmp_path: Path) -> None:
    (tmp_path / "t.csv").mkdir()
    os.mkfifo(tmp_path / "p.csv")
    for path, message in (
        (tmp_path / "t.csv", "is a folder, not a table"),
        (tmp_path, "is a folder, not a table"),
        (tmp_path / "p.csv", "is not a regular file"),
        (tmp_path / ("x" * 300 + ".csv"), "cannot be read: File name too long"),
    ):
        with pytest.raises(FileError) as error:
            read_table(path, everything)
        assert str(error.value) == f"{path}: {message}"
    with pytest.raises(FileError, match=r"\\x00.csv: cannot be read: .*embedded null"):
        read_table(tmp_path / "\0.csv", everything)


@pytest.mark.parametrize("suffix", suffixes())
def test_a_file_that_may_not_be_opened_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    path, opening = put(tmp_path / f"t{suffix}", ""), Path.open

    def refuse(file: Path, *arguments: Any, **options: Any) -> Any:
        if file == path:
            raise PermissionError(13, "Permission denied")
        return opening(file, *arguments, **options)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FileError) as error:
        read_table(path, everything)
    assert str(error.value) == f"{path}: cannot be read: Permission denied"


def test_a_suffix_that_means_no_format_is_reported_with_those_that_do(tmp_path: Path) -> None:
    path = put(tmp_path / "t.xlsx", "")
    with pytest.raises(UnknownNameError) as error:
        read_table(path, everything)
    assert str(error.value) == f"no table format '.xlsx' in {path}\ntable formats: " + ", ".join(suffixes())


@pytest.mark.parametrize("suffix", [".parquet", ".feather", ".arrow"])
def test_without_pyarrow_what_needs_it_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyarrow" else name)
    with pytest.raises(MissingExtraError) as error:
        read_table(put(tmp_path / f"t{suffix}", ""), everything)
    assert str(error.value) == f"reading {suffix} needs pyarrow, which is not installed\npip install 'mjrun[parquet]'"
    assert lists(write(tmp_path / "t.csv", [np.ones((1, 3))]), "time") == {"time": [1.0]}


def test_memory_that_runs_out_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "concatenate", full)
    with pytest.raises(FileError, match=r"t.csv: its columns do not fit in memory"):
        read_table(put(tmp_path / "t.csv", "time\n0\n"), everything)


# --- tables in blocks --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "rows"),
    [
        ("time,x\n0,-0\n1,2\n", [[0, -0.0], [1, 2]]),
        ("time,x\n0,-0\r\n1,2", [[0, -0.0], [1, 2]]),
        ("time,x\n-0,1\r2,-0", [[-0.0, 1], [2, -0.0]]),
        ("time,x\n0,1\r\r\n1e999,2\n", [[0, 1], [float("inf"), 2]]),
        ("time,x\n0,9007199254740993\n1,18446744073709551617\n", [[0, 2.0**53], [1, 2.0**64]]),
        ("time,x\n1,2\n3,nan\n\n-inf,5\n", [[1, 2], [3, float("nan")], [float("-inf"), 5]]),
        ('time,x\n1,2\n"3",4\n5,6\n', [[1, 2], [3, 4], [5, 6]]),
    ],
)
def test_text_that_json_would_take_otherwise_is_read_as_python_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str, rows: list[list[float]]
) -> None:
    for size in (1, 9, 2**16):  # bytes in a piece
        monkeypatch.setattr(text_lines, "BYTES", size)
        with open_table(put(tmp_path / "t.csv", content)) as table:
            assert bits(np.concatenate(list(table.blocks()))) == bits(rows)


@pytest.mark.parametrize("cell", ["true", "null", "[1]", "{}", '"x"', "1_0", "١"])
def test_what_only_json_takes_for_a_cell_is_refused_in_csv(tmp_path: Path, cell: str) -> None:
    path = put(tmp_path / "t.csv", f"time,x\n0,1\n1,{cell}\n")
    with pytest.raises(FileError, match=f"^{re.escape(str(path))}:3: column 'x': "):
        read_table(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("t.csv", b"time,x\n0,\n1, \n2,3\n"),
        ("t.jsonl", b'{"time":0,"x":null}\n{"time":1}\n{"x":3,"time":2}\n'),
        ("t.parquet", arrow(time=[0.0, 1, 2], x=pa.array([None, None, 3]))()),
        ("t.parquet", arrow(time=[0.0, 1, 2], x=pa.array([None, None, 3.0]).dictionary_encode())()),
        ("t.feather", arrow(pyarrow.feather.write_feather, time=[0.0, 1, 2], x=pa.array([None, None, Decimal(3)]))()),
    ],
)
def test_gaps_in_tables_of_others_are_nan_if_that_is_asked_for(tmp_path: Path, name: str, content: bytes) -> None:
    table = read_table(put(tmp_path / name, content), missing="nan")
    assert table["time"].tolist() == [0, 1, 2]
    assert bits(table["x"]) == bits([float("nan"), float("nan"), 3])
    with pytest.raises(FileError, match=r"null is not a number|an empty cell is not a number|is missing"):
        read_table(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "read"),
    [
        (b"time,x\n0,1\n2,3\n", {"time": [0, 2], "x": [1, 3]}),
        (b'\xef\xbb\xbf\n {"time":0,"x":1}\n{"time":2,"x":3}\n', {"time": [0, 2], "x": [1, 3]}),
    ],
)
def test_csv_and_json_lines_on_standard_input_are_reported_apart(
    monkeypatch: pytest.MonkeyPatch, content: bytes, read: dict[str, list[float]]
) -> None:
    stdin = io.TextIOWrapper(io.BytesIO(content))
    monkeypatch.setattr("sys.stdin", stdin)
    table = read_table("-")
    assert {name: table[name].tolist() for name in table} == read
    assert not stdin.buffer.closed


def test_standard_input_that_holds_no_table_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    for content, message in (
        (b"", "<stdin>: is empty: a table begins with the names of its columns"),
        (b"time\n0\nx\n", "<stdin>:3: column 'time': 'x' is not a number"),
        (b"[1]\n", '<stdin>:1: is not an object, as in {"time": 0.0}'),
    ):
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content)))
        with pytest.raises(FileError, match=f"^{re.escape(message)}$"):
            read_table("-")
    sys.stdin.close()
    with pytest.raises(UsageError, match="the table - is read from standard input, which is closed"):
        read_table("-")


def compressed(path: Path, values: np.ndarray) -> Path:
    """A table of one column, compressed as well as its format can be."""
    match path.suffix:
        case ".npz":
            np.savez_compressed(path, a=values)
        case ".parquet":
            pq.write_table(pa.table({"a": values}), path, compression="zstd", use_dictionary=False)
        case ".feather":
            pyarrow.feather.write_feather(pa.table({"a": values}), path, compression="zstd")
        case ".mat":
            savemat(path, {"a": values[:, None]}, do_compression=True)
        case ".h5":
            with h5py.File(path, "w") as archive:
                archive.create_dataset("a", data=values, chunks=values.shape, compression="gzip")
    return path


@pytest.mark.parametrize("suffix", [".npz", ".parquet", ".feather", ".mat", ".h5"])
def test_a_small_file_does_not_fill_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    zeros, noise = np.zeros(2**18), np.random.default_rng(0).standard_normal(2**18)
    packed = compressed(tmp_path / f"zeros{suffix}", zeros)
    assert packed.stat().st_size < zeros.nbytes / 100
    assert np.array_equal(read_table(packed)["a"], zeros)  # below 1 GiB

    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    with pytest.raises(FileError, match=r"would expand to [\d.]+ GB in memory"):
        read_table(packed)
    assert np.array_equal(read_table(compressed(tmp_path / f"noise{suffix}", noise))["a"], noise)


def test_a_table_that_is_read_whole_needs_the_memory_of_its_columns_and_of_one_more(tmp_path: Path) -> None:
    arrays: dict[str, Any] = {str(i): np.zeros(200_000) for i in range(20)}
    np.savez(tmp_path / "t.npz", **arrays)
    tracemalloc.start()
    try:
        read_table(tmp_path / "t.npz", "1")
        assert tracemalloc.get_traced_memory()[1] < 2 * 8 * 200_000 + 2 * 2**20  # bytes; the file has 32 MB
    finally:
        tracemalloc.stop()


def test_rows_of_a_wide_array_are_read_in_blocks_of_bounded_size(tmp_path: Path) -> None:
    wide = np.zeros((4096, 1024), np.float32)
    np.savez(tmp_path / "w.npz", a=wide)
    tracemalloc.start()
    try:
        assert not read_table(tmp_path / "w.npz", ["a/7"])["a/7"].any()
        assert tracemalloc.get_traced_memory()[1] < wide.nbytes / 4
    finally:
        tracemalloc.stop()


TABLE = mjrun.Table({"time": np.arange(3.0), "qpos/knee": np.ones(3)}, {"qpos/knee": "rad", "other": "m"})


def test_columns_are_found_by_name_in_their_order() -> None:
    assert TABLE["time"].tolist() == [0, 1, 2]
    assert TABLE.names == list(TABLE) == ["time", "qpos/knee"]
    assert len(TABLE) == 2
    assert "time" in TABLE
    assert "other" not in TABLE


def test_every_column_has_a_unit_and_nothing_else_has() -> None:
    assert TABLE.units == {"time": "", "qpos/knee": "rad"}


def test_a_column_that_is_missing_is_reported_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match=r"no column 'qpos/kne' \(did you mean 'qpos/knee'\?\)\ncolumns: time, "):
        _ = TABLE["qpos/kne"]
