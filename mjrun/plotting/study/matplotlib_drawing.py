"""Drawing of a study's figure: its title, key and panels, which matplotlib places."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.figure_data import POINT, AxisScale, PanelGrid
from mjrun.plotting.matplotlib_layout import (
    SMALL,
    TITLE,
    MatplotlibFigure,
    curve_line,
    dot_size,
    number_ticks,
    rgb,
    set_scale,
    set_scales,
)
from mjrun.plotting.study.figure_data import (
    DrawnStudyFigure,
    GraphPanel,
    HeatmapPanel,
    ParallelCoordinatesPanel,
    SensitivityPanel,
    Series,
)
from mjrun.plotting.tick_labels import cell_labels

UPPER = 1.25  # height of parallel coordinates, in rows of panels
NAMES = 0.3  # maximum share of the figure for names of parameters
NEGLIGIBLE = 1e-3  # index of sensitivity, as a share of the axis, that is rounded to 0
REACH = 1.1  # end of the axis of rank correlations on either side
FALLING = 0.1  # negative rank correlation from which a ring is on the side of its bar
THICK = 0.62  # height of a bar, as a share of its row
OPACITIES = (0.16, 0.26)  # of the bands, from wide to narrow, where they add up
BANDS = ("5–95 %", "25–75 %")
RUG = 0.55  # height of a mark at the bottom [em]
MANY = 400  # number of dots above which they are drawn faintly
COLOUR_MAP = "viridis"  # perceptually uniform
BAR, GAP = 0.8, 0.7  # width of a colour bar, and gap before it [em]
METRIC = 10  # maximum width of a metric's name above its colour bar [em]
WRITTEN = 100  # maximum number of cells of a heat map with their values
DIGITS = 4  # maximum number of significant digits of these values
VECTORS = 4000  # number of cells above which an svg or a pdf stores them as an image


def paint_study(drawing: DrawnStudyFigure, grid: PanelGrid, canvas: MatplotlibFigure) -> None:
    """Draws the figure of a study on a canvas; to be called within `mjrun.plotting.matplotlib_layout.settings`."""
    panels, side = drawing.panels, grid.columns
    rows = -(-len(panels) // side)
    key = _key(drawing, canvas)
    if key:
        _add_key(canvas, key, drawing.title, drawing.legend_title)
    parts = canvas.figure.add_gridspec(
        2 if drawing.above else 1, 1, height_ratios=[UPPER, rows] if drawing.above else [1]
    )
    spec = parts[-1].subgridspec(rows, side)
    host = canvas.figure.add_subplot(parts[0]) if drawing.above else None
    if drawing.above and host:
        draw_parallel(canvas, drawing.above, host)
    maps = list[tuple[HeatmapPanel, Axes]]()
    for index, panel in enumerate(panels):
        axes = canvas.figure.add_subplot(spec[divmod(index, side)])
        axes.set_title(canvas.shown(panel.label))
        match panel:
            case GraphPanel():
                _draw_graph(canvas, panel, axes)
                label = panel.x.name
            case HeatmapPanel():
                draw_heat_map(canvas, panel, axes)
                maps.append((panel, axes))
                axes.set_ylabel("" if index % side else canvas.shown(panel.rows.name))
                label = panel.columns.name
            case SensitivityPanel():
                _draw_rank_bars(canvas, panel, axes, named=index % side == 0)
                label = panel.axis
        if isinstance(panel, GraphPanel):
            axes.set_ylabel(canvas.shown(panel.axis_label))
        if _is_lowest(drawing, index, side):
            axes.set_xlabel(canvas.shown(label))
        else:
            axes.tick_params(labelbottom=False)
    canvas.settle("" if key else drawing.title)
    for each, axes in maps:
        _write_values(canvas, each, axes)
    if host:
        plate_labels(canvas, host)


def _key(drawing: DrawnStudyFigure, canvas: MatplotlibFigure) -> dict[str, Artist]:
    graphs = [panel for panel in drawing.panels if isinstance(panel, GraphPanel)]
    maps = [panel for panel in drawing.panels if isinstance(panel, HeatmapPanel)]
    ranked = next((panel for panel in drawing.panels if isinstance(panel, SensitivityPanel)), None)
    return {
        **(heat_key(canvas, maps) if maps else {}),
        **(_rank_key(canvas, ranked) if ranked else {}),
        **(_graph_key(canvas, graphs) if graphs else {}),
    }


def _add_key(canvas: MatplotlibFigure, key: Mapping[str, Artist], title: str, legend_title: str) -> None:
    """Adds a key above all panels, with the title above it: in one line if it fits, otherwise in columns.

    The title of the key comes first in it.
    """
    if legend_title:
        key = {f"{legend_title}:": Line2D([], [], linestyle="none"), **key}
    em, room = SMALL * canvas.em, canvas.width - 2 * canvas.em
    names = [canvas.fitted(name, room - 3 * em, em) for name in key]
    widths = [canvas.measure(name, em) + 3.65 * em for name in names]  # with sample and gaps
    columns = len(names) if sum(widths) <= room else max(1, int(room / max(widths)))
    canvas.figure.legend(
        [*key.values()],
        names,
        loc="outside upper left",
        ncols=columns,
        alignment="left",
        title=canvas.fitted(title, room, TITLE * canvas.em, bold=True) or None,
        title_fontproperties={"size": TITLE * canvas.em * POINT, "weight": "bold"},
    )


def _rank_key(canvas: MatplotlibFigure, panel: SensitivityPanel) -> dict[str, Artist]:
    """Returns samples of the two measures of a relation, by name."""
    bar = Patch(facecolor=rgb(canvas.theme.colour(0)), linewidth=0)
    key = dict[str, Artist](zip(panel.names, (bar, _dot(canvas)), strict=True))
    if panel.intervals is not None and np.isfinite(panel.intervals).any():
        key["confidence interval"] = Line2D([], [], color=rgb(canvas.theme.ink), linewidth=canvas.weight)
    return key


def _draw_intervals(canvas: MatplotlibFigure, panel: SensitivityPanel, axes: Axes) -> None:
    """Draws confidence intervals as lines: those of bars in their lower part, those of rings through them."""
    if panel.intervals is None:
        return
    rows = np.arange(len(panel.parameters))
    halo = withStroke(linewidth=3 * canvas.weight, foreground=rgb(canvas.theme.ground))  # on bars
    for ends, place in zip(panel.intervals, (rows + 0.3 * THICK, rows), strict=True):
        axes.hlines(
            place, *ends.T, color=rgb(canvas.theme.ink), linewidth=canvas.weight, zorder=2.5, path_effects=[halo]
        )


def _dot(canvas: MatplotlibFigure) -> Line2D:
    """Returns a ring, which marks a share of mutual information."""
    ring = Line2D([], [], linestyle="none", marker="o", zorder=3, markersize=0.45 * canvas.em * POINT)
    ring.set(markerfacecolor=rgb(canvas.theme.ground), markeredgecolor=rgb(canvas.theme.ink))
    ring.set_markeredgewidth(0.8 * canvas.weight)
    return ring


def _draw_rank_bars(canvas: MatplotlibFigure, panel: SensitivityPanel, axes: Axes, *, named: bool) -> None:
    """Draws rank correlations as bars, each with its number on the other side of zero, which is always free.

    Indices of sensitivity are bars to the right, apart from errors of estimates: their numbers are a column beside
    the names, since intervals may reach to either side of zero.
    """
    theme, em = canvas.theme, canvas.em
    rows, values = np.arange(len(panel.parameters)), np.nan_to_num(panel.correlations)
    axes.set(xlim=panel.ends or (-REACH, REACH), ylim=(len(rows) - 0.5, -0.5))
    axes.spines["left"].set_visible(False)
    if panel.ends is None:
        axes.set_xticks([-1, -0.5, 0, 0.5, 1], ["−1", "−0.5", "0", "0.5", "1"])
    names = [canvas.fitted(name, NAMES * canvas.width, SMALL * em) if named else "" for name in panel.parameters]
    axes.set_yticks(rows, names, color=rgb(theme.ink))
    axes.grid(True, axis="x")
    axes.barh(rows, values, THICK, color=[rgb(theme.colour(0 if value >= 0 else 1)) for value in values])
    axes.axvline(0, color=rgb(theme.zero), linewidth=1.5 * canvas.hair)
    dots = _dot(canvas)
    falls = (values < -FALLING) & (panel.ends is None)
    dots.set_data(np.where(falls, -panel.dependences, panel.dependences), rows)  # NaN has none
    axes.add_line(dots)
    _draw_intervals(canvas, panel, axes)
    for row, value in enumerate(panel.correlations.tolist()):
        is_zero = panel.ends is not None and abs(value) < NEGLIGIBLE * panel.ends[1]
        written = f"{value:+.2f}" if panel.ends is None else f"{0 if is_zero else value:.2g}"
        text = "–" if np.isnan(value) else written.replace("-", "−")
        is_right = value < 0 or panel.ends is not None
        axes.annotate(
            text,
            (0, row),
            xycoords="data" if panel.ends is None else axes.get_yaxis_transform(),
            xytext=((0.3 if is_right else -0.3) * em * POINT, 0),
            textcoords="offset points",
            ha="left" if is_right else "right",
            va="center_baseline",
            color=rgb(theme.grey),
            fontsize=0.85 * SMALL * em * POINT,
            path_effects=[withStroke(linewidth=3 * canvas.weight, foreground=rgb(theme.ground))],  # on the grid
        )


def _is_lowest(drawing: DrawnStudyFigure, index: int, side: int) -> bool:
    """Returns whether a panel shows its x axis: the last of a column does, and one above a panel with another axis."""
    panels, below = drawing.panels, index + side
    if below >= len(panels):
        return True
    mine, other = panels[index], panels[below]
    if isinstance(mine, GraphPanel) and isinstance(other, GraphPanel):
        return mine.x != other.x
    return type(mine) is not type(other)


def _graph_key(canvas: MatplotlibFigure, panels: Sequence[GraphPanel]) -> dict[str, Artist]:
    """Returns samples of the lines, bands and marks of panels by name, once for all of them."""
    theme, first = canvas.theme, panels[0]
    key: dict[str, Artist] = {}
    for series in (series for panel in panels for series in panel.series if series.name):
        key[series.name] = curve_line(canvas.theme, series.colour, opacity=series.opacity)
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


def _draw_graph(canvas: MatplotlibFigure, panel: GraphPanel, axes: Axes) -> None:
    """Draws a panel."""
    set_scales(canvas, axes, panel.x, panel.y)
    for series in reversed(panel.series):  # the first on top
        _series(canvas, axes, series)
    for mark in panel.marks:
        _mark(canvas, axes, mark)
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


def _mark(canvas: MatplotlibFigure, axes: Axes, mark: ReferenceLine) -> None:
    """Draws a line at a value of either axis, with its label at the end of the line."""
    low, high = axes.get_xlim() if mark.vertical else axes.get_ylim()
    if not low <= mark.value <= high:
        return
    draw, place = (axes.axvline, (mark.value, 1)) if mark.vertical else (axes.axhline, (1, mark.value))
    draw(mark.value, color=rgb(canvas.theme.ink), linewidth=1.3 * canvas.hair, dashes=(5, 3), zorder=1.5)
    size = 0.85 * SMALL * canvas.em * POINT
    transform = axes.get_xaxis_transform() if mark.vertical else axes.get_yaxis_transform()
    axes.annotate(
        canvas.shown(mark.label),
        place,
        xycoords=transform,
        xytext=(0.3 * size, -0.2 * size) if mark.vertical else (-0.3 * size, 0.3 * size),
        textcoords="offset points",
        ha="left" if mark.vertical else "right",
        va="top" if mark.vertical else "bottom",
        fontsize=size,
        color=rgb(canvas.theme.grey),
        bbox={"facecolor": rgb(canvas.theme.ground), "edgecolor": "none", "alpha": 0.8, "pad": 0.1 * size},
        zorder=4,
    )


def _series(canvas: MatplotlibFigure, axes: Axes, series: Series) -> None:
    colour = rgb(canvas.theme.colour(series.colour))
    if series.joined:
        for band, opacity in zip(series.bands, OPACITIES, strict=False):
            axes.fill_between(series.x, band.low, band.high, color=colour, alpha=opacity, linewidth=0)
        line = curve_line(canvas.theme, series.colour, opacity=series.opacity, turn=series.turn)
        line.set_data(series.x, series.y)
        axes.add_line(line)
    else:
        for band, width in zip(series.bands, (1.0, 3.5), strict=False):
            axes.vlines(series.x, band.low, band.high, color=colour, alpha=0.45, linewidth=width * canvas.weight)
    if series.dots:
        alone = not series.joined and not series.bands
        size = (dot_size(len(series.x)) if alone else 2.8) * canvas.weight
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


def _failure_colour(canvas: MatplotlibFigure, panel: GraphPanel, index: int) -> tuple[float, float, float]:
    """Returns the colour of a status, which differs from those of the series."""
    return rgb(canvas.theme.colour(len(panel.series) + index))


def draw_heat_map(canvas: MatplotlibFigure, panel: HeatmapPanel, axes: Axes) -> None:
    """Draws a panel, with its colour bar to the right of it."""
    height, width = panel.values.shape
    across, up = _edges(panel.columns, width), _edges(panel.rows, height)
    set_scale(canvas, axes, "x", panel.columns)
    set_scale(canvas, axes, "y", panel.rows)
    values, many = np.ma.masked_invalid(panel.values), width * height > VECTORS
    colours = {"cmap": COLOUR_MAP, "norm": _norm(panel.colours)}
    if many and not (panel.columns.log or panel.rows.log):
        values = values.astype(np.float32)  # of which matplotlib makes several copies
        axes.imshow(values, extent=(*across[[0, -1]], *up[[0, -1]]), origin="lower", aspect="auto", **colours)
    else:
        axes.pcolormesh(across, up, values, rasterized=many, **colours)
    for row, column in np.argwhere(np.isnan(panel.values)).tolist():
        corner, size = (across[column], up[row]), (across[column + 1] - across[column], up[row + 1] - up[row])
        axes.add_patch(_empty_cell(canvas, corner, size, failed=panel.failed[row, column]))
    _colour_bar(canvas, axes, panel.colours, GAP)


def _write_values(canvas: MatplotlibFigure, panel: HeatmapPanel, axes: Axes) -> None:
    """Writes the values into the cells of a heat map, if all of them have room."""
    rows, columns = panel.values.shape
    size, box = 0.85 * SMALL * canvas.em, axes.get_window_extent()
    if rows * columns > WRITTEN or box.height / rows < 1.6 * size:
        return
    known = np.argwhere(np.isfinite(panel.values)).tolist()
    if not known:
        return
    written = [float(panel.values[row, column]) for row, column in known]
    labels = cell_labels(written, DIGITS, log=panel.colours.log)
    if max(canvas.measure(label, size) for label in labels) > box.width / columns - size:
        return
    norm, colours = _norm(panel.colours), colormaps[COLOUR_MAP]
    across, up = _middles(panel.columns, columns), _middles(panel.rows, rows)
    for (row, column), label in zip(known, labels, strict=True):
        red, green, blue, _ = colours(norm(panel.values[row, column]))
        is_dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.45
        place, colour = (across[column], up[row]), "white" if is_dark else "black"
        axes.text(*place, label, ha="center", va="center", fontsize=size * POINT, color=colour)


def _middles(scale: AxisScale, count: int) -> np.ndarray:
    """Returns the middles of `count` cells."""
    edges = _edges(scale, count)
    middles: np.ndarray = np.sqrt(edges[1:] * edges[:-1]) if scale.log else (edges[1:] + edges[:-1]) / 2
    return middles


def heat_key(canvas: MatplotlibFigure, panels: Sequence[HeatmapPanel]) -> dict[str, Artist]:
    """Returns samples of the kinds of cells without a colour that occur, by name."""
    key: dict[str, Artist] = {}
    if any(panel.failed.any() for panel in panels):
        key["every point failed"] = _empty_cell(canvas, (0, 0), (1, 1), failed=True)
    if any((np.isnan(panel.values) & ~panel.failed).any() for panel in panels):
        key["no value"] = _empty_cell(canvas, (0, 0), (1, 1), failed=False)
    return key


def draw_parallel(canvas: MatplotlibFigure, panel: ParallelCoordinatesPanel, host: Axes) -> None:
    """Draws a line for each point; the axis of the metric is the colour bar."""
    theme, em = canvas.theme, canvas.em
    *scales, metric = panel.scales
    host.axis("off")
    host.set(xlim=(0, len(scales)), ylim=(0, 1))

    shares = np.column_stack([scale.shares(panel.values[:, i]) for i, scale in enumerate(panel.scales)])
    lines = np.stack([np.broadcast_to(np.arange(shares.shape[1]), shares.shape), shares], axis=2)
    good, thin = ~panel.failed, canvas.weight
    if panel.failed.any():
        failed = LineCollection(list(lines[panel.failed, :-1]), colors=[rgb(theme.grey)], linewidths=0.6 * thin)
        failed.set(linestyle=(0, (2, 2)), alpha=0.6)
        host.add_collection(failed)
    opacity = float(np.clip(80 / max(1, good.sum()), 0.15, 0.85))
    colours = _colours(metric).to_rgba(panel.values[good, -1])
    host.add_collection(LineCollection(list(lines[good]), colors=colours, linewidths=0.8 * thin, alpha=opacity))
    bar = _colour_bar(canvas, host, metric, 0)
    _name(bar, canvas.fitted(metric.name, METRIC * em, em), 0, em)

    span = (canvas.width - METRIC * em) / len(scales) - 0.6 * em
    names = [scale.name for scale in scales]
    if any(canvas.measure(canvas.shown(name), em) > span for name in names):
        names = _distinct(names)
    for index, (scale, name) in enumerate(zip(scales, names, strict=True)):
        axis = host.twinx()
        set_scale(canvas, axis, "y", scale)
        axis.spines[:].set_visible(False)
        axis.spines["right"].set(visible=True, position=("axes", index / len(scales)), color=rgb(theme.grey))
        axis.spines["right"].set_linewidth(1.5 * canvas.hair)
        _name(host, canvas.fitted(name, span, em), index, em)


def plate_labels(canvas: MatplotlibFigure, host: Axes) -> None:
    """Adds backgrounds to the labels of parallel axes, whose positions are known, so that lines do not hide them."""
    plate = {"facecolor": rgb(canvas.theme.ground), "edgecolor": "none", "alpha": 0.8, "pad": 0.1 * SMALL * canvas.em}
    for axes in canvas.figure.axes:
        if axes is not host and axes.get_subplotspec() == host.get_subplotspec():
            for label in axes.get_yticklabels():
                label.set_bbox(plate)


def _name(axes: Axes, name: str, x: float, em: float) -> Annotation:
    """Writes the name of an axis above it."""
    place = {"xytext": (0, 0.6 * em * POINT), "textcoords": "offset points"}
    return axes.annotate(name, (x, 1), xycoords=("data", "axes fraction"), va="bottom", fontsize=em * POINT, **place)


def _colour_bar(canvas: MatplotlibFigure, axes: Axes, colours: AxisScale, gap: float) -> Axes:
    """Draws a colour bar to the right of axes, after a gap [em]."""
    box = axes.get_window_extent()
    pad, aspect = gap * canvas.em / box.width, box.height / (BAR * canvas.em)
    bar = canvas.figure.colorbar(_colours(colours), ax=axes, pad=pad, aspect=aspect)
    bar.outline.set_visible(False)  # type: ignore[operator]
    number_ticks(bar.ax.yaxis, canvas.em, whole=colours.whole)
    return bar.ax


def _colours(scale: AxisScale) -> ScalarMappable:
    """Returns the mapping of values to colours."""
    return ScalarMappable(_norm(scale), COLOUR_MAP)


def _norm(scale: AxisScale) -> Normalize:
    return (LogNorm if scale.log else Normalize)(scale.low, scale.high)


def _empty_cell(
    canvas: MatplotlibFigure, corner: tuple[float, float], size: tuple[float, float], *, failed: bool
) -> Rectangle:
    """Returns a cell without a value, hatched if its points failed."""
    theme = canvas.theme
    cell = Rectangle(corner, *size, facecolor=rgb(theme.grid), edgecolor="none", linewidth=0)
    if failed:
        cell.set(edgecolor=rgb(theme.grey), hatch="/////")
    return cell


def _edges(scale: AxisScale, count: int) -> np.ndarray:
    """Returns the edges of `count` cells."""
    return (np.geomspace if scale.log else np.linspace)(scale.low, scale.high, count + 1)


def _distinct(names: Sequence[str]) -> list[str]:
    """Removes the common kind and field from names: `torso` for `geom/torso.friction[0]`."""
    parts = [re.fullmatch(r"(.*?/)?(.*?)(\.[^/]*)?", name, re.DOTALL) for name in names]
    groups = [part.groups("") for part in parts if part]
    kinds, objects, fields = ({part[i] for part in groups} for i in range(3))
    if len(names) < 2 or "" in objects or len(objects) < len(names) or len(kinds) > 1 or len(fields) > 1:
        return [*names]
    return [part[1] for part in groups]
