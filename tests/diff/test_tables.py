"""Differences of columns, beside numpy on whole tables."""

import random
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff import tables
from mjrun.diff.result import ColumnDifference, TableDifference
from mjrun.diff.tables import IdenticalRows, KeyedRows, RowPairs, RowStream, compare_rows, pairs_by_columns
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


@pytest.mark.parametrize("scale", [1e-320, 1e-200, 1e-100, 1.0, 1e200, 1e307])
def test_the_rms_of_the_smallest_and_the_largest_numbers_is_neither_zero_nor_infinite(scale: float) -> None:
    differences = np.array([0.0, 1.0, 7.0, 0.5, 3.0, 4.0, 2.0, 8.0]) * scale
    found = compare(np.zeros((8, 1)), differences[:, None]).columns[0]
    exact = Fraction(sum(Fraction(each) ** 2 for each in differences.tolist())) / 8
    assert found.rms is not None
    assert float(Fraction(found.rms) ** 2 / exact) == pytest.approx(1, rel=1e-9 if scale > 1e-300 else 1e-3)


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


@pytest.fixture(autouse=True)
def single_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks stay as small as they are."""
    monkeypatch.setattr(tables, "ENOUGH", 1)


class ListedRows:
    """Rows in memory: their time and their number, in blocks of a few."""

    path, names, units = Path("rows.csv"), ("time", "x"), {}

    def __init__(self, times: list[float], sizes: list[int]) -> None:
        self._table = np.column_stack([times, np.arange(len(times), dtype=float)]) if times else np.empty((0, 2))
        self._sizes = sizes

    def blocks(self) -> Iterator[np.ndarray]:
        at = 0
        for size in [*self._sizes, len(self._table)]:
            if at < len(self._table):
                yield self._table[at : at + size]
            at += size


def stream(times: list[float], sizes: list[int], key: str | None = "time") -> RowStream:
    return RowStream(ListedRows(times, sizes), ["x"], key)


def pairs_in_order(a: RowStream, b: RowStream, tolerance: Tolerance | None) -> Iterator[RowPairs]:
    for pairs in tables.pairs_in_order(a, b, tolerance, lambda: 0):
        assert isinstance(pairs, RowPairs)
        yield pairs


def merged(a: list[float], b: list[float]) -> tuple[list[tuple[int, int]], list[int], list[int]]:
    """Pairs of row numbers, and the rows of each without one: equal times in their order."""
    pairs, only_a, only_b, i, j = [], [], [], 0, 0
    while i < len(a) or j < len(b):
        if j == len(b) or (i < len(a) and a[i] < b[j]):
            only_a.append(i)
            i += 1
        elif i == len(a) or b[j] < a[i]:
            only_b.append(j)
            j += 1
        else:
            pairs.append((i, j))
            i, j = i + 1, j + 1
    return pairs, only_a, only_b


def numbers(pairs: list[RowPairs]) -> list[tuple[int, int]]:
    """Row numbers of pairs, which are those that the rows hold."""
    found = [(int(i), int(j)) for pair in pairs for i, j in zip(pair.rows_a, pair.rows_b, strict=True)]
    assert found == [(int(i), int(j)) for pair in pairs for i, j in zip(pair.a[:, 0], pair.b[:, 0], strict=True)]
    return found


times = st.lists(st.sampled_from([-np.inf, 0.0, 0.1, 0.2, 0.25, 0.5, 1.0, 1.5, 2.0, np.inf]), max_size=14).map(sorted)
sizes = st.lists(st.integers(1, 4), max_size=8)


@given(times, times, sizes, sizes)
def test_rows_are_merged_by_time_wherever_blocks_end(
    a: list[float], b: list[float], sizes_a: list[int], sizes_b: list[int]
) -> None:
    one, other = stream(a, sizes_a), stream(b, sizes_b)
    pairs, only_a, only_b = merged(a, b)
    found = list(pairs_in_order(one, other, Tolerance()))
    assert numbers(found) == pairs
    assert [key for pair in found if pair.keys is not None for key in pair.keys] == [a[i] for i, _ in pairs]
    for side, rows, keys in ((one, only_a, a), (other, only_b, b)):
        first = (rows[0], keys[rows[0]]) if rows else (None, None)
        assert (side.unmatched.count, side.unmatched.first, side.unmatched.at) == (len(rows), *first)
        assert side.row == len(keys)


@given(st.integers(0, 9), st.integers(0, 9), sizes, sizes)
def test_rows_without_a_key_go_by_their_number(a: int, b: int, sizes_a: list[int], sizes_b: list[int]) -> None:
    one, other = stream([0.0] * a, sizes_a, None), stream([0.0] * b, sizes_b, None)
    assert numbers(list(pairs_in_order(one, other, None))) == [(i, i) for i in range(min(a, b))]
    for side, own, others in ((one, a, b), (other, b, a)):
        assert side.unmatched.count == max(0, own - others)
        assert side.unmatched.first == (others if own > others else None)
        assert side.unmatched.at is None


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.floats(-0.4, 0.4)), max_size=12), sizes, sizes)
def test_times_that_differ_within_a_tolerance_belong_together(
    rows: list[tuple[bool, bool, float]], sizes_a: list[int], sizes_b: list[int]
) -> None:
    in_a = [float(i) for i, (here, _, _) in enumerate(rows) if here]
    in_b = [i + jitter for i, (_, there, jitter) in enumerate(rows) if there]
    both = [i for i, (here, there, _) in enumerate(rows) if here and there]
    found = numbers(list(pairs_in_order(stream(in_a, sizes_a), stream(in_b, sizes_b), Tolerance(0.41))))
    assert [in_a[i] for i, _ in found] == both
    assert [round(in_b[j]) for _, j in found] == both


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ([0.0, 0.2, 0.1], "row 2: time 0.1 follows 0.2, but must not decrease"),
        ([0.0, float("nan")], "row 1: time is nan, but must be a number"),
    ],
)
def test_a_time_that_falls_is_reported_with_its_row(keys: list[float], message: str) -> None:
    for sizes in ([], [1, 1, 1], [2]):
        with pytest.raises(FileError, match=f"rows.csv: {message}"):
            list(pairs_in_order(stream(keys, sizes), stream([0.0, 1.0, 2.0], [1]), Tolerance()))


def test_memory_holds_a_few_blocks_even_where_one_side_is_far_ahead() -> None:
    many = [float(i) for i in range(1000)]
    one, other = stream(many, [10] * 99), stream([5000.0 + t for t in many], [10] * 99)
    most = 0
    for _ in pairs_in_order(one, other, Tolerance()):
        raise AssertionError
    assert one.unmatched.count == other.unmatched.count == 1000
    one, other = stream(many, [10] * 99), stream(many[::2], [10] * 49)
    for _ in pairs_in_order(one, other, Tolerance()):
        most = max(most, len(one), len(other))
    assert most <= 20


def test_equal_rows_are_passed_over_where_none_wait() -> None:
    times = [1.0, 2.0, 3.0, 4.0]
    counts = iter([7, 0, 5, 0])
    one, other = stream(times, [2, 2]), stream(times, [2, 2])
    found = list(tables.pairs_in_order(one, other, Tolerance(), lambda: next(counts)))
    shown = [pair.count if isinstance(pair, IdenticalRows) else pair.rows_a.tolist() for pair in found]
    assert shown == [7, [7, 8], [9, 10], 5]
    assert (one.row, other.row) == (16, 16)


keys = st.lists(st.tuples(st.sampled_from([0.0, 0.5, 3.0]), st.sampled_from(["a", "b", ""])), max_size=8)


class TextRows:
    path, names, units = Path("rows.csv"), ["mass", "x", "name"], {}

    def __init__(self, rows: list[tuple[float, str]]) -> None:
        self._rows = rows

    def blocks(self) -> Iterator[np.ndarray]:
        for index, (mass, name) in enumerate(self._rows):
            yield np.array([[mass, float(index), name]], object)


@given(keys, st.randoms(use_true_random=False))
def test_rows_in_another_order_belong_together_by_their_keys(
    rows: list[tuple[float, str]], dice: random.Random
) -> None:
    order = sorted(range(len(rows)), key=lambda _: dice.random())
    shuffled = [rows[index] for index in order]
    a, b = (KeyedRows(TextRows(each), ["x"], ["mass", "name"]) for each in (rows, [*shuffled, (9.0, "c")]))
    for pairs in pairs_by_columns(a, b):
        assert [rows[i] for i in pairs.rows_a] == [shuffled[j] for j in pairs.rows_b]
        assert sorted(pairs.rows_a) == sorted(pairs.rows_b) == [*range(len(rows))]
        assert pairs.a[:, 0].tolist() == pairs.rows_a.tolist()
    assert a.unmatched.count == 0
    assert (b.unmatched.count, b.unmatched.first, b.unmatched.key) == (1, len(rows), "mass = 9, name = c")


def test_texts_and_whole_numbers_that_only_resemble_each_other_are_different_keys() -> None:
    rows = [(1.0, "9007199254740993"), (1.0, "9007199254740992"), (1.0, "1_0"), (1.0, "10")]
    one, other = TextRows(rows), TextRows(rows[::-1])
    (pairs,) = pairs_by_columns(KeyedRows(one, ["x"], ["mass", "name"]), KeyedRows(other, ["x"], ["mass", "name"]))
    assert (pairs.rows_a.tolist(), pairs.rows_b.tolist()) == ([0, 1, 2, 3], [3, 2, 1, 0])


def test_a_number_is_the_same_key_however_it_is_written() -> None:
    one, other = TextRows([(3.0, "1.0"), (-0.0, "x")]), TextRows([(0.0, "x"), (3.0, "1")])
    (pairs,) = pairs_by_columns(KeyedRows(one, ["x"], ["mass", "name"]), KeyedRows(other, ["x"], ["mass", "name"]))
    assert (pairs.rows_a.tolist(), pairs.rows_b.tolist()) == ([0, 1], [1, 0])
