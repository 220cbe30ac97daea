"""Options of plots: of tables, and of a simulation in a run document."""

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import ClassVar

from mjrun.options.kinds import Choice, File, Integer, Optional, Real, Several, Size, Text
from mjrun.options.option import Options, option, options, required
from mjrun.options.output import PLOTS
from mjrun.options.trace import SamplingOptions

STYLES = ("light", "dark", "print")


@options
class FigureOptions(Options):
    """Which curves a figure has, and how it looks."""

    section: ClassVar[str] = "Figure"

    y: tuple[str, ...] = option(
        converter=Several(Text("[TITLE: ]CURVE,…")),
        default=(),
        usual="a panel for each group of columns and each unit in it",
        help="A panel and its curves: columns, qpos/knee; by wildcard, qpos/*; or expressions over columns, as in "
        "contact_force/normal/z / 87.36. A curve may have a name and a unit of its own: "
        "depth [mm]=penetration/deepest*1000.",
    )
    x: str | None = option(
        converter=Optional(Text("COLUMN")),
        default=None,
        usual="time",
        help="What the x axis shows, written as a curve.",
    )
    log: tuple[str, ...] = option(
        converter=Several(Text("[PANEL:]x|y|both"), commas=True, expected="x, y or both"),
        default=(),
        help="Axes that are logarithmic: y for all panels, 2:y for the second alone.",
    )
    mark: tuple[str, ...] = option(
        converter=Several(Text("[PANEL:|x:][LABEL=]VALUE")),
        default=(),
        help="A horizontal line in all panels, m·g=87.356, or in the second alone, 2:m·g=87.356; or a vertical one, "
        "x:impact=0.52.",
    )
    mark_event: tuple[str, ...] = option(
        converter=Several(Text("[LABEL=]CONDITION")),
        default=(),
        help="A vertical line wherever a condition over columns begins to hold: landed=contact/ncon > 0. Several of "
        "one table are all marked.",
    )
    title: str | None = option(converter=Optional(Text("TEXT")), default=None, help="A title above all panels.")
    style: str = option(
        converter=Choice(STYLES),
        default="light",
        help="Colours: print is for paper, with lines that differ in their dashes too.",
    )
    size: tuple[int, int] | None = option(
        converter=Optional(Size()),
        default=None,
        usual="1280 to 1920 wide, and as high as the panels need",
        help="Width and height [pixels]; in an svg or pdf, of 1/96 inch.",
    )
    columns: int | None = option(
        converter=Optional(Integer(1, 8)), default=None, usual="as many as suit", help="Panels side by side."
    )


@options
class PageOptions(Options):
    """A page about a result, which opens in any browser, without a network and without scripts."""

    section: ClassVar[str] = "Page"

    html: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="One page about the result (.html): plots, images, videos, what the columns hold, assertions and "
        "manifests.",
    )
    embed_up_to: float = option(
        converter=Real(metavar="MB"),
        default=10.0,
        help="Images and videos up to this size are in the page itself; those that are larger stay beside it, and it "
        "links to them.",
    )


@options
class TablePlotOptions(PageOptions, FigureOptions):
    """A plot of tables.

    Args:
      tables: the file of one or of several, or `-` for standard input.
      output: where it is written.
    """

    section: ClassVar[str] = "Plot"

    tables: Sequence[str | Path] | str | Path = field(kw_only=False)
    output: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        usual="no picture, with html",
        kw_only=False,
        short="-o",
        help=f"{PLOTS}, or - for standard output.",
    )
    format: str | None = option(
        converter=Optional(Text("NAME")),
        default=None,
        usual="the output's suffix; png in a pipe",
        help="The format.",
    )
    assert_: tuple[str, ...] = option(
        converter=Several(Text("EXPR")),
        default=(),
        help="Fail, with exit code 1, unless this holds for each table: max(abs(energy/drift)) < 1e-3.",
    )
    include: tuple[str, ...] = option(
        converter=Several(File()),
        default=(),
        help="What the page shows too: an image, a video or a manifest (.json); it links to any other file.",
    )


@options
class PlotOptions(FigureOptions, SamplingOptions):
    """A plot of what is measured in a simulation."""

    section: ClassVar[str] = "Plot"

    output: str = required(converter=File(written=True), kw_only=False, help=f"An image: {PLOTS}.")
    probe: tuple[str, ...] = required(
        converter=Several(Text("PROBE,…")),
        help="What to measure, and without y what to plot: energy, qpos[left_*]; several make a panel each, one under "
        "the other, and more where units differ.",
    )
