"""Axes of figures of tables and of studies."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import BadValueError
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.figure_data import (
    GROUP,
    GROUPS,
    MARGIN,
    AxisScale,
    CurvePoints,
    DrawnCurve,
    DrawnFigure,
    DrawnPanel,
    Envelope,
    XRangeFilter,
    scale,
)
from mjrun.plotting.study.figure_data import (
    DrawnStudyFigure,
    GraphPanel,
    ParallelCoordinatesPanel,
    SensitivityPanel,
    cell_scale,
    is_even_in_ratios,
    is_geometric,
    spans_decades,
    study_grid,
)

BINS = 64


def panel(*values: float, log: bool = False, marks: tuple[float, ...] = ()) -> DrawnPanel:
    points = CurvePoints(np.arange(float(len(values))), np.array(values, float))
    return DrawnPanel("a", [DrawnCurve("a", points, 0)], log, [ReferenceLine("m", value) for value in marks])


def y_range(panel: DrawnPanel) -> tuple[float, float]:
    return panel.y.low, panel.y.high


@pytest.mark.parametrize("values", [(1, 2), (-5, 5), (0.3, 0.300001), (1e-30, 2e-30), (1e200, -1e200), (0, np.nan, 1)])
def test_a_range_is_that_of_the_values_and_a_little_more(values: tuple[float, ...]) -> None:
    low, high = y_range(panel(*values))
    least, most = np.nanmin(values), np.nanmax(values)
    assert low < least
    assert high > most
    assert high - low < 1.2 * (most - least)


@pytest.mark.parametrize("value", [0.95, 87.356, -1e-9, 1e300])
@pytest.mark.parametrize("log", [False, True])
def test_a_constant_is_in_the_middle(value: float, log: bool) -> None:
    if log and value <= 0:
        return
    low, high = y_range(panel(value, value * (1 + 1e-15), log=log))
    assert low < value < high
    middle = np.sqrt(low) * np.sqrt(high) if log else low / 2 + high / 2
    assert np.isclose(middle, value)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_constant_that_may_be_a_share_has_an_axis_of_shares(value: float) -> None:
    axis = scale("success", np.array([value, value, np.nan]), edge=0.0)
    assert (axis.low, axis.high) == (0, 1)
    low, high = y_range(panel(value, value))
    assert (low, high) == pytest.approx((-0.06, 1.06))


def test_marks_are_within_the_range() -> None:
    low, high = y_range(panel(1, 2, marks=(10,)))
    assert low < 1 < 10 < high
    assert panel(1, 2, log=True, marks=(-10,)).y == panel(1, 2, log=True).y


def test_x_is_from_the_first_to_the_last_sample() -> None:
    drawing = DrawnFigure("", "t", False, [panel(1, 2, 3), panel(1, 2, 3, 4)], [ReferenceLine("m", 99, vertical=True)])
    wide = replace(drawing, x_margin=0.1).x
    assert drawing.x == AxisScale("t", 0, 3, whole=True)
    assert (wide.low, wide.high) == pytest.approx((-0.3, 3.3))
    assert DrawnFigure("", "t", False, [panel(1)], []).x == AxisScale("t", -0.5, 0.5, whole=True)
    assert DrawnFigure("", "t", True, [panel()], []).x == AxisScale("t", 0.1, 1, True)
    assert DrawnFigure("", "t", False, [panel()], []).x == AxisScale("t", 0, 1)


def test_counts_are_whole_and_nothing_else_is() -> None:
    assert panel(0, 3, np.nan).y.whole
    assert not panel(0, 0.5).y.whole
    assert DrawnFigure("", "seed", False, [panel(0.5)], []).x.whole
    assert scale("seed", np.array([0.0, 19, np.nan]), edge=0.1).whole
    assert not scale("mass", np.array([0.0, 0.5]), edge=0.1).whole


def test_shares_are_where_matplotlib_puts_values() -> None:
    values = np.array([0.01, 0.1, 10])
    axis = scale("x", values, log=True, edge=0.1)
    np.testing.assert_allclose(axis.shares(values), (np.log10(values) + 2.3) / 3.6)
    axis = scale("x", values, edge=0.1)
    np.testing.assert_allclose(axis.shares(values), (values - 0.01 + 0.999) / (1.2 * 9.99))


@pytest.mark.parametrize(("log", "values"), [(False, [3.0, 3.0]), (True, [3.0]), (False, [np.nan]), (True, [-1.0])])
def test_an_axis_of_what_is_the_same_or_missing_has_a_range(log: bool, values: list[float]) -> None:
    axis = scale("x", np.array(values), log=log, edge=0.05)
    assert axis.low < axis.high
    assert not axis.log or axis.low > 0


@pytest.mark.parametrize(("low", "high"), [(1e-300, 1e300), (5e-324, 1.0), (1.0, 1.7e308), (1e-320, 1e-320)])
def test_a_logarithmic_axis_has_finite_ends_however_far_the_values_are_apart(low: float, high: float) -> None:
    y = scale("y", np.array([low, high]), log=True, edge=0.06)
    curve = DrawnCurve("a", CurvePoints(np.array([low, high]), np.ones(2)), 0)
    x = DrawnFigure("", "x", True, [DrawnPanel("a", [curve], False, [])], [], x_margin=0.06).x
    for axis in (x, y):
        assert 0 < axis.low <= low <= high <= axis.high < np.inf
        assert axis.low < axis.high


def test_categories_stand_at_whole_numbers() -> None:
    axis = scale("model", np.array([0.0, 1.0]), categories=("a", "b"), edge=0.1)
    np.testing.assert_allclose(axis.shares(np.array([0, 1])), [0.25, 0.75])


def test_equal_ratios_are_found() -> None:
    assert is_geometric(np.geomspace(1e-4, 1e-1, 7))
    assert not is_geometric(np.linspace(1, 10, 7))
    assert not is_geometric(np.array([0.0, 1, 10]))
    for factor in (1, 1e3):
        assert is_even_in_ratios(factor * np.geomspace(1e-3, 1, 100))
        assert not is_even_in_ratios(factor * np.linspace(1e-3, 1, 100))


def test_values_over_decades_are_found() -> None:
    assert spans_decades(np.geomspace(1e-9, 1e-3, 20))
    assert not spans_decades(np.linspace(1, 50, 20))
    assert not spans_decades(np.array([-1, 1e-9, 1e-3, 5]))


def test_cells_are_around_their_values_when_they_are_many() -> None:
    few = cell_scale("x", np.arange(3.0), ["0", "1", "2"])
    assert few.categories == ["0", "1", "2"]
    many = cell_scale("x", np.linspace(0, 1, 11), [""] * 11)
    assert (many.low, many.high, many.log) == (pytest.approx(-0.05), pytest.approx(1.05), False)
    ratios = cell_scale("x", np.geomspace(1, 1024, 11), [""] * 11)
    assert (ratios.low, ratios.high, ratios.log) == (pytest.approx(2**-0.5), pytest.approx(2**10.5), True)
    uneven = cell_scale("x", np.arange(10.0) ** 2, list("abcdefghij"))
    assert uneven.categories == list("abcdefghij")


def test_the_axis_of_a_metric_has_a_margin_and_colours_have_none() -> None:
    values = np.array([1.0, 2, np.nan])
    axis, colours = (scale("z", values, edge=edge) for edge in (MARGIN, 0.0))
    assert axis.low < 1 < 2 < axis.high
    assert colours == AxisScale("z", 1, 2, whole=True)


GRAPH = GraphPanel(AxisScale("x", 0, 1), AxisScale("z", 0, 1), [], [])


def test_panels_have_the_columns_that_suit_or_those_asked_for() -> None:
    assert study_grid(DrawnStudyFigure("", [GRAPH] * 2), None).columns == 1
    assert study_grid(DrawnStudyFigure("", [GRAPH] * 6), None).columns == 3
    assert study_grid(DrawnStudyFigure("", [GRAPH] * 4), None).columns == 2
    assert study_grid(DrawnStudyFigure("", [GRAPH] * 6), (640, 2000)).columns == 1
    assert study_grid(DrawnStudyFigure("", [GRAPH] * 6, columns=2), None).columns == 2


def test_parallel_coordinates_take_room_above() -> None:
    ranks = SensitivityPanel("z", ["a"], np.array([0.5]), np.array([0.5]))
    above = ParallelCoordinatesPanel([], np.empty((0, 0)), np.empty(0, bool))
    grid = study_grid(DrawnStudyFigure("", [ranks] * 3, 3, above), None)
    assert (grid.columns, grid.rows) == (3, 2)


def test_a_size_too_small_is_reported() -> None:
    with pytest.raises(BadValueError, match="at least"):
        study_grid(DrawnStudyFigure("", [GRAPH] * 4), (100, 100))


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


def test_x_that_grows_beyond_all_proportion_is_drawn() -> None:
    x = np.concatenate([np.full(300, 1e-300), [1.0, 2.0]])
    y = walk(302, 1)
    (points,) = envelope(x, y)
    assert (points.x[0], points.x[-1]) == (1e-300, 2.0)
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
