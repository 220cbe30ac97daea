"""Figures of tables: of files, each read once, and of tables in memory, which plot themselves."""

import re
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import get_args

from mjrun.dataclass import dataclass
from mjrun.errors import CellError, FileError, UsageError, listing, option
from mjrun.formats import table_reader
from mjrun.formats.image_format import figure_format
from mjrun.formats.study_reader import point_names, point_values
from mjrun.formats.table_reader import STDIN, OpenTable, open_table
from mjrun.options.kinds import ChoiceKind
from mjrun.options.option import converted, options_for
from mjrun.options.plot import FigureOptions
from mjrun.plotting.figure_data import DrawnFigure, PanelGrid
from mjrun.plotting.figure_plan import FigurePlan, TableColumns, with_units
from mjrun.plotting.figure_writer import FigureWriter, page_svg, require_matplotlib, svg_text
from mjrun.plotting.html_page import FileManifest, PageFigure
from mjrun.plotting.table_statistics import TableSummarizer

_WORD = re.compile(r"[^/\\\s_-]+")


class TableFigure:
    """A figure of tables, which remain open until `stack` is closed.

    Args:
      labels: names of the tables in the legend, in place of the usual ones.
      units: units of columns, where the tables state none.

    Raises:
      UsageError, FileError: a table or a name is missing.
    """

    def __init__(
        self,
        tables: Sequence[str],
        options: FigureOptions,
        stack: ExitStack,
        labels: Sequence[str] = (),
        units: Mapping[str, str] | None = None,
    ) -> None:
        if not tables:
            raise UsageError("nothing to plot: give a table, or - for standard input")
        if tables.count(STDIN) > 1:
            raise UsageError("standard input can be read only once: give - once")
        self._paths, names = tables, labels or table_names(tables)
        self._stack, self._options = stack, options
        # Columns that are not plotted may hold text; standard input cannot be opened again to read the others.
        self._readers = [stack.enter_context(open_table(path, missing="nan", exact=path != STDIN)) for path in tables]
        self._units = [
            {name: unit or (units or {}).get(name, "") for name, unit in reader.units.items()}
            for reader in self._readers
        ]
        known = [TableColumns(name, columns) for name, columns in zip(names, self._units, strict=True)]
        self.plan = FigurePlan(options, known)
        self._collectors = [self.plan.collector(index) for index in range(len(tables))]

    @property
    def rows(self) -> list[int]:
        """The number of rows read from each table."""
        return [collector.rows for collector in self._collectors]

    @property
    def units(self) -> dict[str, dict[str, str]]:
        """The unit of each column of each table, by its path."""
        return {path: with_units([*units], units) for path, units in zip(self._paths, self._units, strict=True)}

    @property
    def manifests(self) -> list[FileManifest]:
        """The manifests embedded in the tables."""
        tables = zip(self._paths, self._readers, strict=True)
        return [FileManifest(path, reader.manifest) for path, reader in tables if reader.manifest]

    def read(self, summaries: Sequence[TableSummarizer] = ()) -> None:
        """Reads all tables once, for `summaries` too.

        Raises:
          FileError: a table cannot be read, or has no rows.
        """
        for index, (path, collector) in enumerate(zip(self._paths, self._collectors, strict=True)):
            summary = summaries[index] if summaries else None
            with _advised(option("y")):
                reader = self._narrowed(path, self._readers[index], summary.names if summary else ())
                for block in reader.blocks():
                    columns = dict(zip(reader.names, block.T, strict=True))
                    collector.feed(columns)
                    if summary:
                        summary.feed(columns)
            if not collector.rows:
                raise FileError(path, "has no rows")

    def drawing(self) -> DrawnFigure:
        """Returns the data of the figure."""
        return self.plan.drawing(self._collectors)

    def notes(self) -> list[str]:
        """Returns notes for the user."""
        without = [path for path, c in zip(self._paths, self._collectors, strict=True) if not c.has_curves]
        missing = [f"none of the curves is in {listing(without)}"] if without else []
        panels = dict[str, list[str]]()
        for panel in self.drawing().panels:
            if panel.coinciding:
                panels.setdefault(listing(panel.coinciding), []).append(panel.label)
        hidden = [
            f"{listing(labels)}: curves coincide, and their dashes alternate: {names}"
            for names, labels in panels.items()
        ]
        return [*self.plan.notes, *missing, *hidden, *(text for c in self._collectors for text in c.notes())]

    def for_page(self) -> PageFigure:
        """Returns the figure for a page, which has room below rather than beside."""
        svg = page_svg(self.drawing(), self.plan.page_grid(), self._options.style)
        labels = [panel.label for panel in self.plan.panels]
        return PageFigure(svg, f"{listing(self._paths)}: {listing(labels)}", self.notes())

    def _narrowed(self, path: str, reader: OpenTable, also: Collection[str]) -> OpenTable:
        """Returns the table with only the required columns, if it can be opened again."""
        wanted = [name for name in reader.names if name in self.plan.columns or name in also] or list(reader.names[:1])
        if path == STDIN:
            return reader
        return self._stack.enter_context(open_table(path, wanted, missing="nan"))


