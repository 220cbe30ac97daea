"""Curves, bands and marks, read back from matplotlib."""

from typing import Any

import numpy as np

from mjrun.plotting.study.axes import Box, Sheet
from mjrun.plotting.study.drawing import Band, Failures, GraphPanel, Scale, Series
from mjrun.plotting.study.graph import draw_graph, graph_key

X, Y = np.array([0.0, 1, 2]), np.array([1.0, 3, 2])
BANDS = [Band(Y - 1, Y + 1), Band(Y - 0.5, Y + 0.5)]
FAILURES = [Failures("unstable", np.array([2.0, 2.0])), Failures("crashed", np.array([1.0]))]
SCALES = Scale("mass", -0.1, 2.1), Scale("z", 0, 4)


def test_a_curve_its_bands_and_failures_are_where_they_should_be(sheet: Sheet) -> None:
    panel = GraphPanel(*SCALES, [Series("", X, Y, BANDS)], FAILURES)
    draw_graph(sheet, panel, Box(50, 50, 600, 400), lowest=True)
    (axes,) = sheet.canvas.figure.axes
    assert any(np.array_equal(line.get_xydata(), np.column_stack([X, Y])) for line in axes.lines)
    collections: list[Any] = [*axes.collections]
    bands, rugs = collections[:2], collections[2:]
    for band, drawn in zip(BANDS, bands, strict=True):
        (path,) = drawn.get_paths()
        corners = {tuple(vertex) for vertex in np.asarray(path.vertices).tolist()}
        assert {*zip(X, band.low, strict=True), *zip(X, band.high, strict=True)} <= corners
    assert [[s[0][0] for s in rug.get_segments()] for rug in rugs] == [[2, 2], [1]]
    assert all(segment[0][1] == 0 for rug in rugs for segment in rug.get_segments())


def test_categories_are_dots_with_lines(sheet: Sheet) -> None:
    axis = Scale("model", -0.5, 2.5, categories=("a", "b", "c"))
    draw_graph(
        sheet,
        GraphPanel(axis, SCALES[1], [Series("", X, Y, BANDS, joined=False)], []),
        Box(50, 50, 600, 400),
        lowest=True,
    )
    (axes,) = sheet.canvas.figure.axes
    assert len(axes.collections) == 2
    assert [label.get_text() for label in axes.get_xticklabels()] == ["a", "b", "c"]


def test_the_key_names_lines_bands_and_each_status_with_its_number(sheet: Sheet) -> None:
    series = [Series("model = a", X, Y, BANDS), Series("model = b", X, Y, BANDS, colour=1)]
    names = [entry.name for entry in graph_key(sheet, [GraphPanel(*SCALES, series, FAILURES)])]
    assert names == ["model = a", "model = b", "median", "5–95 %", "25–75 %", "unstable: 2 points", "crashed: 1 point"]
    assert graph_key(sheet, [GraphPanel(*SCALES, [Series("", X, Y)], [])]) == []
