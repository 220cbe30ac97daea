"""Draws figures with matplotlib: panels over one x axis, with names beside their curves."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from matplotlib import font_manager, rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator

from mjrun.errors import clean
from mjrun.plotting.curve_text import Mark
from mjrun.plotting.drawing import Drawing, DrawnCurve, DrawnPanel
from mjrun.plotting.legend import Entry, legend_rows
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.theme import Theme
from mjrun.plotting.ticks import log_label, tick_labels

DPI = 96  # pixels per inch, as in CSS, so that sizes in an svg are those asked for
POINT = 72 / DPI  # [points per pixel]
FONT = "DejaVu Sans"  # which comes with matplotlib: Latin, Greek, Cyrillic and symbols
SETTINGS = {
    "font.family": [FONT],
    "text.parse_math": False,  # `$` and `_` in names are themselves
    "text.usetex": False,
    "axes.unicode_minus": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "mjrun",
    "pdf.fonttype": 42,
    "path.simplify": False,  # done already, without loss
    "agg.path.chunksize": 0,
}


@contextmanager
def settings() -> Iterator[None]:
    """Matplotlib with our settings, and none of the user's, which would make other pictures elsewhere."""
    with rc_context():
        import matplotlib

        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def draw(drawing: Drawing, grid: PanelGrid, theme: Theme, *, any_letter: bool = False) -> Figure:
    """The figure of a drawing; to be called, and saved, within `settings`.

    Args:
      any_letter: whether letters that the font does not have are left as they are, for whoever shows them.
    """
    return _Painter(drawing, grid, theme, any_letter).figure


@dataclass
class _Frame:
    """A panel's axes, its legend, and the labels of its ticks."""

    panel: DrawnPanel
    axes: Axes
    ticks: list[str]
    entries: list[Entry]


