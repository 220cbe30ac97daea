"""What a comparison finds is plain data that JSON holds."""

import json
from dataclasses import asdict

from mjrun.diff.result import SCHEMA, CellDifference, ColumnDifference, DiffResult, TableDifference, UnmatchedRows


def test_a_result_is_json_whatever_the_numbers_are() -> None:
    cell = CellDifference(1, 2, None, "nan", "-inf")
    column = ColumnDifference("x", "m", 0, 0, 1, None, None, None, cell, cell)
    none = UnmatchedRows(0, 0, None)
    table = TableDifference("row", 1, 1, 1, none, none, [column], [], [], [])
    document = asdict(DiffResult("table", "a", "b", False, ["x differs"], ["MuJoCo is 4 and 5"], table))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["schema"] == SCHEMA
