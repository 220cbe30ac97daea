"""Drawing of figures with matplotlib: panels over one x axis, with names beside their curves.

matplotlib places the panels. Names are placed at the heights where their curves end if they fit there, which no legend
of matplotlib does; otherwise in columns.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.transforms import Affine2DBase, ScaledTranslation, blended_transform_factory

from mjrun.dataclass import dataclass
from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.figure_data import DPI, POINT, AxisScale, DrawnFigure, DrawnPanel, PanelGrid
from mjrun.plotting.matplotlib_layout import MatplotlibFigure, curve_line, dot_size, rgb, set_scales

LEGEND, WIDE_LEGEND = 0.36, 0.5  # maximum share of a panel's width for its legend; the latter if all names then fit
NAMED = 8  # maximum number of reference lines with one name that are all labelled
MANY = 40  # number of reference lines above which they are drawn faintly
BESIDE = 6  # maximum number of names placed where their curves end
SMALLEST = 0.75  # minimum share of the usual size of letters
LINE = 1.32  # [em]
SAMPLE, GAP, AFTER = 1.5, 0.4, 0.7  # length of the line before a name, of the gap to it, and after the name [em]
LETTERS = 0.95  # size of names [em]
# Approximate room for the title, above each panel, and for the x axis, from which heights of names follow [em].
TITLE_ROOM, ABOVE, BELOW = 2.6, 2.5, 3.4


def paint(drawing: DrawnFigure, grid: PanelGrid, canvas: MatplotlibFigure) -> None:
    """Draws a figure on a canvas; to be called within `mjrun.plotting.matplotlib_layout.settings`."""
    spec = canvas.figure.add_gridspec(grid.rows, grid.columns)
    count = len(drawing.panels)
    panels: list[Axes] = []
    for index, panel in enumerate(drawing.panels):
        axes = canvas.figure.add_subplot(spec[divmod(index, grid.columns)])
        lowest = index + grid.columns >= count
        _furnish(canvas, axes, drawing, panel, lowest=lowest)
        panels.append(axes)
    title = TITLE_ROOM if drawing.title else 0.0
    height = (canvas.height - (title + BELOW) * canvas.em) / grid.rows - ABOVE * canvas.em
    legends = [
        _Legend(canvas, axes, panel, (height, canvas.width / grid.columns), drawing.legend_title)
        for axes, panel in zip(panels, drawing.panels, strict=True)
    ]
    names = [[entry.name for entry in legend.entries] for legend in legends]
    is_shared = count > 1 and all(each == names[0] for each in names)
    for legend in legends[min(count, grid.columns) - 1 :][:1] if is_shared else legends:
        legend.draw()
    canvas.settle(drawing.title)
    _reference_lines(canvas, drawing, panels, panels[: grid.columns])


def _furnish(canvas: MatplotlibFigure, axes: Axes, drawing: DrawnFigure, panel: DrawnPanel, *, lowest: bool) -> None:
    """Draws a panel without the names of its curves."""
    theme = canvas.theme
    set_scales(canvas, axes, drawing.x, panel.y)
    axes.set_title(canvas.shown(panel.label))
    axes.set_ylabel(canvas.shown(panel.axis_label))
    if lowest:
        axes.set_xlabel(canvas.shown(drawing.x_label))
    else:
        axes.tick_params(labelbottom=False)

    for line in panel.marks:
        axes.axhline(line.value, color=rgb(theme.ink), linewidth=1.3 * canvas.hair, dashes=(5, 3), zorder=1.5)
    for curve in reversed(panel.curves):  # the first on top
        drawn = curve_line(theme, curve.colour, curve.variant, turn=curve.turn)
        drawn.set_data(curve.points.x, curve.points.y)
        axes.add_line(drawn)
        alone = _isolated(curve.points.y)
        if alone.any():
            x, y = curve.points.x[alone], curve.points.y[alone]
            size = dot_size(len(x)) * canvas.weight
            clip = bool(panel.limits or drawing.x_limits)
            axes.plot(x, y, "o", markersize=size, color=drawn.get_color(), markeredgewidth=0, clip_on=clip)


def _isolated(y: np.ndarray) -> np.ndarray:
    """Returns which values have a gap on both sides, so that no line shows them."""
    gap = np.isnan(y)
    before, after = np.concatenate([[True], gap[:-1]]), np.concatenate([gap[1:], [True]])
    return ~gap & before & after


@dataclass(frozen=True)
class CurveLabel:
    """A name, a sample of its line, and its height [pixels from the bottom of the panel]."""

    name: str
    line: Line2D
    y: float


class _Legend:
    """The names beside the curves of a panel.

    Args:
      size: approximate height of the panel, and width with everything beside it [pixels].
      title: title above the names.
    """

    def __init__(
        self, canvas: MatplotlibFigure, axes: Axes, panel: DrawnPanel, size: tuple[float, float], title: str = ""
    ) -> None:
        self._canvas, self._axes = canvas, axes
        self._height, width = size
        self.entries = self._named(panel)
        self._title = title if self.entries else ""
        overhang = 0.2 * canvas.em
        top = self._height + overhang - (LINE * canvas.em if self._title else 0.0)
        self._columns, scale = arranged(self.entries, -overhang, top, LINE * canvas.em)
        self._size = scale * LETTERS * canvas.em
        room, wide = (self._texts(part * width) for part in (LEGEND, WIDE_LEGEND))
        whole = [[canvas.shown(entry.name) for entry in column] for column in self._columns]
        self._fitted = wide if wide == whole else room

    def draw(self) -> None:
        """Draws all names, to the right of the panel."""
        canvas, axes, size = self._canvas, self._axes, self._size
        edge = ScaledTranslation(1, 0, cast(Affine2DBase, axes.transAxes))
        beside = blended_transform_factory(canvas.figure.dpi_scale_trans + edge, axes.transAxes)  # inches, and shares
        left = 0.5 * canvas.em
        if self._title:
            widths = [canvas.measure(text, size) for texts in self._fitted for text in texts]
            text = canvas.fitted(self._title, (SAMPLE + GAP) * size + max(widths), size)
            y = 1 - 0.4 * LINE * canvas.em / self._height
            axes.text(left / DPI, y, text, transform=beside, va="center_baseline", fontsize=size * POINT, weight="bold")
        for column, texts in zip(self._columns, self._fitted, strict=True):
            x = left + (SAMPLE + GAP) * size
            for entry, text in zip(column, texts, strict=True):
                y, line = entry.y / self._height, entry.line
                line.set(transform=beside, clip_on=False, data=([left / DPI, (left + SAMPLE * size) / DPI], [y, y]))
                axes.add_line(line)
                axes.text(x / DPI, y, text, transform=beside, va="center_baseline", fontsize=size * POINT)
            left = x + max(canvas.measure(text, size) for text in texts) + AFTER * size

    def _named(self, panel: DrawnPanel) -> list[CurveLabel]:
        """Returns a name for each curve and reference line, at the height of its end; none for a single curve."""
        canvas, scale = self._canvas, panel.y
        entries: list[CurveLabel] = []
        for curve in panel.curves if len(panel.curves) > 1 else ():
            finite = curve.points.y[np.isfinite(curve.points.y)]
            share = _share(float(finite[-1]), scale) if len(finite) else 0.5
            entries.append(
                CurveLabel(curve.name, curve_line(canvas.theme, curve.colour, curve.variant), share * self._height)
            )
        for mark in panel.marks:
            line = Line2D([], [], color=rgb(canvas.theme.ink), linewidth=1.3 * canvas.hair, dashes=(3, 2))
            entries.append(CurveLabel(mark.label, line, _share(mark.value, scale) * self._height))
        return entries

    def _texts(self, room: float) -> list[list[str]]:
        """Returns the names of each column, shortened to a `room` for all columns [pixels]."""
        most = room / max(1, len(self._columns)) - (SAMPLE + GAP + AFTER) * self._size
        return [[self._canvas.fitted(entry.name, most, self._size) for entry in column] for column in self._columns]


def arranged(
    entries: Sequence[CurveLabel], bottom: float, top: float, line: float
) -> tuple[list[list[CurveLabel]], float]:
    """Arranges entries in columns, at least a `line` apart from `bottom` to `top` [pixels], and returns the scale of
    their letters: a few are placed where their curves end, more of them from top to bottom.
    """
    if not entries:
        return [], 1.0
    room = max(1, int((top - bottom) / line))
    if len(entries) <= min(BESIDE, room):
        descending = sorted(entries, key=lambda entry: entry.y, reverse=True)  # the first of equals is above
        return [_spread(descending[::-1], bottom, top, line)], 1.0
    scale = max(SMALLEST, min(1.0, (top - bottom) / line / len(entries)))
    line *= scale
    rows = max(1, int((top - bottom) / line + 1e-6))  # they may fit exactly
    count = -(-len(entries) // rows)
    rows = -(-len(entries) // count)
    columns = [entries[start : start + rows] for start in range(0, len(entries), rows)]
    step = min(1.25 * line, (top - bottom) / rows)
    return [[replace(e, y=top - (i + 0.5) * step) for i, e in enumerate(column)] for column in columns], scale


def _spread(entries: Sequence[CurveLabel], bottom: float, top: float, line: float) -> list[CurveLabel]:
    """Moves entries apart as little as possible, in the order of their heights: clusters keep their mean."""

    def placed(cluster: list[CurveLabel]) -> float:
        half = len(cluster) * line / 2
        return min(max(sum(entry.y for entry in cluster) / len(cluster), bottom + half), top - half)

    clusters: list[tuple[float, list[CurveLabel]]] = []
    for entry in entries:
        cluster = [replace(entry, y=min(max(entry.y, bottom + line / 2), top - line / 2))]
        centre = placed(cluster)
        while clusters and clusters[-1][0] + line * len(clusters[-1][1]) / 2 > centre - line * len(cluster) / 2:
            cluster = clusters.pop()[1] + cluster
            centre = placed(cluster)
        clusters.append((centre, cluster))
    return [
        replace(entry, y=centre + (index - (len(cluster) - 1) / 2) * line)
        for centre, cluster in clusters
        for index, entry in enumerate(cluster)
    ]


def _reference_lines(
    canvas: MatplotlibFigure, drawing: DrawnFigure, panels: Sequence[Axes], upper: Sequence[Axes]
) -> None:
    """Draws vertical lines through all panels, and their names in the `upper` ones."""
    scale = drawing.x
    lines = [line for line in drawing.marks if scale.low <= line.value <= scale.high]
    style, opacity = ((0, (5, 3)), 1.0) if len(lines) <= MANY else ("-", 0.35)
    colour = rgb(canvas.theme.grey)
    for axes in panels:
        for line in lines:
            axes.axvline(line.value, color=colour, linewidth=canvas.hair, zorder=1.5, linestyle=style, alpha=opacity)

    size, plate = 0.85 * canvas.em, {"facecolor": rgb(canvas.theme.ground), "edgecolor": "none", "alpha": 0.8}
    for axes in upper:
        box = axes.get_window_extent()
        ends = [-math.inf] * 3  # of the rows of names
        for line in _named(lines):
            text = canvas.shown(line.label)
            x, width = _share(line.value, scale) * box.width, canvas.measure(text, size)
            x += 0.35 * size if x + width + 0.35 * size <= box.width else -width - 0.35 * size
            row = next((row for row, end in enumerate(ends) if x > end), None)
            if row is not None:
                ends[row] = x + width + 0.5 * size
                axes.annotate(
                    text,
                    (0, 1),
                    xycoords="axes fraction",
                    xytext=(x * POINT, -(0.7 + 1.3 * row) * size * POINT),
                    textcoords="offset points",
                    va="center_baseline",
                    fontsize=size * POINT,
                    color=colour,
                    bbox={**plate, "pad": 0.1 * size},
                    zorder=5,
                )


def _named(lines: Sequence[ReferenceLine]) -> list[ReferenceLine]:
    """Returns the lines to label, from left to right: the first of many with one name, with their number."""
    counts, named = Counter(line.label for line in lines), dict[tuple[str, float], ReferenceLine]()
    for line in sorted(lines, key=lambda line: line.value):
        count = counts[line.label]
        if count <= NAMED:
            named[line.label, line.value] = line
        elif (line.label, math.nan) not in named:
            named[line.label, math.nan] = replace(line, label=f"{line.label} × {count}")
    return [line for line in named.values() if line.label]


def _share(value: float, scale: AxisScale) -> float:
    """Returns the position of a value on an axis, from 0 to 1."""
    low, high = scale.low, scale.high
    if scale.log:
        value, low, high = (math.log10(v) if v > 0 else -math.inf for v in (value, low, high))
    return min(max((value - low) / (high - low), 0.0), 1.0)
