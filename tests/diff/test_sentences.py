"""Differences as sentences."""

from dataclasses import replace

from mjrun.diff.result import CellDifference, ColumnDifference, TableDifference, UnitDifference, UnmatchedRows
from mjrun.diff.sentences import place, shared_sentence, table_sentences
from mjrun.errors import flag, spelled

NONE = UnmatchedRows(0, None, None)


def column(name: str, differing: int, cell: CellDifference | None) -> ColumnDifference:
    return ColumnDifference(name, "", 0, 0, differing, 1.0, 1.0, 0.0, cell, cell)


def test_every_difference_is_a_sentence() -> None:
    once = column("qpos/a\x1b", 1, CellDifference(3, 4, 0.25, "0.1", "0.2"))
    often = column("x", 7, CellDifference(1, 1, 0.0, "1.0", "nan"))
    table = TableDifference(
        aligned="time",
        rows=9,
        rows_a=12,
        rows_b=10,
        only_a=UnmatchedRows(3, 2, 0.125),
        only_b=UnmatchedRows(1, 10, 9.0),
        columns=[once, often, column("y", 0, None)],
        columns_only_a=["p"],
        columns_only_b=["q", "r"],
        units=[UnitDifference("z", "m", "mm")],
    )
    assert table_sentences(table, "A", "B") == [
        "1 column is in A only: p",
        "2 columns are in B only: q, r",
        "3 rows are in A only: the first is row 2, time 0.125 s",
        "1 row is in B only: row 10, time 9.0 s",
        "the unit of 'z' is m in A, mm in B",
        r"qpos/a\x1b differs in rows 3 and 4, time 0.25 s: 0.1, not 0.2",
        "x differs in 7 of 9 rows, first in row 1, time 0.0 s: 1.0, not nan",
    ]


def test_what_is_in_one_table_only_is_no_difference_of_what_both_have() -> None:
    table = TableDifference("time", 9, 12, 9, UnmatchedRows(3, 2, 0.125), NONE, [column("x", 0, None)], ["p"], [], [])
    assert table_sentences(table, "A", "B", common=True) == []
    assert table_sentences(replace(table, rows=0), "A", "B", "state", common=True) == ["no state is in both"]
    assert shared_sentence(table) == ""
    assert spelled(shared_sentence(replace(table, shared_agree=True)), flag) == (
        "the 9 rows and 1 column that both have agree; --common compares nothing else"
    )


def test_a_text_is_in_quotes_and_a_row_has_its_key() -> None:
    cell = CellDifference(3, 1, None, "ok", "un\x1b", "mass = 2")
    text = ColumnDifference("status", "", 0, 0, 1, None, None, None, cell, cell, text=True)
    table = TableDifference("mass", 9, 9, 9, UnmatchedRows(1, 4, None, "mass = 3"), NONE, [text], [], [], [])
    assert table_sentences(table, "A", "B") == [
        "1 row is in A only: row 4, mass = 3",
        r"status differs in rows 3 and 1, mass = 2: 'ok', not 'un\x1b'",
    ]


def test_what_agrees_has_no_sentence() -> None:
    table = TableDifference("row", 1, 1, 1, NONE, NONE, [column("x", 0, None)], [], [], [])
    assert table_sentences(table, "A", "B") == []


def test_a_place_is_a_row_with_its_time_or_a_step() -> None:
    assert place(CellDifference(2, 2, None, "", ""), "row") == "row 2"
    assert place(CellDifference(2, 2, 7.0, "", ""), "step") == "step 7"
