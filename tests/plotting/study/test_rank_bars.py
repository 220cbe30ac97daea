"""Bars of rank correlations, read back from matplotlib."""

from typing import Any

import numpy as np

from mjrun.plotting.study.axes import Box, Sheet
from mjrun.plotting.study.drawing import RankPanel
from mjrun.plotting.study.rank_bars import draw_rank_bars, rank_margin

PANEL = RankPanel("z", ["mass", "friction", "none"], np.array([-0.75, 0.5, np.nan]))


def test_bars_are_as_long_as_correlations_and_say_so(sheet: Sheet) -> None:
    draw_rank_bars(sheet, PANEL, Box(120, 50, 600, 300), 100, lowest=True)
    bars: list[Any] = [*sheet.canvas.figure.axes[0].patches]
    assert [bar.get_width() for bar in bars] == [-0.75, 0.5, 0]
    texts = [text.get_text() for text in sheet.canvas.figure.texts]
    assert texts == ["mass", "−0.75", "friction", "+0.50", "none", "–", "rank correlation"]


def test_where_there_is_no_room_for_names_there_are_none(sheet: Sheet) -> None:
    draw_rank_bars(sheet, PANEL, Box(120, 50, 600, 300), 0, lowest=False)
    assert [text.get_text() for text in sheet.canvas.figure.texts] == ["−0.75", "+0.50", "–"]


def test_a_number_without_room_beside_its_bar_stands_within_it(sheet: Sheet) -> None:
    extremes = RankPanel("z", ["a", "b", "c"], np.array([-0.99, 0.99, 0.1]))
    draw_rank_bars(sheet, extremes, Box(100, 0, 300, 300), 0, lowest=False)
    low, high, beside = (text.get_window_extent() for text in sheet.canvas.figure.texts)
    middle = 200
    assert 100 < low.x0 < low.x1 < middle < high.x0 < high.x1 < 300
    assert beside.x0 > middle + 0.1 / 1.1 * 100


def test_names_take_a_part_of_the_figure_at_most(sheet: Sheet) -> None:
    long = RankPanel("z", ["m" * 200], np.array([0.5]))
    assert rank_margin(sheet, [long], 640) < 0.35 * 640
