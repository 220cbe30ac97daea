"""Draws a metric over two parameters as colours, with a colour bar; where all points failed is hatched."""

import math
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Rectangle

from mjrun.plotting.canvas import rgb
from mjrun.plotting.study.axes import COLOUR_MAP, SMALL, Box, Sheet, number_ticks, set_ticks
from mjrun.plotting.study.drawing import CELLS, HeatPanel, Scale
from mjrun.plotting.study.key import KeyEntry
from mjrun.plotting.ticks import Ticks

BAR, GAP = 0.8, 0.7  # width of the colour bar, and what is before it [em]
LONGEST = 9  # names of rows [em]
VECTORS = 4000  # cells that are an image in an svg or a pdf when there are more


def heat_margins(sheet: Sheet, panels: Sequence[HeatPanel]) -> tuple[float, float]:
    """The room to the left of all panels, for the ticks of rows, and to the right, for colour bars [pixels]."""
    rows = max(sheet.tick_width(_row_ticks(sheet, panel.rows, 20 * sheet.em)) for panel in panels)
    bars = max(sheet.tick_width(number_ticks(panel.colours, 6)) for panel in panels)
    return rows + 1.4 * sheet.em, bars + (BAR + GAP + 1.4) * sheet.em


def draw_heat_map(sheet: Sheet, panel: HeatPanel, box: Box, *, lowest: bool) -> None:
    """Draws a panel into a box; its colour bar is to the right of it."""
    em, axes = sheet.em, sheet.axes(box)
    height, width = panel.values.shape
    across, up = _edges(panel.columns, width), _edges(panel.rows, height)
    axes.set_xscale("log" if panel.columns.log else "linear")
    axes.set_yscale("log" if panel.rows.log else "linear")
    axes.set_xlim(across[0], across[-1])
    axes.set_ylim(up[0], up[-1])
    table, norm = matplotlib.colormaps[COLOUR_MAP], colour_norm(panel.colours)
    many = width * height > VECTORS
    axes.pcolormesh(across, up, np.ma.masked_invalid(panel.values), cmap=table, norm=norm, rasterized=many)
    matplotlib.rcParams["hatch.linewidth"] = sheet.hair
    for row, column in np.argwhere(np.isnan(panel.values)).tolist():
        corner, size = (across[column], up[row]), (across[column + 1] - across[column], up[row + 1] - up[row])
        axes.add_patch(_empty_cell(sheet, corner, size, failed=panel.failed[row, column]))
    set_ticks(axes.xaxis, _column_ticks(sheet, panel.columns, box.width), shown=lowest)
    set_ticks(axes.yaxis, _row_ticks(sheet, panel.rows, box.height))
    if lowest:
        sheet.x_label(panel.columns.name, box)

    left = box.right + GAP * em
    bar = sheet.axes(Box(left, box.top, left + BAR * em, box.bottom))
    bar.spines[:].set_visible(False)
    draw_colour_bar(sheet, bar, panel.colours)
    bar.yaxis.tick_right()
    set_ticks(bar.yaxis, sheet.y_ticks(panel.colours, box.height))
    bar.tick_params(axis="y", length=0)


def heat_key(sheet: Sheet, panels: Sequence[HeatPanel]) -> list[KeyEntry]:
    """What cells without a colour mean, as far as there are any."""
    failed = any(panel.failed.any() for panel in panels)
    missing = any((np.isnan(panel.values) & ~panel.failed).any() for panel in panels)
    entries: list[KeyEntry] = []
    for name, is_there, hatched in (("every point failed", failed, True), ("no point", missing, False)):
        if is_there:
            entries.append(KeyEntry(name, _empty_cell(sheet, (0, 0), (0, 0), failed=hatched)))
    return entries


def draw_colour_bar(sheet: Sheet, axes: Axes, colours: Scale) -> None:
    """Fills axes with the colours of a scale, from the bottom up."""
    ends = np.geomspace(colours.low, colours.high, 257) if colours.log else np.linspace(colours.low, colours.high, 257)
    axes.set_yscale("log" if colours.log else "linear")
    middle = (ends[:-1] + ends[1:]) / 2
    table = matplotlib.colormaps[COLOUR_MAP]
    axes.pcolormesh([0, 1], ends, middle[:, None], cmap=table, norm=colour_norm(colours))
    axes.set_xlim(0, 1)
    axes.set_ylim(colours.low, colours.high)
    set_ticks(axes.yaxis, Ticks([], []))


def colour_norm(colours: Scale) -> Normalize:
    """From values to shares of the colour map."""
    return (LogNorm if colours.log else Normalize)(colours.low, colours.high)


def _empty_cell(sheet: Sheet, corner: tuple[float, float], size: tuple[float, float], *, failed: bool) -> Rectangle:
    """A cell without a value, hatched if its points failed."""
    theme = sheet.canvas.theme
    cell = Rectangle(corner, *size, facecolor=rgb(theme.grid), edgecolor="none", linewidth=0)
    if failed:
        cell.set(edgecolor=rgb(theme.grey), hatch="/////")
    return cell


def _edges(scale: Scale, count: int) -> np.ndarray:
    """The edges of so many cells."""
    return (np.geomspace if scale.log else np.linspace)(scale.low, scale.high, count + 1)


def _column_ticks(sheet: Sheet, scale: Scale, width: float) -> Ticks:
    if not scale.categories:
        return sheet.x_ticks(scale, width)
    needed = sheet.tick_width(Ticks([], scale.categories)) + 0.9 * sheet.em
    room = width / len(scale.categories)
    return (
        sheet.x_ticks(scale, width)
        if needed > room and len(scale.categories) <= CELLS
        else _every(scale, needed / room)
    )


def _row_ticks(sheet: Sheet, scale: Scale, height: float) -> Ticks:
    if not scale.categories:
        return sheet.y_ticks(scale, height)
    ticks = _every(scale, 1.5 * sheet.em * len(scale.categories) / height)
    return Ticks(
        ticks.values, [sheet.canvas.fitted(text, LONGEST * sheet.em, SMALL * sheet.em) for text in ticks.labels]
    )


def _every(scale: Scale, stride: float) -> Ticks:
    """A tick at every so many cells."""
    step = max(1, math.ceil(stride))
    return Ticks(range(0, len(scale.categories), step), scale.categories[::step])
