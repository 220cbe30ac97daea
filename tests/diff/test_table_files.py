"""Files of tables: which columns, by which key; beside pandas on whole tables."""

import io
import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mjrun.diff import tables
from mjrun.diff.result import CellDifference, TableDifference, UnmatchedRows
from mjrun.diff.sentences import table_sentences
from mjrun.diff.table_files import RecognizedResultTable, compare_tables, is_results, result_manifest, table_path
from mjrun.errors import CellError, FileError, UnknownNameError, UsageError
from mjrun.experiment.design import Design
from mjrun.formats import text_lines
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import csv as csv_format
from mjrun.model.table_column import Column
from mjrun.options.diff import TableDiffOptions
from mjrun.outputs.diff import TABLE, VIDEO, kind_of
from mjrun.study.results import ResultColumns, study_table
from mjrun.study.spec import PointResult
from tests.formats.table_files import write

INTEGER_FORMATS = ["csv", "jsonl", "parquet", "feather", "npz", "mat", "h5"]
COLUMNS = [Column("time", "s"), Column("qpos/knee", "rad"), Column("qvel/knee", "rad/s"), Column("energy", "J")]


def put(folder: Path, name: str, rows: np.ndarray, columns: list[Column] = COLUMNS) -> str:
    return str(write(folder / name, [rows], columns))


def rows(count: int = 50) -> np.ndarray:
    table = np.random.default_rng(8).standard_normal((count, 4))
    table[:, 0] = 0.01 * np.arange(count)
    return table


def compare(a: str, b: str, options: TableDiffOptions) -> TableDifference:
    return compare_tables(a, b, options)[0]


def differing(table: TableDifference) -> list[str]:
    return [column.name for column in table.columns if column.first]


@pytest.mark.parametrize("form", ["csv", "jsonl", "parquet", "feather", "npz", "mat"])
def test_tables_of_any_two_formats_agree(tmp_path: Path, form: str) -> None:
    a, b = put(tmp_path, "a.csv", rows()), put(tmp_path, f"b.{form}", rows())
    table = compare(a, b, TableDiffOptions())
    assert (table.aligned, table.rows, table.rows_a, table.rows_b) == ("time", 50, 50, 50)
    assert [column.name for column in table.columns] == ["qpos/knee", "qvel/knee", "energy"]
    assert differing(table) == []
    assert [column.unit for column in table.columns] == (
        [""] * 3 if form in ("csv", "jsonl") else ["rad", "rad/s", "J"]
    )


def test_rows_and_columns_of_one_side_are_reported_as_pandas_merges_them(tmp_path: Path) -> None:
    one, other = rows(60), rows(60)
    one, other = np.delete(one, [3, 40, 41], axis=0), np.delete(other, [0, 40, 59], axis=0)
    other[:, 2] += 1e-3
    a = put(tmp_path, "a.npz", one)
    b = put(tmp_path, "b.csv", other[:, [2, 0, 1]], [Column("qvel/knee"), Column("time"), Column("qpos/x")])
    table = compare(a, b, TableDiffOptions())
    merged = pd.merge(pd.DataFrame(one[:, :3]), pd.DataFrame(other[:, :3]), on=0, how="outer", indicator=True)
    count = merged["_merge"].value_counts()
    assert (table.rows, table.only_a.count, table.only_b.count) == (
        count["both"],
        count["left_only"],
        count["right_only"],
    )
    assert (table.only_a.first, table.only_a.at) == (0, 0.0)
    assert (table.only_b.first, table.only_b.at) == (2, other[2, 0])
    assert (table.columns_only_a, table.columns_only_b) == (["qpos/knee", "energy"], ["qpos/x"])
    assert [column.name for column in table.columns] == ["qvel/knee"]
    error = merged["2_y"] - merged["2_x"]
    assert table.columns[0].maximum == error.abs().max()
    assert table.columns[0].rms == pytest.approx(np.sqrt((error**2).mean()))
    assert table.columns[0].differing == count["both"]


