"""A figure of tables, each read once."""

import re
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from pathlib import Path

from mjrun.errors import CellError, FileError, UsageError, listing, option
from mjrun.formats.study_reader import point_names, point_values
from mjrun.formats.table_reader import STDIN, TableReader, open_table
from mjrun.options.plot import FigureOptions
from mjrun.plotting.figure_data import Drawing
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import page_svg
from mjrun.plotting.html_page import PageFigure
from mjrun.plotting.manifest_html import FileManifest
from mjrun.plotting.panel import with_units
from mjrun.plotting.table_statistics import TableSummary

_WORD = re.compile(r"[^/\\\s_-]+")


class TableFigure:
    """A figure of tables, which remain open until `stack` is closed.

    Args:
      labels: names of the tables in the legend, in place of the usual ones.

    Raises:
      UsageError, FileError: a table or a name is missing.
    """

    def __init__(
        self, tables: Sequence[str], options: FigureOptions, stack: ExitStack, labels: Sequence[str] = ()
    ) -> None:
        if not tables:
            raise UsageError("nothing to plot: give a table, or - for standard input")
        if tables.count(STDIN) > 1:
            raise UsageError("standard input can be read only once: give - once")
        self._paths, names = tables, labels or table_names(tables)
        self._stack, self._options = stack, options
        # Columns that are not plotted may hold text; standard input cannot be opened again to read the others.
        self._readers = [stack.enter_context(open_table(path, missing="nan", exact=path != STDIN)) for path in tables]
        known = [TableColumns(name, dict(r.units)) for name, r in zip(names, self._readers, strict=True)]
        self.plan = FigurePlan(options, known)
        self._collectors = [self.plan.collector(index) for index in range(len(tables))]

    @property
    def rows(self) -> list[int]:
        """The number of rows read from each table."""
        return [collector.rows for collector in self._collectors]

    @property
    def units(self) -> dict[str, dict[str, str]]:
        """The unit of each column of each table, by its path."""
        tables = zip(self._paths, self._readers, strict=True)
        return {path: with_units(reader.names, reader.units) for path, reader in tables}

    @property
    def manifests(self) -> list[FileManifest]:
        """The manifests embedded in the tables."""
        tables = zip(self._paths, self._readers, strict=True)
        return [FileManifest(path, reader.manifest) for path, reader in tables if reader.manifest]

    def read(self, summaries: Sequence[TableSummary] = ()) -> None:
        """Reads all tables once, for `summaries` too.

        Raises:
          FileError: a table cannot be read, or has no rows.
        """
        for index, (path, collector) in enumerate(zip(self._paths, self._collectors, strict=True)):
            summary = summaries[index] if summaries else None
            reader = self._narrowed(path, self._readers[index], summary.names if summary else ())
            try:
                for block in reader.blocks():
                    columns = dict(zip(reader.names, block.T, strict=True))
                    collector.feed(columns)
                    if summary:
                        summary.feed(columns)
            except CellError as error:
                error.add_note(f"{option('y')} chooses columns; others may hold anything")
                raise
            if not collector.rows:
                raise FileError(path, "has no rows")

    def drawing(self) -> Drawing:
        """Returns the data of the figure."""
        return self.plan.drawing(self._collectors)

    def notes(self) -> list[str]:
        """Returns notes for the user."""
        without = [path for path, c in zip(self._paths, self._collectors, strict=True) if not c.has_curves]
        missing = [f"none of the curves is in {listing(without)}"] if without else []
        return [*self.plan.notes, *missing, *(text for c in self._collectors for text in c.notes())]

    def for_page(self) -> PageFigure:
        """Returns the figure for a page, which has room below rather than beside."""
        svg = page_svg(self.drawing(), self.plan.page_grid(), self._options.style)
        labels = [panel.label for panel in self.plan.panels]
        return PageFigure(svg, f"{listing(self._paths)}: {listing(labels)}", self.notes())

    def _narrowed(self, path: str, reader: TableReader, also: Collection[str]) -> TableReader:
        """Returns the table with only the required columns, if it can be opened again."""
        wanted = [name for name in reader.names if name in self.plan.columns or name in also] or list(reader.names[:1])
        if path == STDIN:
            return reader
        return self._stack.enter_context(open_table(path, wanted, missing="nan"))


def table_names(paths: Sequence[str]) -> list[str]:
    """Returns a short name for each of several files: `1`, `2` for `kick_1.csv`, `kick_2.csv`; or the whole path.

    Files of a study's points are named by the values that differ among them.
    """
    if len(paths) > 1 and (values_of_points := _point_names(paths)):
        return values_of_points
    stems = [Path(path).stem for path in paths]
    if len(set(stems)) < len(stems):
        stems = [str(Path(path).with_suffix("")) for path in paths]
    if len(set(stems)) < len(stems):
        return list(paths)
    if len(stems) < 2:
        return stems
    words = [list(_WORD.finditer(stem)) for stem in stems]
    least = min(map(len, words))
    before = next((i for i in range(least) if len({w[i][0] for w in words}) > 1), least)
    after = next((i for i in range(least - before) if len({w[-1 - i][0] for w in words}) > 1), least - before)
    if any(len(parts) <= before + after for parts in words):  # a name would be empty
        return stems
    short = [stem[w[before].start() : w[len(w) - 1 - after].end()] for stem, w in zip(stems, words, strict=True)]
    return short if len(set(short)) == len(short) else stems


def _point_names(paths: Sequence[str]) -> list[str]:
    """Returns the values that differ among points of a study; empty if a file is not of a point, or two are equal."""
    points = [point_values(Path(path).parent) for path in paths]
    named = point_names(points)
    return named if len(set(named)) == len(named) else []
