"""Options of plots: of tables, and of a simulation in a run document."""

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import ClassVar

from mjrun.options.kinds import ChoiceKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import FigureSizeKind, IntegerKind, RangeKind, RealKind
from mjrun.options.option import OptionRequirement, Options, option, options, required
from mjrun.options.output import PLOTS
from mjrun.options.report import PageOptions
from mjrun.options.trace import SamplingOptions

STYLES = ("light", "dark", "print")


class PanelCountKind(IntegerKind):
    """A number of panels side by side."""

    def __init__(self) -> None:
        super().__init__(1, 8)

    @property
    def expected(self) -> str:
        return f"{super().expected}, the number of panels side by side; y selects the columns of the table"


@options
class FigureOptions(Options):
    """Curves and appearance of a figure."""

    section: ClassVar[str] = "Figure"

    y: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[TITLE: ]CURVE,…")),
        default=(),
        usual="a panel for each group of columns and each of its units",
        help="A panel and its curves: columns, qpos/knee; wildcards, qpos/*; or expressions over columns, "
        "contact_force/normal/z / 87.36. A curve may have a label and a unit: depth "
        "[mm]=penetration/deepest*1000.",
    )
    x: str | None = option(
        converter=optional(TextKind("COLUMN")),
        default=None,
        usual="time",
        help="Column or expression on the x axis.",
    )
    log: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[PANEL:]x|y|both"), commas=True, expected="x, y or both"),
        default=(),
        help="Logarithmic axes: y in all panels, or 2:y in the second panel only.",
    )
    xlim: tuple[float, float] | None = option(
        converter=optional(RangeKind("LOW..HIGH")),
        default=None,
        usual="all values",
        help="Range of the x axis, of which the curves then show all details.",
    )
    ylim: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[PANEL:]LOW..HIGH")),
        default=(),
        usual="all values",
        help="Range of the y axis in all panels, -1..1, or in the second panel only, 2:-1..1.",
    )
    mark: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[PANEL:|x:][LABEL=]VALUE")),
        default=(),
        help="Draw a horizontal line in all panels, m·g=87.356, or in the second panel only, 2:m·g=87.356; or a "
        "vertical line, x:impact=0.52.",
    )
    mark_event: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[LABEL=]CONDITION")),
        default=(),
        help="Draw a vertical line wherever a condition over columns becomes true: landed=contact/ncon > 0.",
    )
    title: str | None = option(converter=optional(TextKind("TEXT")), default=None, help="Title above all panels.")
    legend_title: str | None = option(
        converter=optional(TextKind("TEXT")),
        default=None,
        help="Title of the legend, such as the quantity that it lists.",
    )
    xlabel: str | None = option(
        converter=optional(TextKind("TEXT")),
        default=None,
        usual="the column of the x axis",
        help="Label of the x axis.",
    )
    ylabel: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[PANEL:]TEXT")),
        default=(),
        help="Label of the y axis of all panels, force [N], or of the second panel only, 2:force [N]; each panel has a "
        "title already.",
    )
    style: str = option(
        converter=ChoiceKind(STYLES),
        default="light",
        help="Colour scheme; print is meant for paper and also distinguishes lines by dash patterns.",
    )
    size: tuple[int, int] | None = option(
        converter=optional(FigureSizeKind()),
        default=None,
        usual="1280 to 1920 wide, and as high as the panels require",
        help="Width and height [pixels], or as on paper, 85mmx60mm; a pixel is 1/96 inch.",
    )
    font_size: float | None = option(
        converter=optional(RealKind(above=0, metavar="POINTS")),
        default=None,
        usual="chosen by the size",
        help="Size of letters [pt], for figures in papers.",
    )
    columns: int | None = option(
        converter=optional(PanelCountKind()),
        default=None,
        usual="chosen by the number of panels",
        help="Number of panels side by side.",
    )


@options
class TablePlotOptions(PageOptions, FigureOptions):
    """A plot of tables.

    Args:
      tables: one or several files, or `-` for standard input.
      output: the file that is written.
    """

    section: ClassVar[str] = "Plot"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("include", "html", "the page that shows the files"),
    )

    tables: Sequence[str | Path] | str | Path = field(kw_only=False)
    output: str | None = option(
        converter=optional(PathKind(written=True, streamed=True)),
        default=None,
        usual="no image, with html",
        kw_only=False,
        short="-o",
        help=f"{PLOTS}, or - for standard output.",
    )
    format: str | None = option(
        converter=optional(TextKind("NAME")),
        default=None,
        usual="the output's suffix; png in a pipe",
        help="File format.",
    )
    assert_: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Exit with code 1 unless this condition holds for each table: max(abs(energy/drift)) < 1e-3.",
    )
    label: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("NAME")),
        default=(),
        usual="the parts of the tables' names that differ",
        help="Name of a table in the legend, one for each table in order.",
    )
    include: tuple[str, ...] = option(
        converter=OneOrMoreKind(PathKind()),
        default=(),
        help="Also show this file on the page: an image, a video or a manifest (.json). Other files are linked.",
    )


@options
class PlotOptions(FigureOptions, SamplingOptions):
    """A plot of values measured in a simulation."""

    section: ClassVar[str] = "Plot"

    output: str = required(
        converter=PathKind(written=True, streamed=True), kw_only=False, help=f"The image to write: {PLOTS}."
    )
    probe: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("PROBE,…")),
        default=(),
        usual="the columns of y, or those of a trace",
        help="Values to measure in a simulation and, without y, to plot: energy, qpos[left_*]. Each use adds a panel "
        "below the others; values with different units get separate panels.",
    )
