"""Plots of tables: any that mjrun writes, and those of others."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mjrun.errors import FailedAssertionError, UsageError, clean, listing, option
from mjrun.formats.atomic_output import publish_together
from mjrun.formats.image_format import figure_format
from mjrun.formats.table_reader import STDIN
from mjrun.options.option import options
from mjrun.options.plot import TablePlotOptions
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib
from mjrun.plotting.html_page import Page, PageTable
from mjrun.plotting.page_writer import MAKER, PageWriter, included, recorded_verdicts
from mjrun.plotting.table_figure import TableFigure
from mjrun.plotting.table_summary import TableSummary
from mjrun.probe.verdict import Verdict
from mjrun.reporter import Reporter, WarningReporter

SCHEMA = "mjrun-plot-1"  # of the report


@options
class TablePlot(TablePlotOptions):
    """A plot of tables: its options are keywords."""

    @property
    def paths(self) -> list[str]:
        """The tables."""
        tables = [self.tables] if isinstance(self.tables, str | Path) else self.tables
        return [str(table) for table in tables]

    def run(self, reporter: Reporter | None = None) -> "TablePlotResult":
        """Makes the plot, and the page.

        Raises:
          FailedAssertionError: an assertion does not hold; everything is published all the same.
          MjrunError: nothing was published, and an existing output is untouched.
        """
        reporter = reporter or WarningReporter()
        require_matplotlib()
        if self.output is None and self.html is None:
            raise UsageError(f"there is nothing to make: give {option('output')}, {option('html')} or both")
        if self.output and self.format is None and Path(self.output).suffix.lower() in (".html", ".htm"):
            raise UsageError(f"{clean(self.output)} is a page, not a picture: {option('html')} makes pages")
        if self.include and self.html is None:
            raise UsageError(f"{option('include')} is of what {option('html')} shows, and there is none")
        with ExitStack() as stack:
            figure = TableFigure(self.paths, self, stack)
            picture = stack.enter_context(self._picture(figure)) if self.output else None
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
        return self._result(figure, verdicts)

    def _picture(self, figure: TableFigure) -> FigureWriter:
        target = None if self.output == STDIN else self.output
        tags = {"comment": MAKER} | ({"title": self.title} if self.title else {})
        return FigureWriter(target, figure_format(target, self.format), figure.plan.grid.size, tags)

    def _summaries(self, figure: TableFigure) -> list[TableSummary]:
        """Of each table, if they are of use: of the columns that are drawn where the user chose some."""
        if not self.html and not self.assert_:
            return []
        columns = figure.plan.columns if self.y else None
        return [TableSummary(path, units, columns, self.assert_) for path, units in figure.units.items()]

    def _page(
        self, figure: TableFigure, summaries: Sequence[TableSummary], verdicts: Sequence[tuple[str, Verdict]]
    ) -> Page:
        assert self.html
        files, manifests = included(self.include, self.html, self.embed_up_to)
        known = {(path, verdict.text) for path, verdict in verdicts}
        recorded = [(path, each) for path, each in recorded_verdicts(manifests) if (path, each.text) not in known]
        embedded = [each for each in figure.manifests if not any(each.is_part_of(other) for other in manifests)]
        return Page(
            title=self.title or listing(self.paths),
            maker=MAKER,
            figures=[figure.for_page()],
            verdicts=[*verdicts, *recorded],
            files=files,
            tables=[PageTable(each.path, each.rows, each.statistics()) for each in summaries],
            manifests=[*manifests, *embedded],
        )

    def _result(self, figure: TableFigure, verdicts: Sequence[tuple[str, Verdict]]) -> "TablePlotResult":
        curves = sum(len(panel.curves) for panel in figure.drawing().panels)
        target = None if self.output == STDIN else self.output
        result = TablePlotResult(
            path=self.output or str(self.html),
            format=figure_format(target, self.format) if self.output else "html",
            size=figure.plan.grid.size,
            tables=self.paths,
            rows=figure.rows,
            panels=[panel.label for panel in figure.plan.panels],
            curves=curves,
            notes=figure.notes(),
            html=self.html,
            assertions=[verdict for _, verdict in verdicts],
        )
        several = len(self.paths) > 1
        failed = [f"{path}: {each.message}" if several else each.message for path, each in verdicts if not each.passed]
        if failed:
            error = FailedAssertionError(failed)
            error.results = [result]
            raise error
        return result


@dataclass(frozen=True)
class TablePlotResult:
    """What plot was made.

    Attributes:
      path: where it is; `-` is standard output.
      format: how it is written.
      size: width and height [pixels].
      tables: that it shows.
      rows: of each table.
      panels: their labels, in order.
      curves: in all panels together.
      notes: what the user may want to know: rows and values that cannot be drawn, columns that are left out.
      html: the page about it; None without one.
      assertions: each with the value that it has, and whether it holds; of one table after the other.
      schema: of this document.
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