def test_tolerances_are_those_of_the_column(tmp_path: Path) -> None:
    a, b = put(tmp_path, "a.csv", rows()), put(tmp_path, "b.csv", rows() + np.array([0, 1e-4, 1e-4, 1e-4]))
    assert differing(compare(a, b, TableDiffOptions(atol=1e-5))) == ["qpos/knee", "qvel/knee", "energy"]
    options = TableDiffOptions(atol=1e-5, tol={"*/knee": 2e-4, "qvel/*": [0, 0]})
    assert differing(compare(a, b, options)) == ["qvel/knee", "energy"]
    assert differing(compare(a, b, TableDiffOptions(columns="q*", tol={"*": 1}))) == []
    with pytest.raises(UnknownNameError, match="no column 'qfrc/\\*'"):
        compare(a, b, TableDiffOptions(tol={"qfrc/*": 1}))


def test_times_agree_within_their_own_tolerance_only(tmp_path: Path) -> None:
    a, b = put(tmp_path, "a.csv", rows()), put(tmp_path, "b.csv", rows() + np.array([1e-9, 0, 0, 0]))
    assert compare(a, b, TableDiffOptions(atol=1)).only_a.count == 50
    table = compare(a, b, TableDiffOptions(tol={"time": 1e-8}))
    assert (table.rows, table.only_a.count, differing(table)) == (50, 0, [])
    table = compare(a, b, TableDiffOptions(align="row"))
    assert (table.aligned, table.rows, differing(table)) == ("row", 50, ["time"])


def test_a_unit_that_is_another_is_reported_where_both_say_it(tmp_path: Path) -> None:
    a = put(tmp_path, "a.npz", rows())
    b = put(tmp_path, "b.mat", rows(), [COLUMNS[0], Column("qpos/knee", "deg"), Column("qvel/knee"), COLUMNS[3]])
    table = compare(a, b, TableDiffOptions())
    assert [(unit.name, unit.a, unit.b) for unit in table.units] == [("qpos/knee", "rad", "deg")]


def test_standard_input_may_be_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    a = put(tmp_path, "a.parquet", rows())
    text = Path(put(tmp_path, "b.csv", rows() + np.array([0, 0, 0, 1]))).read_bytes()
    for pair in ((a, "-"), ("-", a)):
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text)))
        assert differing(compare(*pair, TableDiffOptions())) == ["energy"]
    with pytest.raises(UsageError, match="only one of the two can come from standard input"):
        compare("-", "-", TableDiffOptions())


@pytest.mark.parametrize(
    ("a", "b", "options", "kind", "message"),
    [
        ("time,x\n0,1\n", "time,y\n0,1\n", {}, UsageError, "the tables have no columns in common except time\n"),
        ("x\n1\n", "y\n1\n", {}, UsageError, "the tables have no columns in common\n.*a.csv: x\n.*b.csv: y"),
        ("x,y\n1,1\n", "y,z\n1,1\n", {"columns": ["x"]}, UsageError, "no columns selected by columns in common\n"),
        ("x\n1\n", "x\n1\n", {"columns": ["q*"]}, UnknownNameError, "no column 'q\\*'"),
        ("x\n1\n", "x\n1\n", {"align": "time"}, UsageError, "align time requires a column 'time' in both tables"),
        ("time,x\n", "time,x\n0,1\n", {}, FileError, "a.csv: has no rows"),
        ("time,x\n0,1\n", "time,x\n1,2\n0,3\n", {}, FileError, "b.csv: row 1: time 0 follows 1.*\nalign row"),
        ("time,x\n0,1\n", "time,x\nnoon,1\n", {}, FileError, "b.csv: time contains values that are not numbers"),
        ("time,x,x\n0,1,1\n", "time,x\n0,1\n", {}, FileError, "a.csv: two columns are called 'x'"),
        ("time,x\n0,1\n", "time,x,x\n0,1,1\n", {}, FileError, "b.csv: two columns are called 'x'"),
        ("time,x\n0,1\n", "time,x\n0\n", {}, FileError, "b.csv:2: expected 2 cells"),
        ("", "time,x\n0\n", {}, FileError, "a.csv: is empty"),
    ],
)
def test_what_cannot_be_compared_is_reported(
    tmp_path: Path, a: str, b: str, options: dict[str, object], kind: type[Exception], message: str
) -> None:
    for name, content in (("a.csv", a), ("b.csv", b)):
        (tmp_path / name).write_text(content)
    with pytest.raises(kind, match=message):
        compare(str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), TableDiffOptions(**options))  # type: ignore[arg-type]


