"""A table in numbers, whatever the blocks it comes in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UnknownNameError
from mjrun.plotting.table_statistics import TableStatisticsAccumulator, TableSummarizer

UNITS = {"time": "s", "a": "m", "a/b": "", "c": "N"}
ROWS = np.random.default_rng(0).normal(size=(50, 4))


def summary(columns: list[str] | None, *assertions: str) -> TableSummarizer:
    return TableSummarizer("run.csv", UNITS, columns, assertions)


def fed(table: TableSummarizer, *cuts: int) -> TableSummarizer:
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


def test_a_name_that_no_column_has_is_reported_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="a/b"):
        summary(["c"], "max(a/bb) < 1")


def counted(values: np.ndarray, cuts: list[int]) -> TableStatisticsAccumulator:
    counter = TableStatisticsAccumulator([f"c{k}" for k in range(values.shape[1])])
    for block in np.split(values, sorted(cuts)):
        counter.feed(block)
    return counter


@given(st.integers(1, 60), st.lists(st.integers(0, 60), max_size=4), st.integers(0, 99))
@settings(deadline=None)
def test_columns_with_gaps_are_those_of_numpy(rows: int, cuts: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(1e3, 1, (rows, 3))
    values[rng.random((rows, 3)) < 0.3] = np.nan
    values[0] = 1.0
    counter = counted(values, [min(cut, rows) for cut in cuts])
    assert counter.rows == rows
    for column, true in zip(counter.statistics(["m", "", "s"]), values.T, strict=True):
        assert (column.least, column.largest) == (np.nanmin(true), np.nanmax(true))
        assert column.mean == pytest.approx(np.nanmean(true), rel=1e-12)
        assert column.missing == np.isnan(true).sum()
        assert np.array_equal(column.last, true[-1], equal_nan=True)


def test_a_column_of_gaps_alone_and_one_that_is_infinite() -> None:
    empty, infinite = counted(np.array([[np.nan, np.inf], [np.nan, 1.0]]), [1]).statistics(["", ""])
    assert np.isnan([empty.least, empty.largest, empty.mean, empty.last]).all()
    assert empty.missing == 2
    assert (infinite.largest, infinite.mean, infinite.least) == (np.inf, np.inf, 1.0)
