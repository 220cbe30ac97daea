"""Axes of figures of tables and of studies."""

from dataclasses import replace

import numpy as np
import pytest

from mjrun.errors import BadValueError
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.figure_data import MARGIN, CurvePoints, DrawnCurve, DrawnFigure, DrawnPanel, ParameterAxis, scale
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


@pytest.mark.parametrize("value", [0.0, 87.356, -1e-9, 1e300])
@pytest.mark.parametrize("log", [False, True])
def test_a_constant_is_in_the_middle(value: float, log: bool) -> None:
    if log and value <= 0:
        return
    low, high = y_range(panel(value, value * (1 + 1e-15), log=log))
    assert low < value < high
    middle = np.sqrt(low) * np.sqrt(high) if log else low / 2 + high / 2
    assert np.isclose(middle, value)


def test_marks_are_within_the_range() -> None:
    low, high = y_range(panel(1, 2, marks=(10,)))
    assert low < 1 < 10 < high
    assert panel(1, 2, log=True, marks=(-10,)).y == panel(1, 2, log=True).y


def test_x_is_from_the_first_to_the_last_sample() -> None:
    drawing = DrawnFigure("", "t", False, [panel(1, 2, 3), panel(1, 2, 3, 4)], [ReferenceLine("m", 99, vertical=True)])
    wide = replace(drawing, x_margin=0.1).x
    assert drawing.x == ParameterAxis("t", 0, 3, whole=True)
    assert (wide.low, wide.high) == pytest.approx((-0.3, 3.3))
    assert DrawnFigure("", "t", False, [panel(1)], []).x == ParameterAxis("t", -0.5, 0.5, whole=True)
    assert DrawnFigure("", "t", True, [panel()], []).x == ParameterAxis("t", 0.1, 1, True)
    assert DrawnFigure("", "t", False, [panel()], []).x == ParameterAxis("t", 0, 1)


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
    assert colours == ParameterAxis("z", 1, 2, whole=True)


GRAPH = GraphPanel(ParameterAxis("x", 0, 1), ParameterAxis("z", 0, 1), [], [])


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
