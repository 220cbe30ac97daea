"""Draws rank correlations as bars, with what rises and what falls to either side."""

from collections.abc import Sequence

import numpy as np

from mjrun.plotting.canvas import rgb
from mjrun.plotting.study.axes import SMALL, Box, Sheet, set_ticks
from mjrun.plotting.study.drawing import RankPanel
from mjrun.plotting.ticks import Ticks

NAMES = 0.3  # the most of the figure that names take
REACH = 1.1  # of the axis, to either side
THICK = 0.62  # of a bar, as a share of its row


def rank_margin(sheet: Sheet, panels: Sequence[RankPanel], width: float) -> float:
    """The room to the left of panels, for names, in a figure so wide [pixels]."""
    names = [name for panel in panels for name in panel.parameters]
    longest = max(sheet.canvas.measure(sheet.canvas.shown(name), SMALL * sheet.em) for name in names)
    return min(NAMES * width, longest) + 1.2 * sheet.em


def draw_rank_bars(sheet: Sheet, panel: RankPanel, box: Box, room: float, *, lowest: bool) -> None:
    """Draws a panel into a box, with names in the `room` to the left of it [pixels], if there is any."""
    theme, em, axes = sheet.canvas.theme, sheet.em, sheet.axes(box)
    rows, found = np.arange(len(panel.parameters)), np.nan_to_num(panel.correlations)
    axes.set_xlim(-REACH, REACH)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.spines["left"].set_visible(False)
    set_ticks(axes.xaxis, Ticks([-1, -0.5, 0, 0.5, 1], ["−1", "−0.5", "0", "0.5", "1"]), shown=lowest)
    axes.grid(True, axis="x", color=rgb(theme.grid), linewidth=sheet.hair)
    axes.barh(rows, found, THICK, color=[rgb(theme.colour(0 if value >= 0 else 1)) for value in found])
    axes.axvline(0, color=rgb(theme.zero), linewidth=1.5 * sheet.hair)

    step, size = box.height / len(rows), SMALL * em
    for row, (name, value) in enumerate(zip(panel.parameters, panel.correlations.tolist(), strict=True)):
        y = box.top + (row + 0.5) * step
        if room:
            text = sheet.canvas.fitted(name, room - 0.6 * em, size)
            left = box.left - 0.4 * em - sheet.canvas.measure(text, size)
            sheet.canvas.text(text, left, y, size, theme.ink)
        _label(sheet, box, value, y)
    if lowest:
        sheet.x_label("rank correlation", box)


def _label(sheet: Sheet, box: Box, value: float, y: float) -> None:
    """The number at the end of a bar, or within it where there is no room left."""
    text, size = "–" if np.isnan(value) else f"{value:+.2f}".replace("-", "−"), 0.85 * SMALL * sheet.em
    width, gap = sheet.canvas.measure(text, size), 0.3 * sheet.em
    end = box.left + (np.nan_to_num(value) + REACH) / (2 * REACH) * box.width
    is_inside = end - width - gap < box.left if value < 0 else end + width + gap > box.right
    left = end - width - gap if (value < 0) != is_inside else end + gap
    colour = sheet.canvas.theme.ground if is_inside else sheet.canvas.theme.grey
    sheet.canvas.text(text, left, y, size, colour)
