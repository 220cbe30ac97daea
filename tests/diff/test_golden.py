"""Rows that come are compared with a golden table, as two tables are."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.diff.result import TableDifference
from mjrun.diff.table_files import GoldenComparison, compare_tables
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import FileError, UnknownNameError, UsageError
from mjrun.formats.table_reader import OpenTable
from mjrun.options.diff import TableDiffOptions
from mjrun.simulation.mapped_table import evaluated
from tests.formats.table_files import columns, write

NAMES = columns("time", "x", "y")
EXACT = Tolerances(Tolerance(), {})


def rows(count: int) -> np.ndarray:
    values = np.random.default_rng(0).normal(size=(count, 3))
    values[:, 0] = np.arange(count) * 0.1
    return values


def compared(path: Path, values: np.ndarray, block: int = 7, tolerances: Tolerances = EXACT) -> TableDifference:
    """The comparison of the golden table `path` with rows that come in blocks, of which each is used again."""
    comparison = GoldenComparison(str(path), NAMES, tolerances)
    buffer = np.empty((block, 3))
    for start in range(0, len(values), block):
        part = buffer[: len(values[start : start + block])]
        part[:] = values[start : start + block]
        comparison.add(part)
    return comparison.finish()


@settings(max_examples=20, deadline=None)
@given(block=st.integers(1, 40), row=st.integers(0, 29), column=st.integers(1, 2), shorter=st.integers(0, 9))
def test_it_finds_what_the_comparison_of_two_files_finds(
    tmp_path_factory: pytest.TempPathFactory, block: int, row: int, column: int, shorter: int
) -> None:
    folder, golden = tmp_path_factory.mktemp("golden"), rows(30)
    now = golden[: 30 - shorter].copy()
    now[min(row, len(now) - 1), column] = np.nan
    a, b = write(folder / "a.csv", [golden], NAMES), write(folder / "b.csv", [now], NAMES)
    files, _ = compare_tables(str(a), str(b), TableDiffOptions())
    coming = compared(a, now, block)
    assert coming == files
    assert coming.only_a.count == shorter


def test_a_golden_table_that_is_overwritten_is_not_compared_and_one_that_is_replaced_is(tmp_path: Path) -> None:
    golden = write(tmp_path / "golden.csv", [rows(30)], NAMES)
    changed = rows(30) * [1, -1, 1]
    other = write(tmp_path / "other.csv", [changed], NAMES)
    os.utime(golden, ns=(0, 0))
    comparison = GoldenComparison(str(golden), NAMES, EXACT)
    comparison.add(rows(30))
    golden.write_bytes(other.read_bytes())
    with pytest.raises(FileError) as caught:
        comparison.finish()
    assert str(caught.value) == f"{golden}: has changed while it was read"

    comparison = GoldenComparison(str(golden), NAMES, EXACT)
    comparison.add(changed)
    write(tmp_path / "new.csv", [rows(30)], NAMES).rename(golden)
    assert not any(column.first for column in comparison.finish().columns)


def test_tables_that_are_written_to_during_a_comparison_are_not_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    a, b = (write(tmp_path / f"{name}.csv", [rows(30)], NAMES) for name in "ab")
    blocks = OpenTable.blocks

    def read_and_edit(table: OpenTable) -> Iterator[np.ndarray]:
        yield from blocks(table)
        os.utime(table.path, ns=(0, table.path.stat().st_mtime_ns + 10**9))

    monkeypatch.setattr("mjrun.formats.table_reader.OpenTable.blocks", read_and_edit)
    with pytest.raises(FileError, match=r"a\.csv: has changed while it was read"):
        compare_tables(str(a), str(b), TableDiffOptions())
    with pytest.raises(FileError, match=r"b\.csv: has changed while it was read"):
        evaluated(b, {}, {})


def test_the_same_rows_agree_in_every_format(tmp_path: Path) -> None:
    values = rows(100)
    values[3, 1] = np.nan
    for suffix in (".csv", ".jsonl", ".parquet", ".npz", ".feather", ".mat"):
        table = compared(write(tmp_path / f"golden{suffix}", [values], NAMES), values)
        assert not any(column.first for column in table.columns)
        assert (table.rows, table.only_a.count, table.only_b.count) == (100, 0, 0)


def test_columns_of_one_side_are_named(tmp_path: Path) -> None:
    golden = write(tmp_path / "golden.csv", [np.zeros((2, 3))], columns("time", "x", "z"))
    table = compared(golden, np.zeros((2, 3)))
    assert (table.columns_only_a, table.columns_only_b) == (["z"], ["y"])


def test_a_golden_table_without_time_is_compared_row_by_row(tmp_path: Path) -> None:
    golden = write(tmp_path / "golden.csv", [rows(4)[:, 1:2]], columns("x"))
    assert compared(golden, rows(4)).aligned == "row"


def test_what_cannot_be_compared_is_reported_before_any_row_comes(tmp_path: Path) -> None:
    other = write(tmp_path / "other.csv", [np.zeros((1, 2))], columns("time", "q"))
    with pytest.raises(UsageError, match=r"except time in common\n.*: time, q\nmeasured: "):
        GoldenComparison(str(other), NAMES, EXACT)
    with pytest.raises(FileError, match="no such file"):
        GoldenComparison(str(tmp_path / "nothing.csv"), NAMES, EXACT)
    golden = write(tmp_path / "golden.csv", [rows(2)], NAMES)
    with pytest.raises(UnknownNameError, match="no column 'qpos/"):
        GoldenComparison(str(golden), NAMES, Tolerances(Tolerance(), {"qpos/*": (1.0,)}))


def test_a_fault_in_the_golden_table_is_reported_and_rows_may_continue_coming(tmp_path: Path) -> None:
    golden = tmp_path / "golden.csv"
    golden.write_text("time,x,y\n0,1,2\n0.1,2\n")
    comparison = GoldenComparison(str(golden), NAMES, EXACT)

    def feed() -> None:
        for _ in range(50):
            comparison.add(rows(10))
        comparison.finish()

    with pytest.raises(FileError, match="expected 3 cells"):
        feed()
    comparison.close()


def test_a_comparison_that_is_given_up_ends(tmp_path: Path) -> None:
    golden = write(tmp_path / "golden.csv", [rows(5000)], NAMES)
    comparison = GoldenComparison(str(golden), NAMES, EXACT)
    comparison.add(rows(10))
    comparison.close()
    comparison.close()


def test_tolerances_are_by_column(tmp_path: Path) -> None:
    golden = write(tmp_path / "golden.csv", [rows(5)], NAMES)
    now = rows(5) + np.array([0, 1e-7, 1e-7])
    table = compared(golden, now, tolerances=Tolerances(Tolerance(), {"x": (1e-6,)}))
    assert [column.name for column in table.columns if column.first] == ["y"]
