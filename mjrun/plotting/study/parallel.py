"""Draws parallel coordinates: a line for each point, coloured by a metric, whose axis is the colour bar."""

import re
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from mjrun.plotting.canvas import rgb
from mjrun.plotting.study.axes import COLOUR_MAP, SMALL, Box, Sheet, number_ticks
from mjrun.plotting.study.drawing import ParallelPanel, Scale
from mjrun.plotting.study.heat_map import colour_norm, draw_colour_bar
from mjrun.plotting.ticks import Ticks

BAR = 0.8  # width of the axis of the metric [em]


def draw_parallel(sheet: Sheet, panel: ParallelPanel, box: Box) -> None:
    """Draws a panel into a box; labels stand above the axes and to the right of them."""
    theme, em, axes = sheet.canvas.theme, sheet.em, sheet.axes(box)
    axes.axis("off")
    ticks = [_ticks(sheet, scale, box.height) for scale in panel.scales]
    last = sheet.tick_width(ticks[-1]) + (BAR + 0.6) * em
    span = (box.width - last) / (len(panel.scales) - 1)
    places = [box.left + index * span for index in range(len(panel.scales))]
    axes.set_xlim(box.left, box.right)
    axes.set_ylim(0, 1)

    shares = np.column_stack([scale.shares(panel.values[:, i]) for i, scale in enumerate(panel.scales)])
    good = ~panel.failed
    opacity = float(np.clip(80 / max(1, good.sum()), 0.15, 0.85))
    lines = np.stack([np.broadcast_to(places, shares.shape), shares], axis=2)
    if panel.failed.any():
        failed = LineCollection(list(lines[panel.failed, :-1]), colors=[rgb(theme.grey)], linewidths=0.6 * sheet.weight)
        failed.set_linestyle((0, (2, 2)))
        failed.set_alpha(0.6)
        axes.add_collection(failed)
    colours = matplotlib.colormaps[COLOUR_MAP](colour_norm(panel.scales[-1])(panel.values[good, -1]))
    axes.add_collection(LineCollection(list(lines[good]), colors=colours, linewidths=0.8 * sheet.weight, alpha=opacity))

    names = [scale.name for scale in panel.scales]
    if any(sheet.canvas.measure(sheet.canvas.shown(name), em) > span - 0.6 * em for name in names[:-1]):
        names = [*_distinct(names[:-1]), names[-1]]
    for index, (scale, name, x, labels) in enumerate(zip(panel.scales, names, places, ticks, strict=True)):
        is_last = index == len(places) - 1
        if is_last:
            draw_colour_bar(sheet, _bar(sheet, Box(x, box.top, x + BAR * em, box.bottom)), scale)
        else:
            axes.plot([x, x], [0, 1], color=rgb(theme.grey), linewidth=1.5 * sheet.hair, zorder=3)
        room = (box.right - x + em if is_last else span) - 0.6 * em
        sheet.canvas.text(sheet.canvas.fitted(name, room, em), x, box.top - 0.95 * em, em, theme.ink)
        heights = box.bottom - scale.shares(np.array(labels.values, float)) * box.height
        for text, height in zip(labels.labels, heights.tolist(), strict=True):
            place = x + (BAR + 0.35 if is_last else 0.35) * em
            short = sheet.canvas.fitted(text, room - 0.3 * em, SMALL * em)
            sheet.canvas.text(short, place, height, SMALL * em, theme.grey, plate=not is_last)


def _distinct(names: Sequence[str]) -> list[str]:
    """The names without the kind and the field that all have in common: `torso` of `geom/torso.friction[0]`."""
    parts = [re.fullmatch(r"(.*?/)?(.*?)(\.[^/]*)?", name, re.DOTALL) for name in names]
    found = [part.groups("") for part in parts if part]
    kinds, objects, fields = ({part[i] for part in found} for i in range(3))
    if len(names) < 2 or "" in objects or len(objects) < len(names) or len(kinds) > 1 or len(fields) > 1:
        return [*names]
    return [part[1] for part in found]


def _bar(sheet: Sheet, box: Box) -> Axes:
    bar = sheet.axes(box)
    bar.spines[:].set_visible(False)
    return bar


def _ticks(sheet: Sheet, scale: Scale, height: float) -> Ticks:
    if scale.categories:
        return Ticks(range(len(scale.categories)), [sheet.canvas.shown(text) for text in scale.categories])
    return number_ticks(scale, min(6, height / (2.6 * sheet.em)))
