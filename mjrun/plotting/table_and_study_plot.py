"""Plots of tables and of studies, as images and as pages."""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FailedAssertionError, UsageError, clean, counted, listing, option, quoted
from mjrun.formats.image_format import figure_format
from mjrun.formats.output_writer import publish_together
from mjrun.formats.study_reader import RESULTS, read_study
from mjrun.formats.table_reader import STDIN
from mjrun.options.option import is_given, options
from mjrun.options.plot import TablePlotOptions
from mjrun.plotting import html_page
from mjrun.plotting.figure_writer import FigureWriter, page_svg, require_matplotlib
from mjrun.plotting.html_page import MAKER, FileManifest, Page, PageFigure, PageWriter, TableStatistics, media_html
from mjrun.plotting.study.figure_data import study_grid
from mjrun.plotting.study.plan import StudyFigurePlan
from mjrun.plotting.table_figure import TableFigure
from mjrun.plotting.table_statistics import TableSummarizer
from mjrun.probe.verdict import Verdict
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.suffixes import HTML

SCHEMA = "mjrun-plot-1"  # schema of the report
OF_TABLES = ("mark_event", "assert", "label")  # options that do not apply to a study


@options
class TablePlot(TablePlotOptions):
    """A plot of tables: its options are keywords.

    Args:
      command: the command line, for the page.
    """

    command: str = ""

    @property
    def paths(self) -> list[str]:
        """The tables, or the folders of studies."""
        tables = [self.tables] if isinstance(self.tables, str | Path) else self.tables
        return [str(table) for table in tables]

    def run(self, reporter: Reporter | None = None) -> "TablePlotResult":
        """Writes the plot and the page.

        Raises:
          FailedAssertionError: an assertion fails; everything is published nevertheless.
          MjrunError: nothing was published, and existing outputs are unchanged.
        """
        reporter = reporter or PythonApiReporter()
        _check_outputs(self)
        with ExitStack() as stack:
            if self.label and len(self.label) != len(self.paths):
                raise UsageError(
                    f"{option('label')}: {counted(len(self.label), 'name')} for {counted(len(self.paths), 'table')}"
                )
            figure = TableFigure(self.paths, self, stack, self.label)
            size = figure.plan.grid.size
            picture = stack.enter_context(_open_picture(self, size)) if self.output else None
            page = stack.enter_context(PageWriter(self.html)) if self.html else None
            summaries = self._summaries(figure)
            figure.read(summaries)
            for text in figure.notes():
                reporter.note(text)
            verdicts = [(summary.path, verdict) for summary in summaries for verdict in summary.verdicts()]
            if picture:
                picture.write(figure.drawing(), figure.plan.grid, self.style)
            if page:
                page.write(self._page(figure, summaries, verdicts))
            publish_together([writer for writer in (picture, page) if writer])

        curves = sum(len(panel.curves) for panel in figure.drawing().panels)
        panels = [panel.label for panel in figure.plan.panels]
        result = _result(self, size, figure.rows, panels, curves, figure.notes(), [verdict for _, verdict in verdicts])
        several = len(self.paths) > 1
        failed = [f"{path}: {each.message}" if several else each.message for path, each in verdicts if not each.passed]
        if failed:
            error = FailedAssertionError(failed)
            error.results = [result]
            raise error
        return result

    def _summaries(self, figure: TableFigure) -> list[TableSummarizer]:
        """Returns a summary of each table, if needed; of the drawn columns only, if these were selected."""
        if not self.html and not self.assert_:
            return []
        columns = figure.plan.columns if self.y else None
        return [TableSummarizer(path, units, columns, self.assert_) for path, units in figure.units.items()]

    def _page(
        self, figure: TableFigure, summaries: Sequence[TableSummarizer], verdicts: Sequence[tuple[str, Verdict]]
    ) -> Page:
        assert self.html
        files, manifests = html_page.included(self.include, self.html, self.embed_up_to)
        known = {(path, verdict.text) for path, verdict in verdicts}
        recorded = html_page.recorded_verdicts(manifests)
        embedded = [each for each in figure.manifests if not any(each.is_part_of(other) for other in manifests)]
        return Page(
            title=self.title or listing(self.paths),
            maker=MAKER,
            figures=[figure.for_page()],
            verdicts=[*verdicts, *((path, each) for path, each in recorded if (path, each.text) not in known)],
            files=files,
            tables=[TableStatistics(each.path, each.rows, each.statistics()) for each in summaries],
            manifests=[_origin(self, self.paths), *manifests, *embedded],
        )


