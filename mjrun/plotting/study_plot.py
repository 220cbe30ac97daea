"""Plots of studies: the folders that `mjrun sweep` writes."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from mjrun.errors import UsageError, listing, option, quoted
from mjrun.formats.atomic_output import publish_together
from mjrun.formats.image_format import figure_format
from mjrun.formats.study_folder import read_study
from mjrun.formats.table_reader import STDIN
from mjrun.options.option import is_given, options
from mjrun.options.plot import TablePlotOptions
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib, svg_text
from mjrun.plotting.html_page import Page, PageFigure
from mjrun.plotting.page_writer import MAKER, PageWriter, included
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.study.figure_data import StudyDrawing, study_grid
from mjrun.plotting.study.plan import StudyPlan
from mjrun.plotting.table_plot import TablePlotResult
from mjrun.plotting.theme import adaptive
from mjrun.reporter import Reporter, WarningReporter

OF_TABLES = ("mark", "mark_event", "assert")  # options that mean nothing to a study


@options
class StudyPlot(TablePlotOptions):
    """A plot of a study: its options are keywords."""

    def run(self, reporter: Reporter | None = None) -> TablePlotResult:
        """Makes the plot, and the page.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        reporter = reporter or WarningReporter()
        require_matplotlib()
        if self.output is None and self.html is None:
            raise UsageError(f"there is nothing to make: give {option('output')}, {option('html')} or both")
        for name in OF_TABLES:
            if is_given(self, name):
                raise UsageError(f"{option(name)} is for tables, and {quoted(self.folder)} is a study")

        results = read_study(self.folder)
        plan = StudyPlan(results, self)
        drawing = plan.drawing
        grid = study_grid(drawing, self.size)
        for text in plan.notes:
            reporter.note(text)
        self._write(drawing, grid, plan.notes)
        target = None if self.output == STDIN else self.output
        return TablePlotResult(
            path=self.output or str(self.html),
            format=figure_format(target, self.format) if self.output else "html",
            size=grid.size,
            tables=[self.folder],
            rows=[len(results)],
            panels=[panel.label for panel in drawing.panels],
            curves=sum(panel.curves for panel in drawing.panels),
            notes=plan.notes,
            html=self.html,
        )

    def _write(self, drawing: StudyDrawing, grid: PanelGrid, notes: Sequence[str]) -> None:
        """Writes the picture and the page: both, or neither."""
        writers: list[FigureWriter | PageWriter] = []
        with ExitStack() as stack:
            if self.output:
                target = None if self.output == STDIN else self.output
                tags = {"comment": MAKER} | ({"title": self.title} if self.title else {})
                picture = FigureWriter(target, figure_format(target, self.format), grid.size, tags)
                stack.enter_context(picture).write(drawing, grid, self.style)
                writers.append(picture)
            if self.html:
                page = stack.enter_context(PageWriter(self.html))
                svg = svg_text(drawing, grid, self.style)
                names = listing([panel.label for panel in drawing.panels])
                figure = PageFigure(adaptive(svg) if self.style == "light" else svg, names, notes)
                files, manifests = included(self.include, self.html, self.embed_up_to)
                page.write(Page(self.title or self.folder, MAKER, [figure], files=files, manifests=manifests))
                writers.append(page)
            publish_together(writers)

    @property
    def folder(self) -> str:
        """The study.

        Raises:
          UsageError: there are several.
        """
        folders = [self.tables] if isinstance(self.tables, str | Path) else self.tables
        if len(folders) != 1:
            raise UsageError(f"a plot shows one study, or tables, not {listing(list(map(str, folders)))}")
        return str(folders[0])
