"""Draws the figure of a study: its title, key and panels, which matplotlib places."""

from collections.abc import Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from mjrun.plotting.canvas import POINT, SMALL, TITLE, Canvas, rgb
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.study.figure_data import GraphPanel, HeatPanel, RankPanel, StudyDrawing
from mjrun.plotting.study.graph import draw_graph, graph_key
from mjrun.plotting.study.heat_map import draw_heat_map, draw_parallel, heat_key, plate_labels

UPPER = 1.25  # height of parallel coordinates, in rows of panels
NAMES = 0.3  # the most of the figure that names of parameters take
REACH = 1.1  # of the axis of rank correlations, to either side
THICK = 0.62  # of a bar, as a share of its row


def paint_study(drawing: StudyDrawing, grid: PanelGrid, canvas: Canvas) -> None:
    """Draws the figure of a study on a canvas; to be called within `mjrun.plotting.canvas.settings`."""
    panels, side = drawing.panels, grid.columns
    rows = -(-len(panels) // side)
    key = _key(drawing, canvas)
    if key:
        _add_key(canvas, key, drawing.title)
    parts = canvas.figure.add_gridspec(
        2 if drawing.above else 1, 1, height_ratios=[UPPER, rows] if drawing.above else [1]
    )
    spec = parts[-1].subgridspec(rows, side)
    host = canvas.figure.add_subplot(parts[0]) if drawing.above else None
    if drawing.above and host:
        draw_parallel(canvas, drawing.above, host)
    for index, panel in enumerate(panels):
        axes = canvas.figure.add_subplot(spec[divmod(index, side)])
        axes.set_title(panel.label)
        match panel:
            case GraphPanel():
                draw_graph(canvas, panel, axes)
                label = panel.x.name
            case HeatPanel():
                draw_heat_map(canvas, panel, axes)
                axes.set_ylabel("" if index % side else panel.rows.name)
                label = panel.columns.name
            case RankPanel():
                _draw_rank_bars(canvas, panel, axes, named=index % side == 0)
                label = "rank correlation"
        if _is_lowest(drawing, index, side):
            axes.set_xlabel(label)
        else:
            axes.tick_params(labelbottom=False)
    canvas.settle("" if key else drawing.title)
    if host:
        plate_labels(canvas, host)


def _key(drawing: StudyDrawing, canvas: Canvas) -> dict[str, Artist]:
    graphs = [panel for panel in drawing.panels if isinstance(panel, GraphPanel)]
    maps = [panel for panel in drawing.panels if isinstance(panel, HeatPanel)]
    return {**(heat_key(canvas, maps) if maps else {}), **(graph_key(canvas, graphs) if graphs else {})}


def _add_key(canvas: Canvas, key: Mapping[str, Artist], title: str) -> None:
    """Puts a key above all panels, and above it the title: in one line if there is room, else in columns."""
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


def _draw_rank_bars(canvas: Canvas, panel: RankPanel, axes: Axes, *, named: bool) -> None:
    """Draws rank correlations as bars, with the number of each at the other side of zero, where it always has room."""
    theme, em = canvas.theme, canvas.em
    rows, values = np.arange(len(panel.parameters)), np.nan_to_num(panel.correlations)
    axes.set(xlim=(-REACH, REACH), ylim=(len(rows) - 0.5, -0.5))
    axes.spines["left"].set_visible(False)
    axes.set_xticks([-1, -0.5, 0, 0.5, 1], ["−1", "−0.5", "0", "0.5", "1"])
    names = [canvas.fitted(name, NAMES * canvas.width, SMALL * em) if named else "" for name in panel.parameters]
    axes.set_yticks(rows, names, color=rgb(theme.ink))
    axes.grid(True, axis="x")
    axes.barh(rows, values, THICK, color=[rgb(theme.colour(0 if value >= 0 else 1)) for value in values])
    axes.axvline(0, color=rgb(theme.zero), linewidth=1.5 * canvas.hair)
    for row, value in enumerate(panel.correlations.tolist()):
        text = "–" if np.isnan(value) else f"{value:+.2f}".replace("-", "−")
        axes.annotate(
            text,
            (0, row),
            xytext=((0.3 if value < 0 else -0.3) * em * POINT, 0),
            textcoords="offset points",
            ha="left" if value < 0 else "right",
            va="center_baseline",
            color=rgb(theme.grey),
            fontsize=0.85 * SMALL * em * POINT,
        )


def _is_lowest(drawing: StudyDrawing, index: int, side: int) -> bool:
    """Whether a panel shows its x axis: the last of a column does, and one above another that has other values."""
    panels, below = drawing.panels, index + side
    if below >= len(panels):
        return True
    mine, other = panels[index], panels[below]
    if isinstance(mine, GraphPanel) and isinstance(other, GraphPanel):
        return mine.x != other.x
    return type(mine) is not type(other)
