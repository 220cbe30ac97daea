"""Draws a metric over a parameter: medians and bands, or dots, and where points failed."""

from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mjrun.plotting.axis_ticks import category_ticks, number_ticks
from mjrun.plotting.canvas import POINT, Canvas, rgb
from mjrun.plotting.study.figure_data import GraphPanel, Scale, Series

OPACITIES = (0.16, 0.26)  # of the bands, from wide to narrow; they add up
BANDS = ("5–95 %", "25–75 %")
RUG = 0.55  # height of a mark at the bottom [em]
FEW, LARGE = 50, 4.0  # dots, up to which each is large, and how large
MANY = 400  # dots that are drawn faintly


def graph_key(canvas: Canvas, panels: Sequence[GraphPanel]) -> dict[str, Artist]:
    """What the lines, bands and marks of panels mean, once for all of them: a sample of each by its name."""
    theme, first = canvas.theme, panels[0]
    key: dict[str, Artist] = {}
    for series in (series for panel in panels for series in panel.series if series.name):
        key[series.name] = _line(canvas, series)
    banded = next((series for series in first.series if series.bands), None)
    if banded:
        colour = rgb(theme.grey) if banded.name else rgb(theme.colour(banded.colour))
        key["median"] = Line2D([], [], color=colour)
        for name, opacity in zip(BANDS, (OPACITIES[0], sum(OPACITIES)), strict=True):
            key[name] = Patch(facecolor=colour, alpha=opacity, linewidth=0)
    for index, each in enumerate(first.failures):
        count, size = len(each.x), 0.75 * RUG * canvas.em
        key[f"{each.status}: {count} point{'' if count == 1 else 's'}"] = Line2D(
            [],
            [],
            color=_failure_colour(canvas, first, index),
            linestyle="none",
            marker="|",
            markersize=size,
            markeredgewidth=0.8 * canvas.weight,
        )
    return key


def draw_graph(canvas: Canvas, panel: GraphPanel, axes: Axes) -> None:
    """Draws a panel."""
    theme = canvas.theme
    set_scale(canvas, axes, "x", panel.x)
    set_scale(canvas, axes, "y", panel.y)
    axes.grid(True)
    if not panel.y.log and panel.y.low < 0 < panel.y.high:
        axes.axhline(0, color=rgb(theme.zero), linewidth=canvas.hair, zorder=1)
    for series in reversed(panel.series):  # the first on top
        _series(canvas, axes, series)
    for index, each in enumerate(panel.failures):
        height = RUG * canvas.em * POINT
        axes.plot(
            each.x,
            [0] * len(each.x),
            color=_failure_colour(canvas, panel, index),
            linestyle="none",
            marker=[(0, 0), (0, 1)],
            markersize=2 * height,  # a marker is drawn to half its size from its place
            markeredgewidth=0.8 * canvas.weight,
            transform=axes.get_xaxis_transform(),
            clip_on=False,
        )


def set_scale(canvas: Canvas, axes: Axes, name: str, scale: Scale) -> None:
    """Gives the axis `name`, x or y, the range and the ticks of a scale."""
    axis = axes.xaxis if name == "x" else axes.yaxis
    axes.set(**{f"{name}scale": "log" if scale.log else "linear", f"{name}lim": (scale.low, scale.high)})
    if scale.categories:
        category_ticks(axis, scale.categories, canvas)
    else:
        number_ticks(axis, canvas.em)


def _series(canvas: Canvas, axes: Axes, series: Series) -> None:
    colour = rgb(canvas.theme.colour(series.colour))
    if series.joined:
        for band, opacity in zip(series.bands, OPACITIES, strict=False):
            axes.fill_between(series.x, band.low, band.high, color=colour, alpha=opacity, linewidth=0)
        line = _line(canvas, series)
        line.set_data(series.x, series.y)
        axes.add_line(line)
    else:
        for band, width in zip(series.bands, (1.0, 3.5), strict=False):
            axes.vlines(series.x, band.low, band.high, color=colour, alpha=0.45, linewidth=width * canvas.weight)
    if series.dots:
        alone = not series.joined and not series.bands
        size = (LARGE if alone and len(series.x) <= FEW else 2.4 if alone else 2.8) * canvas.weight
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


def _line(canvas: Canvas, series: Series) -> Line2D:
    """A line that looks like that of a series."""
    line = Line2D([], [], color=rgb(canvas.theme.colour(series.colour)), alpha=series.opacity)
    if pattern := canvas.theme.pattern(series.colour):
        line.set_linestyle((0, pattern))
    return line


def _failure_colour(canvas: Canvas, panel: GraphPanel, index: int) -> tuple[float, float, float]:
    """The colour of a status: one that no series has."""
    return rgb(canvas.theme.colour(len(panel.series) + index))