@contextmanager
def _advised(name: str) -> Generator[None]:
    """Adds the option or argument that chooses columns to the error of one that does not hold numbers."""
    try:
        yield
    except CellError as error:
        error.add_note(f"{name} chooses columns; others may hold anything")
        raise


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


class Table(table_reader.NumericTable):
    """A table that plots itself: columns of numbers, `table["qpos/knee"]`, with units, `table.units["qpos/knee"]`.

    Iterating yields the names of the columns, in the order of the file.

    Attributes:
      columns: columns float64 `(n,)`, by name.
      units: units by name, as in `m/s`; empty for pure numbers, and in formats that hold no units (.csv, .jsonl).
    """

    def plot(self, **options: object) -> "Figure":
        """Plots the columns, as `mjrun plot` does; notebooks show the figure.

        Args:
          options: those of `mjrun.TablePlot`: `y="energy/*"`, `x`, `log`, `title`, `style` and `size`, for example.

        Raises:
          UsageError: a name is unknown, or a value is invalid.
          MissingExtraError: matplotlib is not installed.
        """
        require_matplotlib()
        (chosen,) = options_for("plot", options, FigureOptions)
        figure = FigureOptions(**chosen)
        plan = FigurePlan(figure, [TableColumns("table", self.units)])
        collector = plan.collector(0)
        collector.feed(self.columns)
        return Figure(plan.drawing([collector]), plan.grid, figure.style)


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure in memory, which notebooks show.

    Attributes:
      style: its colour scheme.
    """

    drawing: DrawnFigure
    grid: PanelGrid
    style: str

    def save(self, path: str | Path) -> None:
        """Writes the figure as png, svg or pdf.

        Raises:
          UsageError: no format has this suffix.
          FileError: the file cannot be written.
        """
        with FigureWriter(str(path), figure_format(str(path), None), self.grid.size, {}) as writer:
            writer.write(self.drawing, self.grid, self.style)
            writer.publish()

    @property
    def svg(self) -> str:
        """The figure as an `<svg>` element."""
        return svg_text(self.drawing, self.grid, self.style)

    def _repr_svg_(self) -> str:
        return self.svg.replace("<svg", '<svg style="max-width: 100%; height: auto"', 1)

    def __repr__(self) -> str:
        width, height = self.grid.size
        labels = ", ".join(panel.label for panel in self.drawing.panels)
        return f"Figure of {width}x{height} pixels: {labels}"


def read_table(
    path: str | Path,
    columns: "table_reader.Collection[str] | table_reader.ColumnFilter | None" = None,
    *,
    missing: table_reader.Missing = "error",
) -> Table:
    """Reads columns of numbers from a table of any format.

    Args:
      columns: names of the columns, or a function that chooses names; by default, all.
      missing: `nan` reads empty cells as NaN; by default, they are errors.

    Raises:
      FileError: the file does not exist or is incomplete, two of the columns have the same name or differ in length,
        or a cell is not a number; the message names the line, counted from 1, or the row, counted from 0.
      UnknownNameError: no format has this suffix, or a named column is missing.
      BadValueError: `missing` is neither `error` nor `nan`.
      MissingExtraError: the library of the format is not installed.
    """
    missing = converted("missing", ChoiceKind(get_args(table_reader.Missing)), missing)
    with _advised("columns"):
        read = table_reader.read_table(path, columns, missing=missing)
    return Table(read.columns, read.units)
