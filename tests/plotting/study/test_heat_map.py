"""Colours of cells, read back from the pixels."""

import matplotlib
import numpy as np

from mjrun.plotting.study.axes import COLOUR_MAP, Box, Sheet
from mjrun.plotting.study.drawing import HeatPanel, Scale
from mjrun.plotting.study.heat_map import draw_heat_map, heat_key, heat_margins

VALUES = np.array([[1.0, 2, np.nan], [4, 5, np.nan]])
FAILED = np.array([[False, False, True], [False, False, False]])
PANEL = HeatPanel(
    "z",
    Scale("mass", -0.5, 2.5, categories=("1", "2", "3")),
    Scale("friction", 0, 2),
    VALUES,
    FAILED,
    Scale("z", 1, 5),
)


def test_every_cell_has_the_colour_of_its_value_and_the_bar_shows_all(sheet: Sheet) -> None:
    box = Box(60, 60, 360, 260)
    draw_heat_map(sheet, PANEL, box, lowest=True)
    pixels = sheet.canvas.pixels()
    table = matplotlib.colormaps[COLOUR_MAP]
    for row in range(2):
        for column in range(2):
            expected = np.round(np.array(table((VALUES[row, column] - 1) / 4)[:3]) * 255)
            found = pixels[260 - 100 * row - 50, 60 + 100 * column + 50].astype(int)
            assert abs(found - expected).max() <= 2
    hatched, empty = pixels[170:250, 270:350].reshape(-1, 3), pixels[70:150, 270:350].reshape(-1, 3)
    assert len(np.unique(hatched, axis=0)) > 3
    assert len(np.unique(empty, axis=0)) == 1
    bar = sheet.canvas.figure.axes[1]
    assert bar.get_ylim() == (1, 5)


def test_the_key_tells_of_cells_without_a_value(sheet: Sheet) -> None:
    assert [entry.name for entry in heat_key(sheet, [PANEL])] == ["every point failed", "no point"]
    assert min(heat_margins(sheet, [PANEL])) > 12


def test_a_logarithmic_grid_is_drawn_in_equal_cells(sheet: Sheet) -> None:
    scale = Scale("x", 1, 100, log=True)
    values = np.array([[1.0, 10]])
    panel = HeatPanel("z", scale, Scale("y", 0, 1), values, values < 0, Scale("z", 1, 10, log=True))
    draw_heat_map(sheet, panel, Box(60, 60, 360, 260), lowest=False)
    pixels = sheet.canvas.pixels()
    assert (pixels[160, 61] == pixels[160, 209]).all()
    assert (pixels[160, 211] == pixels[160, 359]).all()
    assert (pixels[160, 200] != pixels[160, 220]).any()