@options
class StudyPlot(TablePlot):
    """A plot of a study, a folder that `mjrun sweep` writes: its options are keywords."""

    def run(self, reporter: Reporter | None = None) -> "TablePlotResult":
        """Writes the plot and the page: both, or neither.

        Raises:
          MjrunError: nothing was published, and existing outputs are unchanged.
        """
        reporter = reporter or PythonApiReporter()
        _check_outputs(self)
        if len(self.paths) != 1:
            raise UsageError(f"a plot shows one study, or tables, not {listing(self.paths)}")
        (folder,) = self.paths
        for name in OF_TABLES:
            if is_given(self, name):
                raise UsageError(f"{option(name)} applies to tables only, and {quoted(folder)} is a study")

        results = read_study(folder)
        plan = StudyFigurePlan(results, self)
        drawing = plan.drawing
        grid = study_grid(drawing, self.size, self.font_size)
        labels = [panel.label for panel in drawing.panels]
        for text in plan.notes:
            reporter.note(text)

        writers: list[FigureWriter | PageWriter] = []
        with ExitStack() as stack:
            if self.output:
                picture = stack.enter_context(_open_picture(self, grid.size))
                picture.write(drawing, grid, self.style)
                writers.append(picture)
            if self.html:
                page = stack.enter_context(PageWriter(self.html))
                in_page = grid if self.size else study_grid(drawing, None, self.font_size, in_page=True)
                figure = PageFigure(page_svg(drawing, in_page, self.style), drawing.description, plan.notes)
                files, manifests = html_page.included(self.include, self.html, self.embed_up_to)
                own = _origin(self, [str(Path(folder, RESULTS))])
                shown = Page(self.title or folder, MAKER, [figure], files=files, manifests=[own, *manifests])
                page.write(shown)
                writers.append(page)
            publish_together(writers)
        return _result(self, grid.size, [len(results)], labels, sum(each.curves for each in drawing.panels), plan.notes)


@dataclass(frozen=True)
class TablePlotResult:
    """The result of a plot.

    Attributes:
      path: path of the plot; `-` is standard output.
      format: name of the format.
      size: width and height [pixels].
      tables: the tables shown.
      rows: the rows of each table.
      panels: their labels, in order.
      curves: total number of curves.
      notes: notes for the user: rows and values that cannot be drawn, columns that are omitted.
      html: path of the page, or None.
      assertions: each assertion with its value and verdict, one table after the other.
      schema: schema of this document.
    """

    path: str
    format: str
    size: tuple[int, int]
    tables: Sequence[str]
    rows: Sequence[int]
    panels: Sequence[str]
    curves: int
    notes: Sequence[str]
    html: str | None = None
    assertions: Sequence[Verdict] = ()
    schema: str = SCHEMA

    def _repr_html_(self) -> str | None:
        """Returns the plot for a notebook; None if it is not an image."""
        return media_html([self.path])


def _check_outputs(plot: TablePlot) -> None:
    """Raises MjrunError if matplotlib is missing, or the requested outputs do not fit together."""
    require_matplotlib()
    if plot.output is None and plot.html is None:
        raise UsageError(f"nothing to make: give {option('output')}, {option('html')} or both")
    if plot.output and plot.format is None and Path(plot.output).suffix.lower() in HTML:
        raise UsageError(f"{clean(plot.output)} would be a page, not an image: {option('html')} writes pages")


def _origin(plot: TablePlot, files: Iterable[str]) -> FileManifest:
    return html_page.origin("This page", plot.command, files, {"numpy": np.__version__})


def _target(plot: TablePlot) -> str | None:
    """Returns the path of the image; None for standard output."""
    return None if plot.output == STDIN else plot.output


def _open_picture(plot: TablePlot, size: tuple[int, int]) -> FigureWriter:
    tags = {"comment": MAKER} | ({"title": plot.title} if plot.title else {})
    return FigureWriter(_target(plot), figure_format(_target(plot), plot.format), size, tags)


def _result(
    plot: TablePlot,
    size: tuple[int, int],
    rows: Sequence[int],
    panels: Sequence[str],
    curves: int,
    notes: Sequence[str],
    assertions: Sequence[Verdict] = (),
) -> TablePlotResult:
    return TablePlotResult(
        path=plot.output or str(plot.html),
        format=figure_format(_target(plot), plot.format) if plot.output else "html",
        size=size,
        tables=plot.paths,
        rows=rows,
        panels=panels,
        curves=curves,
        notes=notes,
        html=plot.html,
        assertions=assertions,
    )
