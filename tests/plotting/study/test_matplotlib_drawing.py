"""Figures of studies, read back from matplotlib's artists and from pixels."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mjrun.plotting.figure_data import AxisScale
from mjrun.plotting.matplotlib_layout import WHOLE, MatplotlibFigure, settings
from mjrun.plotting.study.figure_data import (
    DrawnStudyFigure,
    FailedPoints,
    GraphPanel,
    HeatmapPanel,
    ParallelCoordinatesPanel,
    QuantileBand,
    SensitivityPanel,
    Series,
    in_turn,
    study_grid,
)
from mjrun.plotting.study.matplotlib_drawing import BANDS as BAND_NAMES
from mjrun.plotting.study.matplotlib_drawing import COLOUR_MAP, paint_study
from mjrun.plotting.theme import THEMES
from tests.plotting.test_matplotlib_drawing import require_room, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

X, Y = np.array([0.0, 1, 2]), np.array([1.0, 3, 2])
BANDS = [QuantileBand(Y - 1, Y + 1), QuantileBand(Y - 0.5, Y + 0.5)]
FAILURES = [FailedPoints("unstable", np.array([2.0, 2.0])), FailedPoints("crashed", np.array([1.0]))]
MASS, Z = AxisScale("mass", -0.1, 2.1), AxisScale("z", 0, 4)
GRAPH = GraphPanel(MASS, Z, [Series("", X, Y, BANDS)], FAILURES)
OTHER = GraphPanel(AxisScale("w", 0, 3), Z, [Series("", X, Y)], [])
VALUES = np.array([[1.0, 2, np.nan], [4, 5, np.nan]])
FAILED = np.array([[False, False, True], [False, False, False]])
CATEGORIES = AxisScale("mass", -0.5, 2.5, categories=("1", "2", "3"))
HEAT = HeatmapPanel("z", CATEGORIES, AxisScale("friction", 0, 2), VALUES, FAILED, AxisScale("z", 1, 5))
RANK = SensitivityPanel("z", ["mass", "friction", "none"], np.array([-0.99, 0.5, np.nan]), np.array([0.9, 0.6, np.nan]))
SCALES = [
    AxisScale("mass", 0, 2),
    AxisScale("model", -0.5, 1.5, categories=("a", "b")),
    AxisScale("z", 0.1, 10, log=True),
]
POINTS = np.array([[1.0, 1, np.nan], [0.5, 0, 1.0]])
ABOVE = ParallelCoordinatesPanel(SCALES, POINTS, np.isnan(POINTS[:, 2]))

DRAWINGS = {
    "curves": DrawnStudyFigure("A title " * 9, [GRAPH, GRAPH]),
    "scatter": DrawnStudyFigure("", [GRAPH, OTHER, GRAPH, OTHER], 2),
    "maps": DrawnStudyFigure("", [HEAT, HEAT]),
    "parallel": DrawnStudyFigure("A title", [RANK], 1, ABOVE),
}


def figure(
    drawing: DrawnStudyFigure, size: tuple[int, int] | None = (640, 480), style: str = "light"
) -> tuple[Figure, Any]:
    """The figure of a study, and its pixels."""
    grid = study_grid(drawing, size)
    with settings(THEMES[style], grid.em), warnings.catch_warnings():
        warnings.simplefilter("error")
        canvas = MatplotlibFigure(grid, THEMES[style])
        paint_study(drawing, grid, canvas)
        return canvas.figure, canvas.pixels()


def pixel(made: tuple[Figure, np.ndarray], axes: Axes, x: float, y: float) -> np.ndarray:
    """The colour at a place of axes."""
    across, up = axes.transData.transform((x, y))
    return made[1][made[1].shape[0] - 1 - int(up), int(across)].astype(int)


@pytest.mark.parametrize(("name", "size"), [*((name, (320, 320)) for name in DRAWINGS), ("parallel", None)])
def test_texts_have_room(name: str, size: tuple[int, int] | None) -> None:
    made, drawn = figure(DRAWINGS[name], size, "dark")
    edges = np.concatenate([drawn[0], drawn[-1], drawn[:, 0], drawn[:, -1]])
    assert (edges == THEMES["dark"].ground).all()
    require_room(made)


def test_x_axes_that_are_the_same_are_labelled_once() -> None:
    curves, scatter = (words(figure(DRAWINGS[name], (900, 700))[0]) for name in ("curves", "scatter"))
    assert curves.count("mass") == 1
    assert (scatter.count("mass"), scatter.count("w")) == (1, 1)


def test_any_name_is_drawn() -> None:
    axis = AxisScale("b\udcf6", 0, 2)
    for panel in (replace(GRAPH, x=axis, y=axis), replace(HEAT, label="a\udcf6", columns=axis, rows=axis)):
        assert "b\\udcf6" in words(figure(DrawnStudyFigure("", [panel]))[0])


def test_a_curve_its_bands_and_failures_are_where_they_should_be() -> None:
    (axes,) = figure(DrawnStudyFigure("", [GRAPH]))[0].axes
    assert any(np.array_equal(line.get_xydata(), np.column_stack([X, Y])) for line in axes.lines)
    bands: list[Any] = [*axes.collections]
    for band, drawn in zip(BANDS, bands, strict=True):
        (path,) = drawn.get_paths()
        corners = {tuple(vertex) for vertex in np.asarray(path.vertices).tolist()}
        assert {*zip(X, band.low, strict=True), *zip(X, band.high, strict=True)} <= corners
    rugs = [
        np.ravel(line.get_xdata()).tolist() for line in axes.lines if line.get_transform() == axes.get_xaxis_transform()
    ]
    assert rugs == [[2, 2], [1]]


def test_every_one_of_coinciding_lines_is_visible() -> None:
    series = [Series(f"line {i}", X, Y, dots=False, colour=i) for i in range(3)]
    panel = GraphPanel(MASS, Z, in_turn(series, Z), [])
    pixels = figure(DrawnStudyFigure("", [panel]))[1][100:].reshape(-1, 3)  # below the key
    shown = [np.count_nonzero((pixels == THEMES["light"].colour(i)).all(axis=1)) for i in range(3)]
    assert min(shown) > 0.5 * max(shown)


def test_categories_are_dots_with_lines() -> None:
    axis = AxisScale("model", -0.5, 2.5, categories=("a", "b", "c"))
    (axes,) = figure(DrawnStudyFigure("", [GraphPanel(axis, Z, [Series("", X, Y, BANDS, joined=False)], [])]))[0].axes
    assert len(axes.collections) == 2
    assert [label.get_text() for label in axes.get_xticklabels()] == ["a", "b", "c"]


@pytest.mark.parametrize(("count", "shown"), [(WHOLE, WHOLE), (40, 10)])
def test_many_categories_have_some_of_their_names_and_few_have_shorter_ones(count: int, shown: int) -> None:
    names = [f"a_model_with_a_name_{i}.xml" for i in range(count)]
    axis = AxisScale("model", -0.5, count - 0.5, categories=names)
    (axes,) = figure(DrawnStudyFigure("", [GraphPanel(axis, Z, [Series("", X, Y, joined=False)], [])]), (1280, 480))[
        0
    ].axes
    labels = [label.get_text() for label in axes.get_xticklabels()]
    assert 1 < len(labels) <= shown
    assert (labels[0] == names[0]) == (count > WHOLE)


def keyed(size: tuple[int, int], *panels: GraphPanel | HeatmapPanel, title: str = "") -> tuple[list[str], float]:
    """The names in the key of a figure, and the height of the key [pixels]."""
    (legend,) = figure(DrawnStudyFigure(title, panels), size)[0].legends
    return [text.get_text() for text in legend.get_texts()], legend.get_window_extent().height


def test_the_key_names_lines_bands_and_each_status_with_its_number() -> None:
    series = [Series("model = a", X, Y, BANDS), Series("_b", X, Y, BANDS, colour=1)]
    names, one = keyed((900, 480), GraphPanel(MASS, Z, series, FAILURES))
    assert names == ["model = a", "_b", "median", *BAND_NAMES, "unstable: 2 points", "crashed: 1 point"]
    assert keyed((320, 480), GraphPanel(MASS, Z, series, FAILURES))[1] > 2 * one * 0.6
    assert keyed((900, 480), HEAT, title="A title")[0] == ["every point failed", "no value"]
    assert figure(DrawnStudyFigure("", [OTHER]))[0].legends == []


def test_every_cell_has_the_colour_of_its_value_and_the_bar_shows_all() -> None:
    import matplotlib

    made = figure(DrawnStudyFigure("", [HEAT]))
    axes, bar = made[0].axes
    for (row, column), value in np.ndenumerate(VALUES[:, :2]):
        expected = np.round(np.array(matplotlib.colormaps[COLOUR_MAP]((value - 1) / 4)[:3]) * 255)
        assert abs(pixel(made, axes, column, row + 0.15) - expected).max() <= 2  # below its number
    hatched, empty = (
        np.unique([pixel(made, axes, x, y) for x in np.linspace(1.6, 2.4, 40)], axis=0) for y in (0.5, 1.5)
    )
    assert (len(hatched) > 3, len(empty)) == (True, 1)
    assert bar.get_ylim() == (1, 5)


def test_a_logarithmic_grid_is_drawn_in_equal_cells() -> None:
    values = np.array([[1.0, 10]])
    scales = AxisScale("x", 1, 100, log=True), AxisScale("y", 0, 1)
    made = figure(
        DrawnStudyFigure("", [HeatmapPanel("z", *scales, values, values < 0, AxisScale("z", 1, 10, log=True))])
    )
    axes = made[0].axes[0]
    left, middle, right = (pixel(made, axes, x, 0.5) for x in (1.1, 9.5, 10.5))
    assert (left == middle).all()
    assert (middle != right).any()


def test_bars_are_as_long_as_correlations_and_say_so_at_the_other_side() -> None:
    axes = figure(DrawnStudyFigure("", [RANK]))[0].axes[0]
    bars: list[Any] = [*axes.patches]
    assert [bar.get_width() for bar in bars] == [-0.99, 0.5, 0]
    assert [text.get_text() for text in axes.texts] == ["−0.99", "+0.50", "–"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["mass", "friction", "none"]
    zero = axes.transData.transform((0, 0))[0]
    low, high, _ = (text.get_window_extent() for text in axes.texts)
    assert high.x1 < zero < low.x0


def test_intervals_are_lines_of_their_length_and_numbers_are_a_column_beside_the_names() -> None:
    from matplotlib.collections import LineCollection

    intervals = np.array([[[-0.2, 0.3], [0.6, 1]], [[0.1, 0.4], [np.nan, np.nan]]])
    bars, rings = np.array([-2e-14, 0.8]), np.array([0.2, 0.9])
    panel = SensitivityPanel("z", ["a", "b"], bars, rings, ("first", "total"), "share", (-0.6, 1.1), intervals)
    made, _ = figure(DrawnStudyFigure("", [panel]))
    axes = made.axes[0]
    segments = [line for each in axes.collections if isinstance(each, LineCollection) for line in each.get_segments()]
    assert [[x for x, _ in line] for line in segments if len(line)] == [[-0.2, 0.3], [0.6, 1], [0.1, 0.4]]
    assert [text.get_text() for text in axes.texts] == ["0", "0.8"]
    edge, low = (axes.transData.transform((x, 0))[0] for x in (-0.6, -0.2))
    boxes = [text.get_window_extent() for text in axes.texts]
    assert boxes[0].x0 == pytest.approx(boxes[1].x0)
    assert edge < boxes[1].x0 < boxes[1].x1 < low
    assert "confidence interval" in words(made)


def test_names_take_a_part_of_the_figure_at_most_and_stand_before_the_first_panel_alone() -> None:
    long = SensitivityPanel("z", ["m" * 200], np.array([0.5]), np.array([0.5]))
    first, second = figure(DrawnStudyFigure("", [long, long], 2), (640, 300))[0].axes
    assert first.get_position().x0 < 0.36
    assert [label.get_text() for label in second.get_yticklabels()] == [""]


def test_a_line_is_at_the_share_of_each_axis_and_failed_ones_end_before_the_metric() -> None:
    from matplotlib.collections import LineCollection

    made, _ = figure(DrawnStudyFigure("", [RANK], 1, ABOVE))
    failed, good = (c for c in made.axes[0].collections if isinstance(c, LineCollection))
    (line,) = failed.get_segments()
    assert [y for _, y in line] == [0.5, 0.75]
    (line,) = good.get_segments()
    np.testing.assert_allclose([y for _, y in line], [0.25, 0.25, 0.5])
    assert {"mass", "model", "z", "a", "b"} <= set(words(made))
    assert made.axes[1].get_ylim() == pytest.approx((0.1, 10))


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (
            ("geom/right_lower_foot.friction[0]", "geom/right_lower_hand.friction[0]"),
            {"right_lower_foot", "right_lower_hand"},
        ),
        (("geom/a.x", "geom/b.x"), {"geom/a.x", "geom/b.x"}),
    ],
)
def test_names_without_room_lose_what_all_of_them_share(names: tuple[str, ...], shown: set[str]) -> None:
    scales = [*(AxisScale(name, 0, 1) for name in names), SCALES[-1]]
    above = ParallelCoordinatesPanel(scales, np.full((1, len(scales)), 0.5), np.array([False]))
    assert shown <= set(words(figure(DrawnStudyFigure("", [RANK], 1, above), (320, 400))[0]))


def test_values_are_written_into_cells_that_have_room() -> None:
    def written(values: np.ndarray, size: tuple[int, int]) -> dict[tuple[float, float], str]:
        scales = AxisScale("x", 0, values.shape[1]), AxisScale("y", 0, values.shape[0])
        panel = HeatmapPanel("z", *scales, values, np.isnan(values), AxisScale("z", 1, 9))
        axes = figure(DrawnStudyFigure("", [panel]), size)[0].axes[0]
        return {text.get_position(): text.get_text() for text in axes.texts}

    values = np.array([[1.25, np.nan], [4, 9]])
    assert written(values, (640, 480)) == {(0.5, 0.5): "1.25", (0.5, 1.5): "4.00", (1.5, 1.5): "9.00"}
    assert written(np.full((4, 30), 1.25), (640, 480)) == {}
    assert written(np.full((8, 8), 1.2345), (200, 200)) == {}