def test_an_empty_cell_is_nan(tmp_path: Path) -> None:
    frame = pd.DataFrame({"time": [0.0, 1, 2], "x": [1, np.nan, 3]})
    frame.to_csv(tmp_path / "a.csv", index=False)
    frame.fillna(2).to_csv(tmp_path / "b.csv", index=False)
    a = str(tmp_path / "a.csv")
    assert differing(compare(a, a, TableDiffOptions())) == []
    first = compare(a, str(tmp_path / "b.csv"), TableDiffOptions()).columns[0].first
    assert first
    assert (first.row, first.a, first.b) == (1, "nan", "2.0")


def test_columns_of_text_are_compared(tmp_path: Path) -> None:
    for name, note in (("a.csv", "end"), ("b.csv", "the end")):
        (tmp_path / name).write_text(f"time,note,x\n0,begin,1\n1,{note},2\n2,,3\n")
    pair = str(tmp_path / "a.csv"), str(tmp_path / "b.csv")
    assert differing(compare(*pair, TableDiffOptions(columns="x"))) == []
    note, x = compare(*pair, TableDiffOptions(atol=9.0)).columns
    assert (note.name, note.text, note.differing, note.maximum) == ("note", True, 1, None)
    assert (x.name, x.text, x.differing, x.maximum) == ("x", False, 0, 0)
    assert note.first == note.worst == CellDifference(1, 1, 1.0, "end", "the end")


def test_columns_of_lists_may_be_there_if_they_are_not_compared(tmp_path: Path) -> None:
    for name in ("a.jsonl", "b.jsonl"):
        (tmp_path / name).write_text('{"time": 0, "x": 1, "list": [1]}\n')
    pair = str(tmp_path / "a.jsonl"), str(tmp_path / "b.jsonl")
    assert differing(compare(*pair, TableDiffOptions(columns="x"))) == []
    with pytest.raises(CellError) as refused:
        compare(*pair, TableDiffOptions())
    assert refused.value.spelled(str).endswith("columns selects the columns to compare; others may contain anything")


def test_a_column_that_begins_after_the_first_row_is_not_overlooked(tmp_path: Path) -> None:
    pair = str(tmp_path / "a.jsonl"), str(tmp_path / "b.jsonl")
    for path, late in zip(pair, (1, 2), strict=True):
        Path(path).write_text(f'{{"time": 0, "x": 1}}\n{{"time": 1, "x": 1, "late": {late}}}\n')
    with pytest.raises(FileError, match="column 'late' is not in the first row"):
        compare(*pair, TableDiffOptions())
    Path(pair[0]).write_text('{"time": 0, "x": 1}\n{"time": 1, "x": 1}\n')
    with pytest.raises(FileError, match="column 'late' is not in the first row"):
        compare(*pair, TableDiffOptions())
    for options in (TableDiffOptions(columns="x"), TableDiffOptions(common=True)):
        assert differing(compare(*pair, options)) == []


BIG = [2**53 + 3, -(2**60) - 1, 2**63 - 1]


def put_integers(path: Path, values: list[int]) -> str:
    """A table of whole numbers, each in both columns, by the libraries that other programs use."""
    whole = np.array(values, np.int64)
    if path.suffix == ".csv":
        pd.DataFrame({"n": whole, "m": whole}).to_csv(path, index=False)
    elif path.suffix == ".jsonl":
        pd.DataFrame({"n": whole, "m": whole}).to_json(path, orient="records", lines=True)
    elif path.suffix == ".parquet":
        pd.DataFrame({"n": whole, "m": whole}).to_parquet(path)
    elif path.suffix == ".feather":
        pd.DataFrame({"n": whole, "m": whole}).to_feather(path)
    elif path.suffix == ".npz":
        np.savez(path, n=whole, m=whole)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {"n": whole[:, None], "m": whole[:, None]})
    else:
        with h5py.File(path, "w") as file:
            file["n"], file["m"] = whole, whole
    return str(path)


