"""Draws figures with matplotlib: panels over one x axis, with names beside their curves."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from mjrun.plotting.canvas import POINT, Canvas, rgb
from mjrun.plotting.curve_text import Mark
from mjrun.plotting.drawing import Drawing, DrawnCurve, DrawnPanel
from mjrun.plotting.legend import Entry, Legend
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.theme import Theme
from mjrun.plotting.ticks import Ticks, linear_ticks, log_ticks

LEGEND, WIDE_LEGEND = 0.36, 0.5  # the most of a panel's room that its legend takes; more where all names fit then
NAMED = 8  # marks of one name that are all named
MANY = 40  # marks that are drawn faintly
# Room above a panel for the label of its y axis, between rows, and for the x axis [em].
ABOVE, BETWEEN, BELOW = 1.9, 0.5, 3.5


def draw(drawing: Drawing, grid: PanelGrid, theme: Theme, *, any_letter: bool = False) -> Canvas:
    """The canvas with a drawing; to be called, and saved, within `mjrun.plotting.canvas.settings`.

    Args:
      any_letter: whether letters that the font does not have are left as they are, for whoever shows them.
    """
    painter = _Painter(drawing, grid, Canvas(grid.size, theme, any_letter))
    painter.paint()
    return painter.canvas


@dataclass(frozen=True)
class _Panel:
    """A panel whose height and y axis are known: `top` and `bottom` of its axes [pixels]."""

    drawn: DrawnPanel
    axes: Axes
    top: float
    bottom: float
    ticks: Ticks
    legend: Legend


@dataclass(frozen=True)
class _Column:
    """Where the panels of a column are [pixels]."""

    left: float
    right: float


class _Painter:
    """Draws one figure: first heights and y axes, then what stands beside them, then what is between."""

    def __init__(self, drawing: Drawing, grid: PanelGrid, canvas: Canvas) -> None:
        self.canvas = canvas
        self._drawing, self._grid, self._theme, self._em = drawing, grid, canvas.theme, grid.em
        self._hair = max(0.8, grid.em / 16) * POINT
        self._x_range = drawing.x_range()

    def paint(self) -> None:
        """Draws everything."""
        rows = self._rows()
        side = self._grid.columns
        panels = [self._panel(panel, *rows[i // side], 1 / side) for i, panel in enumerate(self._drawing.panels)]
        columns, strip = self._columns(panels)
        for index, panel in enumerate(panels):
            column = columns[index % side]
            panel.axes.set_position(self.canvas.box(column.left, panel.top, column.right, panel.bottom))
            self._furnish(panel, column, lowest=index + side >= len(panels))
            if not strip:
                panel.legend.draw(column.right)
        if strip:
            panels[0].legend.draw(self.canvas.width - strip)
        self._vertical_marks(panels[:side], columns, panels)
        if self._drawing.title:
            size, left = 1.25 * self._em, columns[0].left
            text = self.canvas.fitted(self._drawing.title, self.canvas.width - left - self._em, size, bold=True)
            self.canvas.text(text, left, 1.4 * self._em, size, self._theme.ink, bold=True)

    # --- layout --------------------------------------------------------------------------------------

    def _rows(self) -> list[tuple[float, float]]:
        """Top and bottom of the axes in each row."""
        rows, em = self._grid.rows, self._em
        top = (2.6 if self._drawing.title else 0.4) * em
        bottom = self.canvas.height - BELOW * em
        height = (bottom - top - (rows * ABOVE + (rows - 1) * BETWEEN) * em) / rows
        starts = [top + ABOVE * em + row * (height + (ABOVE + BETWEEN) * em) for row in range(rows)]
        return [(start, start + height) for start in starts]

    def _panel(self, drawn: DrawnPanel, top: float, bottom: float, share: float) -> _Panel:
        """A panel, with its y axis and its legend, at most so large a share of the width."""
        axes = self.canvas.figure.add_axes(self.canvas.box(0, top, share * self.canvas.width, bottom))
        low, high = drawn.y_range()
        axes.set_yscale("log" if drawn.log else "linear")
        axes.set_ylim(low, high)
        most = (bottom - top) / (2.3 * self._em)
        ticks = log_ticks(low, high, most) if drawn.log else linear_ticks(low, high, min(8, most), drawn.is_whole())
        _set_ticks(axes.yaxis, ticks, shown=True)
        overhang = 0.2 * self._em
        entries = self._entries(drawn, (low, high), top, bottom)
        edges = top - overhang, bottom + overhang
        legend, wide = (
            Legend(self.canvas, entries, edges, part * share * self.canvas.width, self._em)
            for part in (LEGEND, WIDE_LEGEND)
        )
        legend = wide if legend.is_cut and not wide.is_cut else legend
        return _Panel(drawn, axes, top, bottom, ticks, legend)

    def _columns(self, panels: Sequence[_Panel]) -> tuple[list[_Column], float]:
        """The columns, whose panels have one width, and that of a legend that all panels share, if they do."""
        em, side = self._em, self._grid.columns
        names = [[entry.name for entry in panel.legend.entries] for panel in panels]
        is_shared = len(panels) > 1 and bool(names[0]) and all(each == names[0] for each in names)
        strip = panels[0].legend.width if is_shared else 0.0
        labels = [max(map(self._tick_width, panels[i::side])) + 1.5 * em for i in range(side)]
        legends = [max(1.5 * em, *(panel.legend.width for panel in panels[i::side])) for i in range(side)]
        legends = [1.5 * em] * side if is_shared else legends
        span = (self.canvas.width - strip - sum(labels) - sum(legends)) / side
        starts = [sum(labels[: i + 1]) + sum(legends[:i]) + i * span for i in range(side)]
        return [_Column(start, start + span) for start in starts], strip

    def _tick_width(self, panel: _Panel) -> float:
        return max((self.canvas.measure(label, 0.92 * self._em) for label in panel.ticks.labels), default=0.0)

    # --- axes ----------------------------------------------------------------------------------------

    def _furnish(self, panel: _Panel, column: _Column, *, lowest: bool) -> None:
        """The frame, grid, labels and curves of a panel whose place is known."""
        axes, theme, em = panel.axes, self._theme, self._em
        self._x_axis(axes, column.right - column.left, lowest=lowest)
        axes.set_facecolor("none")
        axes.set_axisbelow(True)
        axes.grid(True, which="major", color=rgb(theme.grid), linewidth=self._hair)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(rgb(theme.zero))
            spine.set_linewidth(self._hair)
        axes.tick_params(length=0, pad=0.35 * em * POINT, labelsize=0.92 * em * POINT, labelcolor=rgb(theme.grey))
        low, high = axes.get_ylim()
        if not panel.drawn.log and low < 0 < high:
            axes.axhline(0, color=rgb(theme.zero), linewidth=self._hair, zorder=1)

        room = (self.canvas.width if self._grid.columns == 1 else column.right) - column.left
        label = self.canvas.fitted(panel.drawn.label, room, em)
        axes.set_ylabel(label, rotation=0, ha="left", va="bottom", color=rgb(theme.ink), fontsize=em * POINT)
        axes.yaxis.set_label_coords(0, 1 + 0.4 * em / (panel.bottom - panel.top))
        for mark in panel.drawn.marks:
            axes.axhline(mark.value, color=rgb(theme.ink), linewidth=1.3 * self._hair, dashes=(5, 3), zorder=1.5)
        for curve in reversed(panel.drawn.curves):  # the first on top
            self._curve(axes, curve)

    def _x_axis(self, axes: Axes, span: float, *, lowest: bool) -> None:
        low, high = self._x_range
        axes.set_xscale("log" if self._drawing.log_x else "linear")
        axes.set_xlim(low, high)
        most = span / (5 * self._em)
        ticks = log_ticks(low, high, most) if self._drawing.log_x else linear_ticks(low, high, min(10, most))
        _set_ticks(axes.xaxis, ticks, shown=lowest)
        if lowest:
            label = self.canvas.fitted(self._drawing.x_label, span, self._em)
            pad = 0.3 * self._em * POINT
            axes.set_xlabel(label, color=rgb(self._theme.ink), fontsize=self._em * POINT, labelpad=pad)

    def _curve(self, axes: Axes, curve: DrawnCurve) -> None:
        line = self._sample(curve)
        line.set_data(curve.points.x, curve.points.y)
        axes.add_line(line)
        alone = _isolated(curve.points.y)
        if alone.any():
            x, y, size = curve.points.x[alone], curve.points.y[alone], 2.2 * line.get_linewidth()
            axes.plot(x, y, "o", markersize=size, color=line.get_color(), markeredgewidth=0, clip_on=False)

    def _sample(self, curve: DrawnCurve) -> Line2D:
        """A line that looks like a curve."""
        width = max(1.25, 0.125 * self._em) * self._theme.weight * POINT
        line = Line2D([], [], color=rgb(self._theme.colour(curve.colour)), linewidth=width)
        if pattern := self._theme.pattern(curve.colour, curve.variant):
            line.set_linestyle((0, pattern))
        line.set_dash_capstyle("butt")
        line.set_solid_capstyle("round")
        line.set_solid_joinstyle("round")
        return line

    # --- names ---------------------------------------------------------------------------------------

    def _entries(self, drawn: DrawnPanel, ends: tuple[float, float], top: float, bottom: float) -> list[Entry]:
        """A name for each curve and mark of a panel, at the height where it ends; none for a curve alone."""

        def height(value: float) -> float:
            return bottom - _share(value, *ends, drawn.log) * (bottom - top)

        entries: list[Entry] = []
        for curve in drawn.curves if len(drawn.curves) > 1 else ():
            finite = curve.points.y[np.isfinite(curve.points.y)]
            end = height(float(finite[-1])) if len(finite) else (top + bottom) / 2
            entries.append(Entry(curve.name, self._sample(curve), end))
        for mark in drawn.marks:
            line = Line2D([], [], color=rgb(self._theme.ink), linewidth=1.3 * self._hair, dashes=(3, 2))
            entries.append(Entry(mark.label, line, height(mark.value)))
        return entries

    def _vertical_marks(self, upper: Sequence[_Panel], columns: Sequence[_Column], panels: Sequence[_Panel]) -> None:
        """Lines through all panels, which are named in the `upper` ones."""
        low, high = self._x_range
        marks = [mark for mark in self._drawing.marks if low <= mark.value <= high]
        style, opacity = ((0, (5, 3)), 1.0) if len(marks) <= MANY else ("-", 0.35)
        for panel in panels:
            for mark in marks:
                line = panel.axes.axvline(mark.value, color=rgb(self._theme.grey), linewidth=self._hair, zorder=1.5)
                line.set_linestyle(style)
                line.set_alpha(opacity)
        for panel, column in zip(upper, columns, strict=False):
            self._mark_names(_named(marks), column, panel.top)

    def _mark_names(self, marks: Sequence[Mark], column: _Column, top: float) -> None:
        """The names of marks, one beside the other where there is room, else one below the other."""
        size = 0.85 * self._em
        ends = [-math.inf] * 3  # of the rows of names
        for mark in marks:
            share = _share(mark.value, *self._x_range, self._drawing.log_x)
            text = self.canvas.shown(mark.label)
            x, width = column.left + share * (column.right - column.left), self.canvas.measure(text, size)
            x += 0.35 * size if x + width + 0.35 * size <= column.right else -width - 0.35 * size
            row = next((row for row, end in enumerate(ends) if x > end), None)
            if row is not None:
                ends[row] = x + width + 0.5 * size
                self.canvas.text(text, x, top + (0.7 + 1.3 * row) * size, size, self._theme.grey, plate=True)


def _named(marks: Sequence[Mark]) -> list[Mark]:
    """The marks whose names are shown, from left to right: of many with one name the first, with their number."""
    counts, named = Counter(mark.label for mark in marks), dict[tuple[str, float], Mark]()
    for mark in sorted(marks, key=lambda mark: mark.value):
        count = counts[mark.label]
        if count <= NAMED:
            named[mark.label, mark.value] = mark
        elif (mark.label, math.nan) not in named:
            named[mark.label, math.nan] = Mark(f"{mark.label} × {count}", mark.value, vertical=True)
    return [mark for mark in named.values() if mark.label]


def _set_ticks(axis: Axis, ticks: Ticks, *, shown: bool) -> None:
    axis.set_major_locator(FixedLocator(ticks.values))
    axis.set_minor_locator(FixedLocator([]))
    axis.set_ticklabels(ticks.labels if shown else [""] * len(ticks.values))


def _share(value: float, low: float, high: float, log: bool) -> float:
    """Where a value is between two others."""
    if log:
        value, low, high = (math.log10(v) if v > 0 else -math.inf for v in (value, low, high))
    return min(max((value - low) / (high - low), 0.0), 1.0)


def _isolated(y: np.ndarray) -> np.ndarray:
    """Which values have a gap on both sides, so that no line shows them."""
    gap = np.isnan(y)
    before, after = np.concatenate([[True], gap[:-1]]), np.concatenate([gap[1:], [True]])
    return ~gap & before & after
