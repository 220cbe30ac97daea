"""Envelopes, against numpy on the whole table."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.plotting.figure_data import GROUP, GROUPS, CurvePoints, Envelope, XRangeFilter

BINS = 64


def envelope(x: np.ndarray, y: np.ndarray, block: int = 1000, **how: bool) -> list[CurvePoints]:
    made = Envelope(y.shape[1], BINS, **how)
    for start in range(0, len(x), block):
        made.feed(x[start : start + block], y[start : start + block])
    return made.curves()


def walk(rows: int, curves: int = 3, seed: int = 0) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).standard_normal((rows, curves)), axis=0)


def widths(x: np.ndarray, rows: int) -> float:
    """The width of bins after all of x: the first 2·BINS samples fill them, then they double."""
    width = (x[2 * BINS - 1] - x[0]) / BINS
    while (x[-1] - x[0]) / width >= BINS:
        width *= 2
    return width


def test_few_samples_are_all_there() -> None:
    x, y = np.arange(2.0 * BINS), walk(2 * BINS)
    for points, column in zip(envelope(x, y), y.T, strict=True):
        assert np.array_equal(points.x, x)
        assert np.array_equal(points.y, column)


@pytest.mark.parametrize("rows", [2 * BINS + 1, 5_000, 70_001])
def test_each_bin_has_exactly_the_first_lowest_highest_and_last_of_its_samples(rows: int) -> None:
    x = np.cumsum(np.random.default_rng(1).uniform(0.1, 2, rows))
    y = walk(rows)
    width = widths(x, rows)
    for points, column in zip(envelope(x, y), y.T, strict=True):
        owner, drawn = np.floor((x - x[0]) / width), np.floor((points.x - x[0]) / width)
        assert np.array_equal(np.unique(owner), np.unique(drawn))
        for index in np.unique(owner):
            samples, shown = column[owner == index], points.y[drawn == index]
            assert (shown.min(), shown.max()) == (samples.min(), samples.max())
            assert (shown[0], shown[-1]) == (samples[0], samples[-1])
        assert len(points.x) <= 4 * BINS
    assert BINS / 2 <= np.floor((x[-1] - x[0]) / width) < BINS


def test_blocks_change_nothing() -> None:
    x, y = np.arange(30_000) * 0.002, walk(30_000)
    y[100:900] = np.nan
    whole = envelope(x, y, len(x))
    for block in (1, 97, 4096):
        for one, other in zip(whole, envelope(x[: 8 * 97], y[: 8 * 97], block), strict=True) if block == 1 else ():
            assert len(other.x) <= len(one.x) + 8 * 97
        if block > 1:
            for one, other in zip(whole, envelope(x, y, block), strict=True):
                assert np.array_equal(one.x, other.x)
                assert np.array_equal(one.y, other.y, equal_nan=True)


def test_one_sample_among_a_million_is_kept() -> None:
    y = np.zeros((1_000_000, 1))
    y[654_321] = 7
    (points,) = envelope(np.arange(1e6), y, 50_000)
    assert np.flatnonzero(points.y == 7).size == 1
    assert abs(points.x[points.y == 7][0] - 654_321) <= 1e6 / (BINS / 2)


def test_a_gap_breaks_the_line_and_its_edges_stay() -> None:
    x, y = np.arange(10_000.0), walk(10_000, 1)
    y[4000:6000] = np.nan
    (points,) = envelope(x, y)
    gap = np.isnan(points.y)
    assert gap.sum() == 1
    assert points.x[np.flatnonzero(gap)[0] - 1] >= 3999 - 10_000 / BINS * 2
    assert np.nanmax(points.y) == np.nanmax(y)


def test_logarithmic_bins_are_of_equal_ratios() -> None:
    x = np.geomspace(1e-3, 1e3, 40_000)
    (points,) = envelope(x, walk(40_000, 1), log=True)
    steps = np.diff(np.log10(points.x))
    assert steps.max() < 6 / (BINS / 2) * 1.01
    assert len(points.x) > BINS


def test_a_jump_of_x_costs_bins_but_no_extremes() -> None:
    x = np.concatenate([np.arange(1000.0), 1e9 + np.arange(1000.0)])
    y = walk(2000, 1)
    (points,) = envelope(x, y)
    assert (points.y.min(), points.y.max()) == (y.min(), y.max())


@pytest.mark.parametrize("x", [np.zeros(5000), np.full(5000, 1e9)])
def test_x_that_stands_still_is_one_stroke(x: np.ndarray) -> None:
    y = walk(5000, 1)
    (points,) = envelope(x, y)
    assert set(points.x) == {x[0]}
    assert (points.y.min(), points.y.max()) == (y.min(), y.max())


def test_a_path_that_goes_back_keeps_its_order_and_its_extremes() -> None:
    angle = np.linspace(0, 60 * np.pi, 300_000)
    x, y = np.cos(angle), np.sin(angle)
    y[123_456] = 4
    made = Envelope(1, BINS)
    for start in range(0, len(x), 7_001):
        made.feed(x[start : start + 7_001], y[start : start + 7_001, None])
    (points,) = made.curves()
    assert not made.ascends
    assert len(points.x) <= GROUP * (GROUPS + 20)
    assert (points.x.min(), points.x.max(), points.y.max()) == (x.min(), x.max(), 4)
    on_circle = points.y < 2
    assert np.allclose(np.hypot(points.x, points.y)[on_circle], 1)
    steps = np.hypot(np.diff(points.x[on_circle]), np.diff(points.y[on_circle]))
    assert steps.max() < 0.09


@pytest.mark.parametrize(("rows", "block"), [(50, 10), (1000, 10), (1000, 1000), (30_000, 1000), (30_000, 10**6)])
def test_a_time_that_goes_back_breaks_the_line_there_alone(rows: int, block: int) -> None:
    x = np.concatenate([np.arange(float(rows))] * 3)
    y = np.repeat([1.0, 2.0, 3.0], rows)[:, None]
    (points,) = envelope(x, y, block, breaks=True)
    assert np.flatnonzero(np.isnan(points.y)).size == 2
    runs = np.split(points.y, np.flatnonzero(np.isnan(points.y)))
    assert [set(run[~np.isnan(run)]) for run in runs] == [{1}, {2}, {3}]


def test_memory_does_not_grow() -> None:
    def peak(rows: int) -> int:
        made, block = Envelope(4, 1024), np.random.default_rng(0).standard_normal((10_000, 4))
        tracemalloc.start()
        for start in range(0, rows, len(block)):
            made.feed(np.arange(start, start + len(block), dtype=float), block)
        made.curves()
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    assert peak(1_000_000) < 1.3 * peak(100_000)  # as more bins are in use


def visible_lines(x: np.ndarray, y: np.ndarray, low: float, high: float) -> list[tuple[float, ...]]:
    """The lines between successive samples that reach into a range of x."""
    lines = zip(x, y, x[1:], y[1:], strict=False)
    return [line for line in lines if not np.isnan(line).any() and _reaches(line, low, high)]


def _reaches(line: tuple[float, ...], low: float, high: float) -> bool:
    begin, end = sorted((line[0], line[2]))
    return begin <= high and end >= low


@given(
    x=st.lists(st.integers(-3, 8), max_size=14),
    cuts=st.lists(st.integers(0, 14), max_size=4).map(sorted),
    ascends=st.booleans(),
)
def test_a_window_keeps_every_line_that_reaches_into_it_and_blocks_have_no_effect(
    x: list[int], cuts: list[int], ascends: bool
) -> None:
    low, high = 1.0, 4.0
    places = np.array(sorted(x) if ascends else x, float)
    numbers = np.arange(len(x), dtype=float)[:, None]
    window, whole = XRangeFilter(low, high), XRangeFilter(low, high).feed(places, numbers)
    parts = [window.feed(*part) for part in zip(np.split(places, cuts), np.split(numbers, cuts), strict=True)]
    for joined, expected in zip(map(np.concatenate, zip(*parts, strict=True)), whole, strict=True):
        np.testing.assert_array_equal(joined, expected)
    kept = visible_lines(whole[0], whole[1][:, 0], low, high)
    assert kept == visible_lines(places, numbers[:, 0], low, high)
    assert np.isfinite(whole[1]).sum() <= 2 * len(kept) + ((places >= low) & (places <= high)).sum()