def test_integers_are_compared_as_integers_in_every_format(tmp_path: Path) -> None:
    same = {each: put_integers(tmp_path / f"same.{each}", BIG) for each in INTEGER_FORMATS}
    others = [BIG[0] + 1, BIG[1] + 1, BIG[2] - 1]
    next_to = {each: put_integers(tmp_path / f"next.{each}", others) for each in INTEGER_FORMATS}
    for one, other in product(INTEGER_FORMATS, repeat=2):
        assert compare(same[one], same[other], TableDiffOptions()).shared_agree, (one, other)
        for column in compare(same[one], next_to[other], TableDiffOptions()).columns:
            assert (column.differing, column.maximum, column.rms, column.last) == (3, 1.0, 1.0, -1.0), (one, other)
            assert column.first == CellDifference(0, 0, None, str(BIG[0]), str(BIG[0] + 1)), (one, other)
        assert compare(same[one], next_to[other], TableDiffOptions(atol=1.0)).shared_agree, (one, other)
        assert not compare(same[one], next_to[other], TableDiffOptions(atol=0.5)).shared_agree, (one, other)


@pytest.mark.parametrize("begin", ["1" + "0" * 30, "-18446744073709551"])
@pytest.mark.parametrize("form", ["csv", "jsonl"])
def test_integers_of_any_size_are_compared_as_text_has_them(tmp_path: Path, form: str, begin: str) -> None:
    a, b = tmp_path / f"a.{form}", tmp_path / f"b.{form}"
    for path, end in ((a, "616"), (b, "617")):
        path.write_text({"csv": f"n\n{begin}{end}\n", "jsonl": f'{{"n": {begin}{end}}}\n'}[form])
    (column,) = compare(str(a), str(b), TableDiffOptions()).columns
    assert column.first == CellDifference(0, 0, None, f"{begin}616", f"{begin}617")
    assert column.maximum == 1


def test_columns_that_are_named_tell_which_rows_belong_together(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("who,n,x\nana,1,1\nbob,1,2\nana,2,3\n")
    (tmp_path / "b.csv").write_text("n,who,x\n2,ana,3\n1.0,bob,4\n1,cyd,1\n")
    pair = str(tmp_path / "a.csv"), str(tmp_path / "b.csv")
    table = compare(*pair, TableDiffOptions(align="who, n"))
    assert (table.aligned, table.rows, [column.name for column in table.columns]) == ("who, n", 2, ["x"])
    assert table.columns[0].first == CellDifference(1, 1, None, "2.0", "4.0", "who = bob, n = 1")
    assert table.only_a == UnmatchedRows(1, 0, None, "who = ana, n = 1")
    assert table.only_b == UnmatchedRows(1, 2, None, "who = cyd, n = 1")
    with pytest.raises(UnknownNameError, match="no column 'whom' in both tables"):
        compare(*pair, TableDiffOptions(align="whom"))


def test_rows_of_different_rates_agree_where_both_have_them(tmp_path: Path) -> None:
    a, b = put(tmp_path, "a.csv", rows()), put(tmp_path, "b.csv", rows()[::5, :3], COLUMNS[:3])
    table = compare(a, b, TableDiffOptions())
    assert (table.rows, table.only_a.count, table.columns_only_a) == (10, 40, ["energy"])
    assert table.shared_agree
    c = put(tmp_path, "c.csv", rows()[::5] + np.array([0, 0, 1, 0]))
    assert not compare(a, c, TableDiffOptions()).shared_agree
    d = put(tmp_path, "d.csv", rows() + np.array([1e-3, 0, 0, 0]))
    assert not compare(a, d, TableDiffOptions()).shared_agree


def test_a_column_without_a_name_is_reported(tmp_path: Path) -> None:
    frame = pd.DataFrame({"time": [0.0, 1], "x": [1, 2]})
    frame.to_csv(tmp_path / "a.csv", index=False)
    frame.to_csv(tmp_path / "b.csv")  # with an index, as pandas does
    table = compare(str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), TableDiffOptions())
    assert table_sentences(table, "A", "B") == ["1 column is in B only: ''"]


