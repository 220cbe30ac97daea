"""Places of panels."""

import numpy as np
import pytest

from mjrun.errors import BadValueError
from mjrun.plotting.study.drawing import GraphPanel, ParallelPanel, RankPanel, Scale, StudyDrawing
from mjrun.plotting.study.grid import study_grid

GRAPH = GraphPanel(Scale("x", 0, 1), Scale("z", 0, 1), [], [])


def test_panels_have_the_columns_that_suit_or_those_asked_for() -> None:
    assert study_grid(StudyDrawing("", [GRAPH] * 2), None).columns == 1
    assert study_grid(StudyDrawing("", [GRAPH] * 6), None).columns == 3
    assert study_grid(StudyDrawing("", [GRAPH] * 4), None).columns == 2
    assert study_grid(StudyDrawing("", [GRAPH] * 6), (640, 2000)).columns == 1
    assert study_grid(StudyDrawing("", [GRAPH] * 6, columns=2), None).columns == 2


def test_parallel_coordinates_take_room_above() -> None:
    ranks = RankPanel("z", ["a"], np.array([0.5]))
    above = ParallelPanel([], np.empty((0, 0)), np.empty(0, bool))
    grid = study_grid(StudyDrawing("", [ranks] * 3, 3, above), None)
    assert (grid.columns, grid.rows) == (3, 2)


def test_a_size_too_small_is_told() -> None:
    with pytest.raises(BadValueError, match="at least"):
        study_grid(StudyDrawing("", [GRAPH] * 4), (100, 100))
