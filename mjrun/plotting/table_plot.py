"""Plots of tables: any that mjrun writes, and those of others."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mjrun.errors import FileError, UsageError, listing, option
from mjrun.formats.figure_format import figure_format
from mjrun.formats.table_reader import TableReader, open_table
from mjrun.options.option import options
from mjrun.options.plot import FigureOptions, TablePlotOptions
from mjrun.plotting.drawing import Drawing
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib, svg_text
from mjrun.plotting.table_names import table_names
from mjrun.reporter import Reporter, WarningReporter
from mjrun.version import __version__

STDIN = "-"
SCHEMA = "mjrun.plot/1"  # of the report


@options
class TablePlot(TablePlotOptions):
    """A plot of tables: its options are keywords."""

    @property
    def paths(self) -> list[str]:
        """The tables."""
        tables = [self.tables] if isinstance(self.tables, str | Path) else self.tables
        return [str(table) for table in tables]

    def run(self, reporter: Reporter | None = None) -> "TablePlotResult":
        """Makes the plot.

        Raises:
          MjrunError: nothing was published, and an existing output is untouched.
        """
        reporter = reporter or WarningReporter()
        require_matplotlib()
        target = None if self.output == STDIN else self.output
        name = figure_format(target, self.format)
        with ExitStack() as stack:
            figure = TableFigure(self.paths, self, stack)
            tags = {"comment": f"mjrun {__version__}"} | ({"title": self.title} if self.title else {})
            writer = stack.enter_context(FigureWriter(target, name, figure.plan.grid.size, tags))
            figure.read()
            for text in figure.notes():
                reporter.note(text)
            writer.write(figure.drawing(), figure.plan.grid, self.style)
            writer.publish()
        curves = sum(len(panel.curves) for panel in figure.drawing().panels)
        return TablePlotResult(
            path=self.output,
            format=name,
            size=figure.plan.grid.size,
            tables=self.paths,
            rows=figure.rows,
            panels=[panel.label for panel in figure.plan.panels],
            curves=curves,
            notes=figure.notes(),
        )


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
    schema: str = SCHEMA


class TableFigure:
    """A figure of tables, which are open until `stack` is left.

    Raises:
      UsageError, FileError: a table or a name that is not there.
    """

    def __init__(self, tables: Sequence[str], options: FigureOptions, stack: ExitStack) -> None:
        if not tables:
            raise UsageError("there is nothing to plot: give a table, or - for standard input")
        if tables.count(STDIN) > 1:
            raise UsageError("standard input is read once: give - once")
        self._paths, names = tables, table_names(tables)
        readers = [stack.enter_context(open_table(path, missing="nan")) for path in tables]
        known = [TableColumns(name, dict(r.units)) for name, r in zip(names, readers, strict=True)]
        self.plan = FigurePlan(options, known)
        self._readers = [self._narrowed(path, reader, stack) for path, reader in zip(tables, readers, strict=True)]
        self._collectors = [self.plan.collector(index) for index in range(len(tables))]

    @property
    def rows(self) -> list[int]:
        """Rows of each table that were read."""
        return [collector.rows for collector in self._collectors]

    def read(self) -> None:
        """Reads all tables.

        Raises:
          FileError: one of them cannot be read, or has no rows.
        """
        for path, reader, collector in zip(self._paths, self._readers, self._collectors, strict=True):
            try:
                for block in reader.blocks():
                    collector.feed(dict(zip(reader.names, block.T, strict=True)))
            except FileError as error:
                error.add_note(f"{option('y')} chooses columns; others may hold anything")
                raise
            if not collector.rows:
                raise FileError(path, "has no rows")

    def drawing(self) -> Drawing:
        """What is drawn of them."""
        return self.plan.drawing(self._collectors)

    def notes(self) -> list[str]:
        """What the user may want to know."""
        without = [path for path, c in zip(self._paths, self._collectors, strict=True) if not c.has_curves]
        missing = [f"none of the curves is in {listing(without)}"] if without else []
        return [*self.plan.notes, *missing, *(text for c in self._collectors for text in c.notes())]

    def _narrowed(self, path: str, reader: TableReader, stack: ExitStack) -> TableReader:
        """The table with the columns that are read alone, if it can be opened again."""
        wanted = [name for name in reader.names if name in self.plan.columns] or list(reader.names[:1])
        if path == STDIN or len(wanted) == len(reader.names):
            return reader
        return stack.enter_context(open_table(path, wanted, missing="nan"))


def svg_figure(tables: Sequence[str], options: FigureOptions) -> tuple[str, list[str]]:
    """The figure of tables as an `<svg>` element to stand in a page, and notes about it.

    Raises:
      MjrunError: a table or a name that is not there, or that cannot be read.
    """
    require_matplotlib()
    with ExitStack() as stack:
        figure = TableFigure(tables, options, stack)
        figure.read()
        return svg_text(figure.drawing(), figure.plan.grid, options.style), figure.notes()