class _Painter:
    """One figure. Positions are in pixels from the top left until they are given to matplotlib."""

    def __init__(self, drawing: Drawing, grid: PanelGrid, theme: Theme, any_letter: bool) -> None:
        self._drawing, self._grid, self._theme, self._any_letter = drawing, grid, theme, any_letter
        self._em = grid.em
        self._width, self._height = grid.size
        self.figure = Figure(figsize=(self._width / DPI, self._height / DPI), dpi=DPI, facecolor=_rgb(theme.ground))
        self._canvas = FigureCanvasAgg(self.figure)
        self._x_range = drawing.x_range()
        self._line = 1.32 * self._em
        top = self._title()
        edges = self._rows(top)
        frames = [self._panel(index, panel, edges) for index, panel in enumerate(drawing.panels)]
        self._place(frames, edges)

    # --- layout --------------------------------------------------------------------------------------

    def _title(self) -> float:
        """Writes the title, and returns where the panels begin."""
        if not self._drawing.title:
            return 0.4 * self._em
        size = 1.25 * self._em
        text = self._fitted(self._drawing.title, self._width - 2 * self._em, size, "bold")
        self._text(text, self._em, 0.8 * self._em, size, va="top", weight="bold")
        return 2.6 * self._em

    def _rows(self, top: float) -> list[tuple[float, float]]:
        """Top and bottom of the axes in each row."""
        rows, em = self._grid.rows, self._em
        bottom = self._height - 3.5 * em
        above = 1.9 * em  # for the label of the y axis
        height = (bottom - top - rows * above - (rows - 1) * 0.5 * em) / rows
        starts = [top + above + row * (height + above + 0.5 * em) for row in range(rows)]
        return [(start, start + height) for start in starts]

    def _panel(self, index: int, panel: DrawnPanel, edges: Sequence[tuple[float, float]]) -> _Frame:
        """Axes with their curves, their range and the labels of their ticks; their width is found later."""
        top, bottom = edges[index // self._grid.columns]
        axes = self.figure.add_axes((0.1, 1 - bottom / self._height, 0.8, (bottom - top) / self._height))
        low, high = panel.y_range()
        axes.set_yscale("log" if panel.log else "linear")
        axes.set_ylim(low, high)
        marks = _log_ticks(low, high, bottom - top, self._em) if panel.log else None
        if marks is None:
            most = max(1, min(8, int((bottom - top) / (2.3 * self._em))))
            marks = _linear_ticks(low, high, most, panel.is_whole())
            ticks = tick_labels(marks)
        else:
            ticks = [log_label(value) for value in marks]
        axes.yaxis.set_major_locator(FixedLocator(marks))
        axes.yaxis.set_minor_locator(FixedLocator([]))
        return _Frame(panel, axes, ticks, self._entries(panel, axes, top, bottom))

    def _place(self, frames: Sequence[_Frame], edges: Sequence[tuple[float, float]]) -> None:
        """Gives all panels one width, beside the widest tick label and the widest legend."""
        em, columns = self._em, self._grid.columns
        left = max(self._measure(tick, 0.92 * em) for frame in frames for tick in frame.ticks or [""]) + 1.5 * em
        shared = self._shared_legend(frames)
        cell = (self._width - 0.6 * em) / columns
        legends = [self._legend(frame, 0.36 * cell, edges[i // columns]) for i, frame in enumerate(frames)]
        right = max([width for width, _ in legends if width] + [1.2 * em])
        if shared:
            right = 1.2 * em
        strip = legends[0][0] if shared else 0.0
        cell = (self._width - 0.6 * em - strip) / columns
        for index, (frame, (_, draw_legend)) in enumerate(zip(frames, legends, strict=True)):
            begin = index % columns * cell + left
            span = cell - left - right
            top, bottom = edges[index // columns]
            box = (begin / self._width, 1 - bottom / self._height, span / self._width, (bottom - top) / self._height)
            frame.axes.set_position(box)
            self._furnish(frame, begin, span, index + columns >= len(frames), edges[index // columns])
            if not shared:
                draw_legend(begin + span)
            elif index == 0:
                draw_legend(self._width - strip - 0.6 * em)
        if self._drawing.marks:
            self._vertical_marks(frames)

    # --- axes ----------------------------------------------------------------------------------------

    def _furnish(self, frame: _Frame, begin: float, span: float, lowest: bool, edge: tuple[float, float]) -> None:
        """The frame, grid, ticks, labels and curves of a panel whose place is known."""
        axes, theme, em = frame.axes, self._theme, self._em
        self._x_axis(axes, span, lowest)
        axes.set_yticklabels([self._shown(tick) for tick in frame.ticks])
        hair = max(0.8, em / 16) * POINT
        axes.set_facecolor("none")
        axes.set_axisbelow(True)
        axes.grid(True, which="major", color=_rgb(theme.grid), linewidth=hair)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(_rgb(theme.zero))
            spine.set_linewidth(hair)
        axes.tick_params(length=0, pad=0.35 * em * POINT, labelsize=0.92 * em * POINT, labelcolor=_rgb(theme.grey))
        low, high = axes.get_ylim()
        if not frame.panel.log and low < 0 < high:
            axes.axhline(0, color=_rgb(theme.zero), linewidth=hair, zorder=1)

        room = self._width - begin if self._grid.columns == 1 else span
        label = self._fitted(frame.panel.label, room, em)
        axes.set_ylabel(label, rotation=0, ha="left", va="bottom", color=_rgb(theme.ink), fontsize=em * POINT)
        axes.yaxis.set_label_coords(0, 1 + 0.4 * em / (edge[1] - edge[0]))
        for mark in frame.panel.marks:
            axes.axhline(mark.value, color=_rgb(theme.ink), linewidth=1.3 * hair, dashes=(5, 3), zorder=1.5)
        for curve in reversed(frame.panel.curves):  # the first on top
            self._curve(axes, curve)

    def _x_axis(self, axes: Axes, span: float, lowest: bool) -> None:
        low, high = self._x_range
        axes.set_xscale("log" if self._drawing.log_x else "linear")
        axes.set_xlim(low, high)
        if self._drawing.log_x:
            marks = _log_ticks(low, high, span, 2.5 * self._em) or [low, high]
            labels = [log_label(value) for value in marks]
        else:
            most = max(1, min(10, int(span / (5 * self._em))))
            marks = _linear_ticks(low, high, most)
            labels = tick_labels(marks)
        axes.xaxis.set_major_locator(FixedLocator(marks))
        axes.xaxis.set_minor_locator(FixedLocator([]))
        axes.set_xticklabels([self._shown(label) for label in labels] if lowest else [""] * len(marks))
        if lowest:
            axes.set_xlabel(
                self._fitted(self._drawing.x_label, span, self._em),
                color=_rgb(self._theme.ink),
                fontsize=self._em * POINT,
                labelpad=0.3 * self._em * POINT,
            )

    def _curve(self, axes: Axes, curve: DrawnCurve) -> None:
        line = self._sample(curve)
        line.set_data(curve.points.x, curve.points.y)
        line.set_gid(None)
        axes.add_line(line)
        alone = _isolated(curve.points.y)
        if alone.any():
            axes.plot(
                curve.points.x[alone],
                curve.points.y[alone],
                linestyle="none",
                marker="o",
                markersize=2.2 * line.get_linewidth(),
                color=line.get_color(),
                markeredgewidth=0,
            )

    def _sample(self, curve: DrawnCurve) -> Line2D:
        """A line as that of a curve."""
        pattern = self._theme.pattern(curve.colour, curve.variant)
        line = Line2D([], [], color=_rgb(self._theme.colour(curve.colour)), linewidth=self._weight)
        if pattern:
            line.set_linestyle((0, pattern))
        line.set_dash_capstyle("butt")
        line.set_solid_capstyle("round")
        line.set_solid_joinstyle("round")
        return line

    @property
    def _weight(self) -> float:
        """The width of curves [points]."""
        return max(1.25, 0.125 * self._em) * self._theme.weight * POINT

    # --- legends -------------------------------------------------------------------------------------

    def _entries(self, panel: DrawnPanel, axes: Axes, top: float, bottom: float) -> list[Entry]:
        """A name for each curve and mark of a panel, at the height where it ends; none for a curve alone."""
        entries: list[Entry] = []
        if len(panel.curves) > 1:
            for curve in panel.curves:
                finite = curve.points.y[np.isfinite(curve.points.y)]
                share = _share(finite[-1], *axes.get_ylim(), panel.log) if len(finite) else 0.5
                entries.append(Entry(curve.name, self._sample(curve), bottom - share * (bottom - top)))
        for mark in panel.marks:
            share = _share(mark.value, *axes.get_ylim(), panel.log)
            line = Line2D([], [], color=_rgb(self._theme.ink), linewidth=max(0.8, self._em / 16) * POINT * 1.3)
            line.set_dashes((3, 2))
            entries.append(Entry(mark.label, line, bottom - share * (bottom - top)))
        return entries

    def _shared_legend(self, frames: Sequence[_Frame]) -> bool:
        """Whether all panels have the same names, which stand once then."""
        names = [[entry.name for entry in frame.entries] for frame in frames]
        return len(frames) > 1 and bool(names[0]) and all(each == names[0] for each in names)

    def _legend(self, frame: _Frame, most: float, edge: tuple[float, float]) -> tuple[float, Callable[[float], None]]:
        """The width of a legend, and what draws it from a place on."""
        if not frame.entries:
            return 0.0, lambda x: None
        rows = legend_rows(frame.entries, edge[0] - 0.2 * self._em, edge[1] + 0.2 * self._em, self._line)
        size = rows.scale * 0.95 * self._em
        widths: list[float] = []
        texts: list[list[str]] = []
        for column in rows.columns:
            room = most / len(rows.columns) - 2.6 * size
            texts.append([self._fitted(entry.name, room, size) for entry in column])
            widths.append(max(self._measure(text, size) for text in texts[-1]) + 2.6 * size)

        def draw_from(x: float) -> None:
            pen = x + 0.5 * self._em
            for column, shown, width in zip(rows.columns, texts, widths, strict=True):
                for entry, text in zip(column, shown, strict=True):
                    entry.line.set_transform(self.figure.transFigure)
                    ends = np.array([pen, pen + 1.5 * size]) / self._width
                    entry.line.set_data(ends, [1 - entry.y / self._height] * 2)
                    self.figure.add_artist(entry.line)
                    self._text(text, pen + 1.9 * size, entry.y, size)
                pen += width

        return sum(widths) + 1.0 * self._em, draw_from

    def _vertical_marks(self, frames: Sequence[_Frame]) -> None:
        """Lines through all panels; their labels are in the first row, one beside the other where there is room."""
        theme, size = self._theme, 0.85 * self._em
        hair = max(0.8, self._em / 16) * POINT
        low, high = self._x_range
        marks = [mark for mark in self._drawing.marks if low <= mark.value <= high]
        for frame in frames:
            for mark in marks:
                frame.axes.axvline(mark.value, color=_rgb(theme.grey), linewidth=hair, dashes=(5, 3), zorder=1.5)
        for frame in frames[: self._grid.columns]:
            box = frame.axes.get_position()
            self._mark_labels(marks, box.x0 * self._width, box.x1 * self._width, (1 - box.y1) * self._height, size)

    def _mark_labels(self, marks: Sequence[Mark], left: float, right: float, top: float, size: float) -> None:
        low, high = self._x_range
        ends = [-math.inf] * 3  # of the rows of labels
        for mark in sorted(marks, key=lambda mark: mark.value):
            share = _share(mark.value, low, high, self._drawing.log_x)
            x, width = left + share * (right - left) + 0.35 * size, self._measure(self._shown(mark.label), size)
            if x + width > right:
                x -= width + 0.7 * size
            row = next((row for row, end in enumerate(ends) if x > end), None)
            if row is None or not mark.label:
                continue
            ends[row] = x + width + 0.5 * size
            plate = {"facecolor": _rgb(self._theme.ground), "edgecolor": "none", "alpha": 0.8, "pad": 0.1 * size}
            self._text(self._shown(mark.label), x, top + (0.7 + 1.3 * row) * size, size, colour="grey", bbox=plate)

    # --- text ----------------------------------------------------------------------------------------

    def _text(
        self,
        text: str,
        x: float,
        y: float,
        size: float,
        *,
        va: str = "center",
        weight: str = "normal",
        colour: str = "ink",
        bbox: dict[str, object] | None = None,
    ) -> None:
        self.figure.text(
            x / self._width,
            1 - y / self._height,
            text,
            fontsize=size * POINT,
            va="center_baseline" if va == "center" else va,
            ha="left",
            weight=weight,
            color=_rgb(self._theme.grey if colour == "grey" else self._theme.ink),
            bbox=bbox,
            zorder=5,
        )

    def _measure(self, text: str, size: float, weight: str = "normal") -> float:
        """The width of a text [pixels]."""
        font = font_manager.FontProperties(family=FONT, size=size * POINT, weight=weight)
        return float(self._canvas.get_renderer().get_text_width_height_descent(_drawable(text), font, False)[0])

    def _fitted(self, text: str, room: float, size: float, weight: str = "normal") -> str:
        """`text` in `room` [pixels]: its middle is left out if need be."""
        text = self._shown(text)
        if self._measure(text, size, weight) <= room:
            return text
        for kept in range(min(len(text), 200), 1, -1):
            head = kept // 3
            short = f"{text[:head]}…{text[len(text) - (kept - head) :]}"
            if self._measure(short, size, weight) <= room:
                return short
        return text[:1]

    def _shown(self, text: str) -> str:
        """A text as it can be drawn: cleaned, and what the font does not have as its number, `\\u4f4d`."""
        return clean(text) if self._any_letter else _drawable(clean(text))


def _drawable(text: str) -> str:
    letters = _letters()
    return "".join(c if ord(c) in letters else c.encode("ascii", "backslashreplace").decode() for c in text)


def _letters() -> dict[int, int]:
    return font_manager.get_font(font_manager.findfont(FONT)).get_charmap()


def _rgb(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    return colour[0] / 255, colour[1] / 255, colour[2] / 255


def _scaled(value: float, log: bool) -> float:
    return math.log10(value) if log and value > 0 else value


def _share(value: float, low: float, high: float, log: bool) -> float:
    value, low, high = (_scaled(v, log) for v in (value, low, high))
    return (value - low) / (high - low)


def _linear_ticks(low: float, high: float, most: int, whole: bool = False) -> list[float]:
    values = MaxNLocator(most, steps=[1, 2, 2.5, 5, 10], integer=whole).tick_values(low, high)
    return [float(value) for value in values if low <= value <= high]


def _log_ticks(low: float, high: float, length: float, em: float) -> list[float] | None:
    """Powers of ten within a range, and their multiples where those are few; None if there are none."""
    most = max(2, int(length / (2.3 * em)))
    for multiples in ((1.0,), (1.0, 2.0, 5.0), tuple(map(float, range(1, 10)))):
        marks = [float(v) for v in LogLocator(10, multiples, numticks=most).tick_values(low, high) if low <= v <= high]
        if len(marks) > 2:
            return marks
    return marks or None


def _isolated(y: np.ndarray) -> np.ndarray:
    """Which values have a gap on both sides, so that no line shows them."""
    gap = np.isnan(y)
    before, after = np.concatenate([[True], gap[:-1]]), np.concatenate([gap[1:], [True]])
    return ~gap & before & after
