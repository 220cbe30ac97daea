"""Figures, by the artists that matplotlib has of them and by their pixels."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mjrun.options.plot import STYLES
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.figure_data import CurvePoints, DrawnCurve, DrawnFigure, DrawnPanel, Envelope, panel_grid
from mjrun.plotting.matplotlib_drawing import BESIDE, SMALLEST, CurveLabel, arranged, paint
from mjrun.plotting.matplotlib_layout import MatplotlibFigure, settings
from mjrun.plotting.theme import THEMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

TIME = np.linspace(0, 2, 50)


def panel(
    *names: str, label: str = "qpos [rad]", log: bool = False, marks: tuple[ReferenceLine, ...] = ()
) -> DrawnPanel:
    curves = [DrawnCurve(name, CurvePoints(TIME, np.sin(TIME + i) + 2), i) for i, name in enumerate(names)]
    return DrawnPanel(label, curves, log, marks)


def figure(
    *panels: DrawnPanel,
    size: tuple[int, int] | None = (640, 480),
    columns: int | None = None,
    style: str = "light",
    title: str = "",
    marks: tuple[ReferenceLine, ...] = (),
    log_x: bool = False,
) -> Figure:
    """A figure that is drawn; its artists know where they are."""
    most = max(len(each.curves) for each in panels)
    grid = panel_grid(len(panels), most, bool(title), size, columns)
    with settings(THEMES[style], grid.em), warnings.catch_warnings():
        warnings.simplefilter("error")
        canvas = MatplotlibFigure(grid, THEMES[style])
        paint(DrawnFigure(title, "time [s]", log_x, panels, marks), grid, canvas)
        canvas.pixels()
        return canvas.figure


def texts(made: Figure) -> list[Text]:
    from matplotlib.text import Text

    return [each for each in made.findobj(Text) if isinstance(each, Text) and each.get_text() and each.get_visible()]


def words(made: Figure) -> list[str]:
    return [each.get_text() for each in texts(made)]


def pixels(made: Figure) -> np.ndarray:
    return np.asarray(made.canvas.buffer_rgba())[:, :, :3].astype(int)  # type: ignore[attr-defined]


def boxes(made: Figure) -> np.ndarray:
    return np.array([axes.get_position().bounds for axes in made.axes])


def require_room(made: Figure) -> None:
    """Asserts that no text lies on another or leaves the figure."""
    width, height = made.get_size_inches() * made.dpi
    shown = [(each.get_text(), each.get_window_extent()) for each in texts(made)]
    for index, (text, box) in enumerate(shown):
        assert min(box.x0, box.y0, width - box.x1, height - box.y1) >= -1, text
        for other, second in shown[index + 1 :]:
            overlap = min(box.x1, second.x1) - max(box.x0, second.x0), min(box.y1, second.y1) - max(box.y0, second.y0)
            assert min(overlap) < 2.5, (text, other)


@pytest.mark.parametrize(("size", "count"), [((1280, 720), 1), ((320, 200), 6)])
def test_no_text_lies_on_another_or_leaves_the_figure(size: tuple[int, int], count: int) -> None:
    size = size[0], max(size[1], 80 * count)
    require_room(figure(*[panel("left_knee", "right_knee", "left_hip")] * count, size=size, title="A long title " * 4))


def test_panels_share_one_x_axis_and_are_aligned() -> None:
    made = figure(panel("a", "b"), panel("a_much_longer_name", "c", label="force"), panel("d"), size=(800, 600))
    places = boxes(made)
    assert len({tuple(place[[0, 2]]) for place in places.round(9)}) == 1
    assert {axes.get_xlim() for axes in made.axes} == {(0.0, 2.0)}
    assert words(made).count("time [s]") == 1
    assert [axes.get_title("left") for axes in made.axes] == ["qpos [rad]", "force", "qpos [rad]"]


def test_panels_side_by_side_have_one_width() -> None:
    made = figure(*[panel("a", "b")] * 4, panel("a_long_name", "b"), size=(900, 700), columns=2)
    places = boxes(made).round(9)
    assert len({*places[:, 2]}) == 1
    assert len({*places[:, 0]}) == 2
    assert places[4, 0] == places[0, 0]
    assert words(made).count("time [s]") == 2  # under the last of each column


def test_names_stand_beside_the_ends_of_their_curves_and_one_alone_needs_none() -> None:
    made = figure(panel("low", "high"), size=(640, 480))
    heights = {each.get_text(): each.get_window_extent().y0 for each in texts(made)}
    ends = {name: float((np.sin(TIME + i) + 2)[-1]) for i, name in enumerate(["low", "high"])}
    assert (heights["low"] < heights["high"]) == (ends["low"] < ends["high"])
    right = made.axes[0].get_window_extent().x1
    assert all(each.get_window_extent().x0 > right for each in texts(made) if each.get_text() in ends)
    assert "alone" not in words(figure(panel("alone")))


def test_a_legend_that_all_panels_have_stands_once() -> None:
    made = figure(panel("1", "2", label="angle"), panel("1", "2", label="energy"))
    assert words(made).count("2") == 1


@pytest.mark.parametrize("count", [12, 60])
def test_many_names_are_all_there(count: int) -> None:
    names = [f"joint_{i}" for i in range(count)]
    made = figure(panel(*names), size=(1280, 720))
    assert set(names) <= set(words(made))


@pytest.mark.parametrize(("length", "least", "most"), [(20, 0, 0.38), (42, 0.38, 0.5), (60, 0.3, 0.38)])
def test_a_legend_takes_half_of_a_panel_only_to_show_all_names_whole(length: int, least: float, most: float) -> None:
    names = [f"joint_{i:_>{length}}" for i in range(8)]
    made = figure(panel(*names), size=(640, 200))
    assert set(names).issubset(words(made)) is (length < 60)
    assert least < 1 - made.axes[0].get_position().x1 <= most


def test_curves_are_the_points_and_the_first_is_on_top() -> None:
    made = figure(panel("a", "b", "c"))
    lines = [line for line in made.axes[0].lines if np.size(line.get_xdata()) == len(TIME)]
    for i, line in enumerate(reversed(lines)):
        assert np.array_equal(line.get_ydata(), np.sin(TIME + i) + 2)


def test_a_value_between_two_gaps_is_a_dot() -> None:
    y = np.array([np.nan, 1, np.nan, 2, 3])
    made = figure(DrawnPanel("a", [DrawnCurve("a", CurvePoints(np.arange(5.0), y), 0)], False, ()))
    dots = [line for line in made.axes[0].lines if line.get_marker() == "o"]
    assert [np.asarray(line.get_ydata()).tolist() for line in dots] == [[1.0]]


def test_any_name_is_drawn_as_it_is_without_a_warning() -> None:
    plain = ["$x_1^2$", "a_b_{c", "$", "%s {x} \\alpha", "αβγ ωx m·g", "naïve éö Ł Ж —"]
    made = figure(panel(*plain, "😀", "a\nb\x1b[31m", "\u202eabc", label="$_$ \udcf6"), title="$x$ 位", size=(900, 700))
    assert not any(c in text for text in words(made) for c in "\n\x1b\u202e")
    assert {*plain, "$_$ \\udcf6", "$x$ \\u4f4d"} <= set(words(made))


def test_letters_that_the_font_lacks_are_reported_by_their_numbers() -> None:
    assert "\\u4f4d\\u7f6e" in words(figure(panel("位置", "速度")))


@pytest.mark.parametrize("value", [0.0, 87.356, -3e-7, 1e12, 1.0])
def test_a_constant_is_in_the_middle_of_a_range(value: float) -> None:
    y = np.full(50, value)
    y[::2] *= 1 + 1e-15  # as a quaternion's norm
    made = figure(DrawnPanel("a", [DrawnCurve("a", CurvePoints(TIME, y), 0)], False, ()))
    low, high = made.axes[0].get_ylim()
    assert low < value < high
    assert high - low >= 0.1 * abs(value)
    labels = [label.get_text() for label in made.axes[0].get_yticklabels()]
    assert len(set(labels)) == len(labels) > 1


def test_axes_have_no_offsets() -> None:
    y = 0.3 + 1e-5 * np.sin(TIME)
    made = figure(DrawnPanel("a", [DrawnCurve("a", CurvePoints(TIME, y), 0)], False, ()))
    labels = [label.get_text() for label in made.axes[0].get_yticklabels()]
    assert all(label.startswith("0.3") for label in labels)
    assert not made.axes[0].yaxis.get_offset_text().get_text()


def test_counts_have_whole_ticks() -> None:
    made = figure(DrawnPanel("n", [DrawnCurve("n", CurvePoints(TIME, np.arange(50) % 3.0), 0)], False, ()))
    assert [label.get_text() for label in made.axes[0].get_yticklabels()] == ["0", "1", "2"]


def test_logarithmic_axes_have_plain_labels() -> None:
    y = np.geomspace(1e-6, 1e3, 50)
    made = figure(DrawnPanel("f [N]", [DrawnCurve("f", CurvePoints(TIME + 1, y), 0)], True, ()), log_x=True)
    axes = made.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert "10⁻⁶" in words(made)
    assert not any("$" in text for text in words(made))


def test_marks_are_lines_with_labels() -> None:
    made = figure(
        panel("a", "b", marks=(ReferenceLine("m·g", 2.5),)),
        panel("a", "b"),
        marks=(ReferenceLine("hit", 0.5, True), ReferenceLine("off", 9, True)),
    )
    levels = [set(np.ravel(line.get_ydata())) for line in made.axes[0].lines]
    assert {2.5} in levels
    assert {2.5} not in [set(np.ravel(line.get_ydata())) for line in made.axes[1].lines]
    for axes in made.axes:
        assert any(set(np.ravel(line.get_xdata())) == {0.5} for line in axes.lines)
        assert axes.get_xlim() == (0, 2)
    assert words(made).count("m·g") == words(made).count("hit") == 1
    assert "off" not in words(made)


@pytest.mark.parametrize("style", STYLES)
def test_a_style_has_its_ground_and_its_curves(style: str) -> None:
    theme = THEMES[style]
    shown = pixels(figure(panel("a", "b"), style=style)).reshape(-1, 3)
    assert tuple(shown[0]) == theme.ground
    for index in range(2):
        assert (np.abs(shown - theme.colour(index)).max(axis=1) < 24).sum() > 100


@pytest.mark.parametrize("width", [640, 1920])
def test_one_sample_of_a_million_is_seen(width: int) -> None:
    rows = 1_000_000
    y = np.zeros((rows, 1))
    y[654_321] = 1
    made = Envelope(1, 1 << (2 * width - 1).bit_length())
    for start in range(0, rows, 50_000):
        made.feed(np.arange(start, start + 50_000) / 1000, y[start : start + 50_000])
    (points,) = made.curves()
    drawn = figure(DrawnPanel("a", [DrawnCurve("a", points, 0)], False, ()), size=(width, 400))
    box = drawn.axes[0].get_window_extent()
    column = round(box.x0 + 0.654321 * box.width)
    top, bottom = 400 - box.y1, 400 - box.y0
    strip = pixels(drawn)[round(top) : round(bottom), column - 2 : column + 3]
    ink = (np.abs(strip - THEMES["light"].colour(0)).max(axis=2) < 90).any(axis=1)
    assert ink.mean() > 0.8


def test_a_figure_without_any_value_is_empty_and_not_an_error() -> None:
    gap = np.full(3, np.nan)
    made = figure(DrawnPanel("a", [DrawnCurve("a", CurvePoints(np.arange(3.0), gap), 0)], True, ()))
    from matplotlib.axes import Axes

    assert isinstance(made.axes[0], Axes)


LINE = 10.0


def entries(heights: list[float]) -> list[CurveLabel]:
    from matplotlib.lines import Line2D

    return [CurveLabel(str(i), Line2D([], []), y) for i, y in enumerate(heights)]


@pytest.mark.parametrize("heights", [[50, 51, 52], [0, 0, 100, 100], [99, 1, 50], [50] * BESIDE, [-40, 140]])
def test_names_are_a_line_apart_in_the_order_of_their_heights(heights: list[float]) -> None:
    (column,), scale = arranged(entries(heights), 0, 100, LINE)
    places = np.array([entry.y for entry in column])
    assert np.all(np.diff(places) >= LINE - 1e-9)
    assert places[0] >= LINE / 2 - 1e-9
    assert places[-1] <= 100 - LINE / 2 + 1e-9
    assert [heights[int(entry.name)] for entry in column] == sorted(heights)
    assert scale == 1


def test_a_name_that_has_room_stands_where_its_curve_ends_and_of_equal_ones_the_first_is_above() -> None:
    assert [entry.y for entry in arranged(entries([20, 60, 85]), 0, 100, LINE)[0][0]] == [20, 60, 85]
    assert [entry.name for entry in arranged(entries([50, 50]), 0, 100, LINE)[0][0]] == ["1", "0"]
    assert arranged([], 0, 100, LINE) == ([], 1)


@pytest.mark.parametrize("bottom", np.linspace(0, 100, 7))
def test_names_that_fit_exactly_are_in_one_column(bottom: float) -> None:
    assert len(arranged(entries([50.0] * 12), bottom, bottom + 98.7, LINE)[0]) == 1


@pytest.mark.parametrize("count", [7, 12, 30, 100])
def test_many_names_are_in_their_own_order_in_columns_that_fit(count: int) -> None:
    columns, scale = arranged(entries([50.0] * count), 0, 100, LINE)
    assert [entry.name for column in columns for entry in column] == [str(i) for i in range(count)]
    assert SMALLEST <= scale <= 1
    for column in columns:
        places = [entry.y for entry in column]
        assert 0 <= min(places) < max(places) <= 100
        assert all(a - b >= scale * LINE - 1e-9 for a, b in pairwise(places))