def test_what_made_the_tables_is_compared_too(tmp_path: Path) -> None:
    def made(name: str, version: str) -> str:
        path = str(tmp_path / name)
        with TableWriter(path, Path(name).suffix[1:], COLUMNS, {"mujoco": version, "seed": 1}) as out:
            out.write(rows())
            out.publish()
        return path

    _, notes = compare_tables(made("a.npz", "4.0.0"), made("b.parquet", "4.0.1"), TableDiffOptions())
    assert notes == ["MuJoCo is 4.0.0 and 4.0.1"]


edits = st.lists(st.tuples(st.sampled_from(["change", "delete", "repeat"]), st.integers(0, 79)), max_size=4)


@given(edits, edits, st.sampled_from([16, 60, 2**16]), st.sampled_from([None, "row"]))
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_lines_that_are_passed_over_change_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    edits_a: list[tuple[str, int]],
    edits_b: list[tuple[str, int]],
    size: int,
    align: str | None,
) -> None:
    monkeypatch.setattr(text_lines, "BYTES", size)
    monkeypatch.setattr(text_lines, "COMPARED", 4 * size)

    def edited(edits: list[tuple[str, int]]) -> np.ndarray:
        table = rows(80)
        for edit, row in edits:
            index = row % len(table)
            if edit == "change":
                table[index, 2] += 1
            else:
                table = np.delete(table, index, 0) if edit == "delete" else np.insert(table, index, table[index], 0)
        return table

    a, b = edited(edits_a), edited(edits_b)
    options = TableDiffOptions(align=align)
    text = compare(put(tmp_path, "a.csv", a), put(tmp_path, "b.csv", b), options)
    binary = compare(put(tmp_path, "a.npz", a), put(tmp_path, "b.npz", b), options)
    # Sums of other blocks differ by their rounding.
    assert [column.rms for column in text.columns] == pytest.approx([column.rms for column in binary.columns])
    without_units = [replace(column, unit="", rms=0.0) for column in binary.columns]
    assert [replace(column, rms=0.0) for column in text.columns] == without_units
    assert replace(text, columns=[]) == replace(binary, columns=[])


def test_equal_files_are_hardly_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = rows(20_000)
    a = put(tmp_path, "a.csv", table)
    table.view(np.int64)[15_000, 3] ^= 1
    b = put(tmp_path, "b.csv", table)
    parsed: list[int] = []
    parse = csv_format._plain_block

    def counted(piece: bytes, *others: Any) -> np.ndarray | None:
        parsed.append(len(piece))
        return parse(piece, *others)

    monkeypatch.setattr(csv_format, "_plain_block", counted)
    monkeypatch.setattr(tables, "ENOUGH", 1)
    found = compare(a, b, TableDiffOptions())
    assert (found.rows, differing(found)) == (20_000, ["energy"])
    assert found.columns[0].first
    assert found.columns[0].first.row == 15_000
    assert sum(parsed) < Path(a).stat().st_size / 3


EPISODE_NAMES = ["episode", "seed", "return", "length", "steps", "ending", "outcome"]

DESIGN = [("0.5", "rk4"), ("0.1", "euler"), ("2", "rk4")]
ENDS = [(1.5, "ok", ""), (math.nan, "unstable", "so,\nit"), (-1.0, "ok", "")]


def study(folder: Path, order: list[int], drift: float = 0.0) -> str:
    """The folder of a study whose points are in an order, and in whose metric there is a drift."""
    folder.mkdir()
    design = Design(("mass", "integrator"), [DESIGN[index] for index in order])
    results = [PointResult(i, ENDS[k][1], (ENDS[k][0] + drift,), 9, 0, ENDS[k][2]) for i, k in enumerate(order)]  # type: ignore[arg-type]
    study_table(design, ["end"], ResultColumns.of(results, 1)).write(folder, {"metrics": {"end": "last(x)"}})
    return str(folder)


def compare_of_result_tables(a: str, b: str, **options: object) -> TableDifference:
    return compare_tables(a, b, TableDiffOptions(**options))[0]  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["", "/results.csv", "/results.parquet"])
