"""Draws the figure of a study: its title, key and panels."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjrun.plotting.canvas import Canvas
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.study.axes import Box, Sheet
from mjrun.plotting.study.drawing import GraphPanel, HeatPanel, RankPanel, StudyDrawing
from mjrun.plotting.study.graph import draw_graph, graph_key
from mjrun.plotting.study.heat_map import draw_heat_map, heat_key, heat_margins
from mjrun.plotting.study.key import Key, KeyEntry
from mjrun.plotting.study.parallel import draw_parallel
from mjrun.plotting.study.rank_bars import draw_rank_bars, rank_margin
from mjrun.plotting.theme import Theme

ABOVE, BELOW = 1.9, 3.3  # a panel: room for its label, and for its x axis where it is the lowest [em]
BETWEEN = 0.6  # rows that share an x axis [em]
UPPER = 1.25  # height of parallel coordinates, in rows of panels


def draw_study(drawing: StudyDrawing, grid: PanelGrid, theme: Theme, any_letter: bool) -> Canvas:
    """The canvas with the figure of a study; to be called, and saved, within `mjrun.plotting.canvas.settings`."""
    canvas = Canvas(grid.size, theme, any_letter)
    _Figure(drawing, grid, Sheet(canvas, grid.em)).paint()
    return canvas


@dataclass(frozen=True)
class _Margins:
    """Room beside the axes of a panel [pixels]."""

    left: float
    right: float


class _Figure:
    """One figure on a sheet."""

    def __init__(self, drawing: StudyDrawing, grid: PanelGrid, sheet: Sheet) -> None:
        self._drawing, self._sheet, self._em = drawing, sheet, grid.em
        self._side = grid.columns
        self._rows = -(-len(drawing.panels) // self._side)

    def paint(self) -> None:
        """Draws everything."""
        canvas, em, drawing = self._sheet.canvas, self._em, self._drawing
        top = 0.5 * em
        if drawing.title:
            text = canvas.fitted(drawing.title, canvas.width - 2 * em, 1.25 * em, bold=True)
            canvas.text(text, em, top + em, 1.25 * em, canvas.theme.ink, bold=True)
            top += 2.2 * em
        key = Key(canvas, self._key(), canvas.width - 2.5 * em, em)
        if key.height:
            key.draw(1.2 * em, top + 0.2 * em)
            top += key.height + 0.5 * em
        if drawing.above:
            share = UPPER / (UPPER + self._rows)
            bottom = top + share * (canvas.height - top)
            draw_parallel(self._sheet, drawing.above, Box(1.5 * em, top + 2.2 * em, canvas.width - em, bottom - em))
            top = bottom + 0.3 * em
        self._panels(top)

    def _panels(self, top: float) -> None:
        """All panels, from `top` on."""
        canvas, em, panels = self._sheet.canvas, self._em, self._drawing.panels
        lowest = [self._is_lowest(index) for index in range(len(panels))]
        inner = sum(any(lowest[row * self._side : (row + 1) * self._side]) for row in range(self._rows - 1))
        spent = self._rows * ABOVE + BELOW + inner * BELOW + (self._rows - 1 - inner) * BETWEEN
        height = (canvas.height - top - spent * em) / self._rows
        width = canvas.width / self._side
        margins = [self._margins(panels[column :: self._side], width, column) for column in range(self._side)]
        span = (canvas.width - sum(m.left + m.right for m in margins)) / self._side
        lefts = [sum(m.left + m.right for m in margins[:c]) + c * span + margins[c].left for c in range(self._side)]
        for row in range(self._rows):
            top += ABOVE * em
            cells = range(row * self._side, min((row + 1) * self._side, len(panels)))
            for index in cells:
                column = index % self._side
                box = Box(lefts[column], top, lefts[column] + span, top + height)
                self._panel(index, box, margins[column], lowest[index])
            top += height + (BELOW if any(lowest[index] for index in cells) else BETWEEN) * em

    def _is_lowest(self, index: int) -> bool:
        """Whether a panel shows its x axis: the last of a column does, and one above another that has other values."""
        panels, below = self._drawing.panels, index + self._side
        if below >= len(panels):
            return True
        mine, other = panels[index], panels[below]
        if isinstance(mine, GraphPanel) and isinstance(other, GraphPanel):
            return mine.x != other.x
        return type(mine) is not type(other)

    def _panel(self, index: int, box: Box, margins: _Margins, lowest: bool) -> None:
        panel, sheet = self._drawing.panels[index], self._sheet
        match panel:
            case GraphPanel():
                draw_graph(sheet, panel, box, lowest=lowest)
            case HeatPanel():
                draw_heat_map(sheet, panel, box, lowest=lowest)
            case RankPanel():
                names = margins.left if index % self._side == 0 else 0.0
                draw_rank_bars(sheet, panel, box, names, lowest=lowest)
        axis = panel.rows.name if isinstance(panel, HeatPanel) else ""
        sheet.title(panel.label, box, box.width + margins.right - 0.5 * self._em, axis)

    def _margins(self, panels: Sequence[object], width: float, column: int) -> _Margins:
        """The room beside the panels of a column that is so wide; names of parameters stand before the first."""
        sheet, em = self._sheet, self._em
        graphs = [panel for panel in panels if isinstance(panel, GraphPanel)]
        left, right = 1.2 * em, 1.2 * em
        if graphs:
            left = max(sheet.tick_width(sheet.y_ticks(panel.y, 20 * em)) for panel in graphs) + 1.5 * em
        maps = [panel for panel in panels if isinstance(panel, HeatPanel)]
        if maps:
            left, right = map(max, heat_margins(sheet, maps), (left, right))
        ranks = [panel for panel in panels if isinstance(panel, RankPanel)]
        if ranks and column == 0:
            left = max(left, rank_margin(sheet, ranks, width * self._side))
        return _Margins(left, right)

    def _key(self) -> list[KeyEntry]:
        panels = self._drawing.panels
        graphs = [panel for panel in panels if isinstance(panel, GraphPanel)]
        maps = [panel for panel in panels if isinstance(panel, HeatPanel)]
        return [*(heat_key(self._sheet, maps) if maps else []), *(graph_key(self._sheet, graphs) if graphs else [])]
