"""Names stand beside the ends of their curves, and never on each other."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.lines import Line2D

from mjrun.plotting.canvas import Canvas
from mjrun.plotting.legend import BESIDE, SMALLEST, Entry, Legend, legend_rows
from mjrun.plotting.theme import THEMES

LINE = 10.0
CANVAS = Canvas((640, 480), THEMES["light"], False)


def entries(heights: list[float]) -> list[Entry]:
    return [Entry(str(i), Line2D([], []), y) for i, y in enumerate(heights)]


@pytest.mark.parametrize("heights", [[50, 51, 52], [0, 0, 100, 100], [99, 1, 50], [50] * BESIDE, [-40, 140]])
def test_names_are_a_line_apart_in_the_order_of_their_heights(heights: list[float]) -> None:
    rows = legend_rows(entries(heights), 0, 100, LINE)
    (column,) = rows.columns
    places = np.array([entry.y for entry in column])
    assert np.all(np.diff(places) >= LINE - 1e-9)
    assert places[0] >= LINE / 2 - 1e-9
    assert places[-1] <= 100 - LINE / 2 + 1e-9
    assert [heights[int(entry.name)] for entry in column] == sorted(heights)
    assert rows.scale == 1


def test_a_name_that_has_room_stands_where_its_curve_ends() -> None:
    (column,) = legend_rows(entries([20, 60, 85]), 0, 100, LINE).columns
    assert [entry.y for entry in column] == [20, 60, 85]


@pytest.mark.parametrize("top", np.linspace(0, 100, 7))
def test_names_that_fit_exactly_are_in_one_column(top: float) -> None:
    assert len(legend_rows(entries([50.0] * 12), top, top + 98.7, LINE).columns) == 1


@pytest.mark.parametrize("count", [7, 12, 30, 100])
def test_many_names_are_in_their_own_order_in_columns_that_fit(count: int) -> None:
    rows = legend_rows(entries([50.0] * count), 0, 100, LINE)
    assert [entry.name for column in rows.columns for entry in column] == [str(i) for i in range(count)]
    assert SMALLEST <= rows.scale <= 1
    for column in rows.columns:
        places = [entry.y for entry in column]
        assert min(places) >= 0
        assert max(places) <= 100
        assert all(b - a >= rows.scale * LINE - 1e-9 for a, b in pairwise(places))


@pytest.mark.parametrize("count", [1, 6, 40])
def test_a_legend_has_no_more_than_its_room(count: int) -> None:
    long = [Entry(f"a_very_long_name_of_a_joint_{i}", Line2D([], []), 50.0) for i in range(count)]
    assert 0 < Legend(CANVAS, long, (0, 200), 150, 12).width <= 150 + 12
    assert Legend(CANVAS, [], (0, 200), 150, 12).width == 0
