"""Figures of studies: the same bytes again, and everything in them."""

import numpy as np
import pytest

from mjrun.plotting.canvas import settings
from mjrun.plotting.study.drawing import GraphPanel, HeatPanel, ParallelPanel, RankPanel, Scale, Series, StudyDrawing
from mjrun.plotting.study.figure import draw_study
from mjrun.plotting.study.grid import study_grid
from mjrun.plotting.theme import THEMES

X = np.arange(4.0)
GRAPH = GraphPanel(Scale("x", 0, 3), Scale("z", 0, 3), [Series("", X, X)], [])
OTHER = GraphPanel(Scale("w", 0, 3), Scale("z", 0, 3), [Series("", X, X)], [])
VALUES = np.arange(4.0).reshape(2, 2)
HEAT = HeatPanel("z", Scale("a", 0, 2), Scale("b", 0, 2), VALUES, VALUES < 0, Scale("z", 0, 3))
RANK = RankPanel("z", ["a", "b"], np.array([0.5, -0.2]))
ABOVE = ParallelPanel([Scale("a", 0, 3), Scale("b", 0, 3), Scale("z", 0, 3)], np.ones((5, 3)), np.zeros(5, bool))

DRAWINGS = {
    "curves": StudyDrawing("A title", [GRAPH, GRAPH]),
    "scatter": StudyDrawing("", [GRAPH, OTHER, GRAPH, OTHER], 2),
    "maps": StudyDrawing("", [HEAT, HEAT]),
    "parallel": StudyDrawing("", [RANK], 1, ABOVE),
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_figure_is_the_same_pixels_again_and_within_its_edges(name: str) -> None:
    drawing = DRAWINGS[name]
    grid = study_grid(drawing, (640, 480))
    with settings():
        first, again = (draw_study(drawing, grid, THEMES["dark"], False).pixels() for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert first.shape == (480, 640, 3)
    ground = THEMES["dark"].ground
    edges = np.concatenate([first[0], first[-1], first[:, 0], first[:, -1]])
    assert (edges == ground).all()


def test_x_axes_that_are_the_same_are_labelled_once() -> None:
    def labels(name: str) -> list[str]:
        with settings():
            canvas = draw_study(DRAWINGS[name], study_grid(DRAWINGS[name], (640, 480)), THEMES["light"], False)
        return [text.get_text() for text in canvas.figure.texts]

    assert labels("curves").count("x") == 1
    assert (labels("scatter").count("x"), labels("scatter").count("w")) == (1, 1)
    assert "A title" in labels("curves")
