"""Draws a metric over a parameter: medians and bands, or dots, and where points failed."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from mjrun.plotting.canvas import rgb
from mjrun.plotting.study.axes import Box, Sheet, set_ticks
from mjrun.plotting.study.drawing import GraphPanel, Series
from mjrun.plotting.study.key import KeyEntry

OPACITIES = (0.16, 0.26)  # of the bands, from wide to narrow; they add up
BANDS = ("5–95 %", "25–75 %")
RUG = 0.55  # height of a mark at the bottom [em]
FEW, LARGE = 50, 4.0  # dots, up to which each is large, and how large
MANY = 400  # dots that are drawn faintly


def graph_key(sheet: Sheet, panels: Sequence[GraphPanel]) -> list[KeyEntry]:
    """What the lines, bands and marks of panels mean, once for all of them."""
    theme, first = sheet.canvas.theme, panels[0]
    named = {series.name: series for panel in panels for series in panel.series if series.name}
    entries = [KeyEntry(name, _line(sheet, series)) for name, series in named.items()]
    banded = next((s for s in first.series if s.bands), None)
    if banded:
        colour = rgb(theme.grey) if banded.name else rgb(theme.colour(banded.colour))
        entries.append(KeyEntry("median", Line2D([], [], color=colour, linewidth=sheet.weight)))
        for name, opacity in zip(BANDS, (OPACITIES[0], sum(OPACITIES)), strict=True):
            shade = _mixed(rgb(theme.ground), colour, opacity)
            sample = Line2D([], [], color=shade, linewidth=4.5 * sheet.weight, solid_capstyle="butt")
            entries.append(KeyEntry(name, sample))
    for index, each in enumerate(first.failures):
        mark = Line2D([], [], color=_failure_colour(sheet, first, index), linestyle="none", marker="|")
        mark.set_markersize(0.75 * RUG * sheet.em)
        mark.set_markeredgewidth(0.8 * sheet.weight)
        count = len(each.x)
        entries.append(KeyEntry(f"{each.status}: {count} point{'' if count == 1 else 's'}", mark))
    return entries


def draw_graph(sheet: Sheet, panel: GraphPanel, box: Box, *, lowest: bool) -> None:
    """Draws a panel into a box, with labels on x where it is the lowest."""
    theme, axes = sheet.canvas.theme, sheet.axes(box)
    axes.set_xscale("log" if panel.x.log else "linear")
    axes.set_yscale("log" if panel.y.log else "linear")
    axes.set_xlim(panel.x.low, panel.x.high)
    axes.set_ylim(panel.y.low, panel.y.high)
    set_ticks(axes.xaxis, sheet.x_ticks(panel.x, box.width), shown=lowest)
    set_ticks(axes.yaxis, sheet.y_ticks(panel.y, box.height))
    axes.grid(True, which="major", color=rgb(theme.grid), linewidth=sheet.hair)
    if not panel.y.log and panel.y.low < 0 < panel.y.high:
        axes.axhline(0, color=rgb(theme.zero), linewidth=sheet.hair, zorder=1)
    for series in reversed(panel.series):  # the first on top
        _series(sheet, axes, series)
    for index, each in enumerate(panel.failures):
        colour, height = _failure_colour(sheet, panel, index), RUG * sheet.em / box.height
        axes.vlines(each.x, 0, height, transform=axes.get_xaxis_transform(), color=colour, linewidth=0.8 * sheet.weight)
    if lowest:
        sheet.x_label(panel.x.name, box)


def _series(sheet: Sheet, axes: Axes, series: Series) -> None:
    colour = rgb(sheet.canvas.theme.colour(series.colour))
    if series.joined:
        for band, opacity in zip(series.bands, OPACITIES, strict=False):
            axes.fill_between(series.x, band.low, band.high, color=colour, alpha=opacity, linewidth=0)
        line = _line(sheet, series)
        line.set_data(series.x, series.y)
        axes.add_line(line)
    else:
        for band, width in zip(series.bands, (1.0, 3.5), strict=False):
            axes.vlines(series.x, band.low, band.high, color=colour, alpha=0.45, linewidth=width * sheet.weight)
    if series.dots:
        alone = not series.joined and not series.bands
        size = (LARGE if alone and len(series.x) <= FEW else 2.4 if alone else 2.8) * sheet.weight
        axes.plot(
            series.x,
            series.y,
            "o",
            markersize=size,
            color=colour,
            markeredgewidth=0,
            alpha=0.35 if alone and len(series.x) > MANY else 0.75 if alone else 1.0,
            clip_on=False,
        )


def _line(sheet: Sheet, series: Series) -> Line2D:
    """A line that looks like that of a series."""
    theme = sheet.canvas.theme
    line = Line2D([], [], color=rgb(theme.colour(series.colour)), linewidth=sheet.weight, alpha=series.opacity)
    if pattern := theme.pattern(series.colour):
        line.set_linestyle((0, pattern))
    line.set_solid_joinstyle("round")
    return line


def _failure_colour(sheet: Sheet, panel: GraphPanel, index: int) -> tuple[float, float, float]:
    """The colour of a status: one that no series has."""
    return rgb(sheet.canvas.theme.colour(len(panel.series) + index))


def _mixed(
    ground: tuple[float, float, float], colour: tuple[float, float, float], opacity: float
) -> tuple[float, float, float]:
    red, green, blue = (g + opacity * (c - g) for g, c in zip(ground, colour, strict=True))
    return red, green, blue
