"""Drawing of a metric as colours: over two parameters, and over any number as parallel lines."""

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from mjrun.plotting.axis_ticks import number_ticks, set_scale
from mjrun.plotting.figure_data import Scale
from mjrun.plotting.matplotlib_figure import POINT, SMALL, Canvas, rgb
from mjrun.plotting.study.figure_data import HeatPanel, ParallelPanel

COLOUR_MAP = "viridis"  # perceptually uniform
BAR, GAP = 0.8, 0.7  # width of a colour bar, and gap before it [em]
METRIC = 10  # maximum width of a metric's name above its colour bar [em]
VECTORS = 4000  # number of cells above which an svg or a pdf stores them as an image


def draw_heat_map(canvas: Canvas, panel: HeatPanel, axes: Axes) -> None:
    """Draws a panel, with its colour bar to the right of it."""
    height, width = panel.values.shape
    across, up = _edges(panel.columns, width), _edges(panel.rows, height)
    set_scale(canvas, axes, "x", panel.columns)
    set_scale(canvas, axes, "y", panel.rows)
    values, many = np.ma.masked_invalid(panel.values), width * height > VECTORS
    axes.pcolormesh(across, up, values, cmap=COLOUR_MAP, norm=_norm(panel.colours), rasterized=many)
    for row, column in np.argwhere(np.isnan(panel.values)).tolist():
        corner, size = (across[column], up[row]), (across[column + 1] - across[column], up[row + 1] - up[row])
        axes.add_patch(_empty_cell(canvas, corner, size, failed=panel.failed[row, column]))
    _colour_bar(canvas, axes, panel.colours, GAP)


def heat_key(canvas: Canvas, panels: Sequence[HeatPanel]) -> dict[str, Artist]:
    """Returns samples of the kinds of cells without a colour that occur, by name."""
    key: dict[str, Artist] = {}
    if any(panel.failed.any() for panel in panels):
        key["every point failed"] = _empty_cell(canvas, (0, 0), (1, 1), failed=True)
    if any((np.isnan(panel.values) & ~panel.failed).any() for panel in panels):
        key["no point"] = _empty_cell(canvas, (0, 0), (1, 1), failed=False)
    return key


def draw_parallel(canvas: Canvas, panel: ParallelPanel, host: Axes) -> None:
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


def plate_labels(canvas: Canvas, host: Axes) -> None:
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


def _colour_bar(canvas: Canvas, axes: Axes, colours: Scale, gap: float) -> Axes:
    """Draws a colour bar to the right of axes, after a gap [em]."""
    box = axes.get_window_extent()
    pad, aspect = gap * canvas.em / box.width, box.height / (BAR * canvas.em)
    bar = canvas.figure.colorbar(_colours(colours), ax=axes, pad=pad, aspect=aspect)
    bar.outline.set_visible(False)  # type: ignore[operator]
    number_ticks(bar.ax.yaxis, canvas.em)
    return bar.ax


def _colours(scale: Scale) -> ScalarMappable:
    """Returns the mapping of values to colours."""
    return ScalarMappable(_norm(scale), COLOUR_MAP)


def _norm(scale: Scale) -> Normalize:
    return (LogNorm if scale.log else Normalize)(scale.low, scale.high)


def _empty_cell(canvas: Canvas, corner: tuple[float, float], size: tuple[float, float], *, failed: bool) -> Rectangle:
    """Returns a cell without a value, hatched if its points failed."""
    theme = canvas.theme
    cell = Rectangle(corner, *size, facecolor=rgb(theme.grid), edgecolor="none", linewidth=0)
    if failed:
        cell.set(edgecolor=rgb(theme.grey), hatch="/////")
    return cell


def _edges(scale: Scale, count: int) -> np.ndarray:
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
