"""Axes as matplotlib has them."""

from mjrun.plotting.study.axes import Box, Sheet, number_ticks, set_ticks
from mjrun.plotting.study.drawing import Scale
from mjrun.plotting.ticks import Ticks

BOX = Box(100, 50, 500, 350)


def test_axes_are_where_the_box_is_and_have_no_ticks_but_ours(sheet: Sheet) -> None:
    axes = sheet.axes(BOX)
    extent = axes.get_window_extent()
    assert (extent.x0, extent.x1, 480 - extent.y1, 480 - extent.y0) == (100, 500, 50, 350)
    assert len(axes.get_xticks()) == 0
    set_ticks(axes.xaxis, Ticks([0.25, 0.5], ["a", "b"]))
    assert [label.get_text() for label in axes.get_xticklabels()] == ["a", "b"]


def test_ticks_of_categories_are_their_names(sheet: Sheet) -> None:
    ticks = sheet.x_ticks(Scale("model", -0.5, 1.5, categories=("a.xml", "b.xml")), 400)
    assert (list(ticks.values), ticks.labels) == ([0, 1], ["a.xml", "b.xml"])
    assert sheet.tick_width(ticks) < 60


def test_ticks_are_within_the_axis() -> None:
    for log in (False, True):
        ticks = number_ticks(Scale("x", 0.01, 2.0, log), 6)
        assert 2 <= len(ticks.values) <= 10
        assert all(0.01 <= value <= 2 for value in ticks.values)


def test_labels_are_above_and_below(sheet: Sheet) -> None:
    sheet.title("speed", BOX, 400, "mass")
    sheet.x_label("friction", BOX)
    assert [text.get_text() for text in sheet.canvas.figure.texts] == ["speed", "↑ mass", "friction"]
