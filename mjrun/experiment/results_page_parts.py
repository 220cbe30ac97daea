"""Parts of the pages about studies and evaluations: varied parameters, figures, videos and origin."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from mjrun.errors import MissingExtraError, UsageError, clean
from mjrun.experiment.design import Design, numbers
from mjrun.experiment.statistics import Interval
from mjrun.formats.output_writer import StagedFile
from mjrun.formats.study_reader import NO_UNITS, read_study
from mjrun.model.table_column import with_unit
from mjrun.options.plot import FigureOptions
from mjrun.options.report import PageOptions
from mjrun.plotting.figure_writer import page_svg, require_matplotlib
from mjrun.plotting.html_page import (
    FileManifest,
    PageFactTable,
    PageFigure,
    ShownFile,
    check_page_name,
    number,
    page_file,
)
from mjrun.plotting.study.figure_data import study_grid
from mjrun.plotting.study.plan import StudyFigurePlan
from mjrun.plotting.table_figure import TableFigure

LISTED = 6  # values of a parameter
MOST_VIDEOS = 12


def check_page(path: str) -> None:
    """Raises errors that would prevent the page, before anything is simulated.

    Raises:
      BadValueError: its name does not end with .html.
      MissingExtraError: matplotlib is missing.
      FileError: it cannot be written.
    """
    check_page_name(path)
    require_matplotlib()
    StagedFile(Path(path)).cleanup()


def parameters_table(design: Design, units: Mapping[str, str] = NO_UNITS) -> list[PageFactTable]:
    """Returns a table of the varied parameters with their units, and their values, if anything varies."""
    rows = list[tuple[str, str, str]]()
    for index, name in enumerate(design.names):
        texts = design.distinct(index)
        values = numbers(texts)
        if values is not None and len(texts) <= LISTED:
            texts = [number(float(value)) for value in values]
        if len(texts) <= LISTED:
            shown = ", ".join(texts)
        elif values is None:
            shown = f"{', '.join(texts[:LISTED])}, …"
        else:
            shown = f"{number(float(values.min()))} … {number(float(values.max()))}"
        rows.append((with_unit(name, units.get(name)), f"{len(texts):,}", shown))
    if not rows:
        return []
    caption, headings = f"What varies over {len(design.points):,} points", ("Parameter", "Different values", "Values")
    return [PageFactTable("Parameters", caption, headings, rows, (1,))]


def study_figures(folder: str | Path) -> tuple[list[PageFigure], list[str]]:
    """Returns the figure of a study that `mjrun plot` draws, and notes; nothing if the study has none."""
    try:
        plan = StudyFigurePlan(read_study(folder), FigureOptions())
        drawing = plan.drawing
    except (UsageError, MissingExtraError) as error:
        return [], [f"no plot: {str(error).partition(chr(10))[0]}"]
    svg = page_svg(drawing, study_grid(drawing, None, in_page=True))
    return [PageFigure(svg, drawing.description, plan.notes)], []


def table_figure(path: str | Path, options: FigureOptions) -> PageFigure:
    """Returns a figure of a table."""
    with ExitStack() as stack:
        figure = TableFigure([str(path)], options, stack)
        figure.read()
        return figure.for_page()


def shown_files(paths: Iterable[str], options: PageOptions) -> list[ShownFile]:
    """Returns the first files for a page, embedded up to the size that `options` allow."""
    return [page_file(path, str(options.html), options.embed_up_to) for path in [*paths][:MOST_VIDEOS]]


def origin(path: str | Path, facts: Mapping[str, object], names: Sequence[str]) -> FileManifest:
    """Returns the facts with these names as a manifest."""
    return FileManifest(clean(str(path)), {name: facts[name] for name in names if facts.get(name) not in (None, "")})


def interval(ends: Interval) -> str:
    """Formats a confidence interval; empty if it is undefined."""
    return "" if ends.low is None or ends.high is None else f"{number(ends.low)} … {number(ends.high)}"