def test_studies_are_compared_by_their_parameters_in_any_order(tmp_path: Path, form: str) -> None:
    a, b = study(tmp_path / "a", [0, 1, 2]), study(tmp_path / "b", [2, 0, 1])
    assert is_results(Path(a))
    assert kind_of(a) == TABLE
    table = compare_of_result_tables(a + form, b)
    assert (table.aligned, table.rows, table.shared_agree) == ("mass, integrator", 3, True)
    assert sorted(column.name for column in table.columns) == ["end", "exit_code", "message", "status", "steps"]
    drifted = compare_of_result_tables(a + form, study(tmp_path / "c", [1, 0], 0.25))
    (end, *others) = drifted.columns
    assert (end.name, end.differing, end.maximum) == ("end", 1, 0.25)
    assert end.first is not None
    assert (end.first.row, end.first.row_b, end.first.key) == (0, 1, "mass = 0.5, integrator = rk4")
    assert not any(column.differing for column in others)
    assert drifted.only_a.key == "mass = 2, integrator = rk4"
    assert compare_of_result_tables(a + form, b, align="row").columns[0].differing


def test_without_a_manifest_points_belong_together_by_their_numbers(tmp_path: Path) -> None:
    a, b = study(tmp_path / "a", [0, 1, 2]), study(tmp_path / "b", [0, 1, 2])
    for folder in (a, b):
        Path(folder, "results.parquet").unlink()
    assert result_manifest(Path(a, "results.csv")) is None
    assert table_path(a) == f"{a}/results.csv"
    assert (compare_of_result_tables(a, b).aligned, compare_of_result_tables(a, b).shared_agree) == ("point", True)


def test_episodes_are_compared_by_policy_parameters_and_seed(tmp_path: Path) -> None:
    names = ["policy", "point", "friction", *EPISODE_NAMES]
    lines = [
        f"walk,{point},{point / 2},{seed},{seed},{seed}.5,1,9,timeout,timeout" for point in (0, 1) for seed in (3, 4)
    ]
    a, b = tmp_path / "episodes.csv", tmp_path / "b.csv"
    a.write_text("\n".join([",".join(names), *lines]) + "\n")
    other = [line.replace("walk,0,", "walk,7,").replace(",3.5,", ",3.25,") for line in reversed(lines)]
    b.write_text("\n".join([",".join(names), *other]) + "\n")
    assert kind_of(str(tmp_path)) == TABLE
    table = compare_of_result_tables(str(tmp_path), str(b))
    assert (table.aligned, table.rows) == ("policy, friction, seed", 4)
    assert [column.name for column in table.columns if column.differing] == ["return"]
    assert table.columns[0].differing == 2
    assert not {"point", "episode"} & {column.name for column in table.columns}


def test_other_tables_and_folders_are_none_of_these(tmp_path: Path) -> None:
    assert RecognizedResultTable.of(["point", "x"]) is None
    assert RecognizedResultTable.of(["time", *EPISODE_NAMES[1:]]) is None
    assert not is_results(tmp_path)
    assert kind_of(str(tmp_path)) == VIDEO
    assert table_path(str(tmp_path)) == str(tmp_path)
    assert result_manifest(tmp_path / "table.csv") is None


@pytest.mark.parametrize("align", ["time", "row"])
def test_a_difference_is_in_its_row_where_the_lines_of_csv_are_parsed_in_several_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, align: str
) -> None:
    count = 4000
    monkeypatch.setattr(tables, "ENOUGH", 1000)
    monkeypatch.setattr(text_lines, "BYTES", 2**14)
    lines = [f"{time},7,nan" for time in range(10000, 10000 + count)]
    a = tmp_path / "a.csv"
    a.write_text("\n".join(["time,x,gap", *lines, ""]))
    for row in range(5, count, 333):
        changed = [*lines]
        changed[row] = changed[row].replace(",7,", ",9,")
        b = tmp_path / "b.csv"
        b.write_text("\n".join(["time,x,gap", *changed, ""]))
        table = compare(str(a), str(b), TableDiffOptions(align=align))
        (found,) = (column.first for column in table.columns if column.first)
        assert (found.row, found.row_b, table.rows) == (row, row, count)
