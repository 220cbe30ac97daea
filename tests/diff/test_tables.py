"""Differences of columns, beside numpy on whole tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff.result import ColumnDifference, TableDifference
from mjrun.diff.tables import compare_rows
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import FileError


class ArrayRows:
    """A table in memory, in blocks of a few rows."""

    def __init__(self, values: np.ndarray, names: Sequence[str], size: int = 4) -> None:
        self.path, self.names, self.units = Path("rows.csv"), names, {}
        self._values, self._size = values, size

    def blocks(self) -> Iterator[np.ndarray]:
        for start in range(0, len(self._values), self._size):
            yield self._values[start : start + self._size]


def compare(a: np.ndarray, b: np.ndarray, tolerance: Tolerance = Tolerance()) -> TableDifference:  # noqa: B008
    names = [f"x{i}" for i in range(a.shape[1])]
    rows = ArrayRows(a, names), ArrayRows(b, names, 3)
    return compare_rows(*rows, names, None, Tolerances(tolerance, {}), names, names)


def column(table: TableDifference, name: str) -> ColumnDifference:
    return next(column for column in table.columns if column.name == name)


values = st.floats(-1e100, 1e100) | st.sampled_from([0.0, -0.0, 1.0, float("nan"), float("inf")])
cells = st.lists(st.tuples(values, values, st.booleans()), min_size=1, max_size=20)


@given(cells, st.sampled_from([0.0, 0.1]), st.sampled_from([0.0, 1e-3]))
def test_differences_are_those_of_the_whole_column(
    cells: list[tuple[float, float, bool]], atol: float, rtol: float
) -> None:
    a = np.array([one for one, _, _ in cells])[:, None]
    b = np.array([other if differs else one for one, other, differs in cells])[:, None]
    tolerance = Tolerance(atol, rtol)
    found = compare(a, b, tolerance).columns[0]

    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(all="ignore"):
        difference = np.where(same, 0, b - a)[:, 0]
    beyond = np.flatnonzero(~tolerance.agree(a, b))
    assert found.differing == len(beyond)
    if np.isfinite(difference).all():
        assert found.maximum == np.abs(difference).max()
        assert found.rms == pytest.approx(np.sqrt(np.mean(difference**2)), rel=1e-9)
    else:
        assert found.maximum is None
    assert found.last == (difference[-1] if np.isfinite(difference[-1]) else None)
    assert (found.first is None) == (not len(beyond))
    if found.first and found.worst:
        assert found.first.row == beyond[0]
        assert (found.first.a, found.first.b) == (repr(float(a[beyond[0], 0])), repr(float(b[beyond[0], 0])))
        size = np.where(np.isnan(difference), np.inf, np.abs(difference))
        assert found.worst.row == beyond[size[beyond].argmax()]


def test_one_bit_of_one_number_is_found() -> None:
    a = np.random.default_rng(4).standard_normal((10_000, 6))
    b = a.copy()
    b.view(np.int64)[7_654, 3] ^= 1
    table = compare(a, b)
    assert [found.name for found in table.columns if found.first] == ["x3"]
    first = table.columns[0].first
    assert first
    assert (first.row, first.row_b, first.at) == (7_654, 7_654, None)
    assert first.a != first.b
    assert (float(first.a), float(first.b)) == (a[7_654, 3], b[7_654, 3])
    assert table.columns[0].maximum == abs(a[7_654, 3] - b[7_654, 3]) > 0


def test_the_sign_of_zero_differs_unless_there_is_a_tolerance() -> None:
    zero = np.zeros((2, 1))
    assert compare(zero, -zero).columns[0].differing == 2
    assert compare(zero, -zero, Tolerance(1e-300)).columns[0].differing == 0


def test_worst_columns_come_first_and_those_that_agree_last() -> None:
    a = np.zeros((3, 4))
    b = a + np.array([1, 0, np.inf, 5])
    assert [found.name for found in compare(a, b).columns] == ["x2", "x3", "x0", "x1"]


def test_a_table_without_rows_is_refused() -> None:
    with pytest.raises(FileError, match=r"rows.csv: has no rows"):
        compare(np.zeros((0, 2)), np.zeros((2, 2)))
