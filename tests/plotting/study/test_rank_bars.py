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


def test_names_take_a_part_of_the_room_at_most(sheet: Sheet) -> None:
    long = RankPanel("z", ["m" * 200], np.array([0.5]))
    assert rank_margin(sheet, [long], 300) < 150
