"""Panels have room, whatever their number and the size."""

import pytest

from mjrun.errors import BadValueError
from mjrun.plotting.panel_grid import PanelCount, panel_grid


@pytest.mark.parametrize("panels", [1, 2, 4, 5, 6, 16, 48])
def test_a_figure_grows_with_its_panels(panels: int) -> None:
    grid = panel_grid(PanelCount(panels, 3, False), None, None)
    assert grid.rows * grid.columns >= panels > (grid.rows - 1) * grid.columns
    assert grid.size[1] / grid.rows >= 12 * grid.em
    assert 10 < grid.em < 20


def test_a_larger_legend_makes_higher_panels_up_to_a_bound() -> None:
    heights = [panel_grid(PanelCount(8, names, False), None, None).size[1] for names in (2, 12, 300)]
    assert heights[0] < heights[1] <= heights[2] < 3000


def test_what_is_asked_for_is_kept() -> None:
    grid = panel_grid(PanelCount(6, 3, True), (640, 480), 3)
    assert (grid.size, grid.columns, grid.rows) == ((640, 480), 3, 2)
    assert panel_grid(PanelCount(2, 3, True), None, 8).columns == 2


def test_panels_without_room_are_refused() -> None:
    with pytest.raises(BadValueError, match=r"size: '640x200' is not at least 140x320 for 5 panels"):
        panel_grid(PanelCount(5, 1, False), (640, 200), None)
    with pytest.raises(BadValueError, match=r"at least 420x96 for 3 panels"):
        panel_grid(PanelCount(3, 1, False), (300, 300), 3)


@pytest.mark.parametrize("size", [(100_000, 1000), (20_000, 20_000)])
def test_more_pixels_than_memory_may_hold_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(BadValueError, match=r"is not at most 65535 a side and 100 megapixels"):
        panel_grid(PanelCount(1, 1, False), size, None)
