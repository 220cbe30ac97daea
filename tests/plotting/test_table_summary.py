"""A table in numbers, whatever the blocks it comes in."""

import numpy as np
import pytest

from mjrun.errors import UnknownNameError
from mjrun.plotting.table_summary import TableSummary

UNITS = {"time": "s", "a": "m", "a/b": "", "c": "N"}
ROWS = np.random.default_rng(0).normal(size=(50, 4))


def summary(columns: list[str] | None, *assertions: str) -> TableSummary:
    return TableSummary("run.csv", UNITS, columns, assertions)


def fed(table: TableSummary, *cuts: int) -> TableSummary:
    for block in np.split(ROWS, cuts):
        table.feed(dict(zip(UNITS, block.T, strict=True)))
    return table


def test_assertions_read_columns_that_are_not_chosen() -> None:
    assert summary(["c"], "max(a/b) < 9", "time < 9").names == ["time", "a/b", "c"]
    assert summary(None).names == list(UNITS)
    assert summary(["c"]).names == ["c"]


def test_verdicts_and_numbers_are_those_of_numpy() -> None:
    largest = float(ROWS[:, 2].max())
    table = fed(summary(["c"], f"max(a/b) == {largest!r}", "min(c) > 0"), 7, 8, 40)
    assert table.rows == 50
    good, bad = table.verdicts()
    assert (good.passed, bad.passed) == (True, False)
    assert f"row {int(ROWS[:, 3].argmin())}" in bad.message
    force = table.statistics()[1]
    assert (force.name, force.unit, force.least, force.last) == ("c", "N", ROWS[:, 3].min(), ROWS[-1, 3])


def test_a_name_that_no_column_has_is_told_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="a/b"):
        summary(["c"], "max(a/bb) < 1")
