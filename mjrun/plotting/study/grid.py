"""The size of the figure of a study, and the places of its panels."""

from mjrun.plotting.panel_grid import PanelCount, PanelGrid, panel_grid
from mjrun.plotting.study.drawing import HeatPanel, RankPanel, StudyDrawing


def study_grid(drawing: StudyDrawing, size: tuple[int, int] | None) -> PanelGrid:
    """The size of a figure, and the places of its panels.

    Raises:
      BadValueError: they have no room in `size` pixels.
    """
    panels = len(drawing.panels)
    most = 2 if panels == 4 else 3  # four are two by two
    side = drawing.columns or (1 if panels < 3 and not _is_heat(drawing) else min(most, panels))
    if drawing.columns is None and size and size[0] < 900:
        side = 1
    names = max((len(p.parameters) + 2 for p in drawing.panels if isinstance(p, RankPanel)), default=0)
    above = min(side, panels) if drawing.above else 0
    return panel_grid(PanelCount(panels + above, names, bool(drawing.title)), size, min(side, panels))


def _is_heat(drawing: StudyDrawing) -> bool:
    return isinstance(drawing.panels[0], HeatPanel)
