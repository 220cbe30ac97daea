"""Numbers of a column are those of numpy, however its rows are divided."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.plotting.column_statistics import ColumnCounter


def counted(values: np.ndarray, cuts: list[int]) -> ColumnCounter:
    counter = ColumnCounter([f"c{k}" for k in range(values.shape[1])])
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
