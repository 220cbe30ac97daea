"""Tables in memory that plot themselves, and the figures that they become."""

from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.formats import table_reader
from mjrun.formats.image_format import figure_format
from mjrun.options.option import options_for
from mjrun.options.plot import FigureOptions
from mjrun.plotting.figure_data import Drawing, PanelGrid
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import FigureWriter, require_matplotlib, svg_text


class Table(table_reader.NumericTable):
    """Columns of numbers, each with a unit: `table["qpos/knee"]`, `table.units["qpos/knee"]`.

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

    drawing: Drawing
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
      MissingExtraError: the library of the format is not installed.
    """
    read = table_reader.read_table(path, columns, missing=missing)
    return Table(read.columns, read.units)
