"""The page about a comparison: what differs, with curves of both tables, or both pictures under a slider."""

import base64
import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import mujoco
import numpy as np

from mjrun.diff.images_and_videos import WorstFrames
from mjrun.diff.result import ColumnDifference, DiffResult
from mjrun.diff.sentences import frame_facts
from mjrun.errors import UsageError, clean, option
from mjrun.formats.image_encoding import ImageData, png
from mjrun.formats.table_reader import STDIN
from mjrun.options.plot import FigureOptions
from mjrun.options.report import PageOptions
from mjrun.outputs.worst_difference_image import shown_frames
from mjrun.plotting.figure_writer import require_matplotlib
from mjrun.plotting.html_page import VIDEOS, Page, PageFactTable, PageFigure, PictureSlider, page_file
from mjrun.plotting.page_writer import MAKER, PageWriter, origin
from mjrun.plotting.table_figure import TableFigure

DRAWN = 4  # columns whose curves are shown
LISTED = 100  # columns, and differences of models


def write_comparison_page(
    result: DiffResult, options: PageOptions, worst: WorstFrames | None = None, command: str = ""
) -> None:
    """Writes the page about a comparison.

    Args:
      worst: the two frames that differ most, of pictures.

    Raises:
      UsageError: the page would replace a compared file.
      BadValueError: its name does not end with .html.
      FileError: it cannot be written.
      MissingExtraError: tables differ, and matplotlib is missing.
    """
    assert options.html is not None
    if os.path.realpath(options.html) in map(os.path.realpath, (result.a, result.b)):
        raise UsageError(f"{option('html')} {clean(options.html)} is a compared file; give the page another name")
    with PageWriter(options.html) as writer:
        writer.write(comparison_page(result, options, worst, command))
        writer.publish()


def comparison_page(
    result: DiffResult, options: PageOptions, worst: WorstFrames | None = None, command: str = ""
) -> Page:
    """Returns the page about a comparison."""
    columns = [column for column in result.table.columns if column.first] if result.table else []
    has_files = result.kind == "table" and STDIN not in (result.a, result.b)
    versions = {"mujoco": mujoco.mj_versionString(), "numpy": np.__version__}
    paths = [path for path in (result.a, result.b) if Path(path).suffix.lower() in VIDEOS]
    return Page(
        title=f"{result.a} and {result.b}",
        maker=MAKER,
        verdict=(result.equal, "they agree" if result.equal else "they differ"),
        facts=[*_differences(result), *_columns(columns, result)],
        figures=[_curves(result, columns)] if has_files and columns else [],
        pairs=[_pair(result, worst)] if worst is not None else [],
        files=[page_file(path, str(options.html), options.embed_up_to) for path in paths],
        manifests=[origin("This comparison", command, (result.a, result.b), versions)],
        notes=[f"Possible reason: {note}" for note in result.notes],
    )


def _differences(result: DiffResult) -> list[PageFactTable]:
    if not result.differences:
        return []
    rows = [[str(number + 1), sentence] for number, sentence in enumerate(result.differences[:LISTED])]
    if (more := len(result.differences) - LISTED) > 0:
        rows.append(["…", f"and {more} more"])
    return [PageFactTable("Differences", "What differs", ("", "Difference"), rows)]


def _columns(columns: Sequence[ColumnDifference], result: DiffResult) -> list[PageFactTable]:
    """Returns a table of the columns that differ."""
    if not columns or result.table is None:
        return []
    units = any(column.unit for column in columns)
    rows = [
        [
            column.name,
            *([column.unit] if units else []),
            f"{column.differing} of {result.table.rows}",
            _number(column.maximum),
            _number(column.rms),
        ]
        for column in columns[:LISTED]
    ]
    heads = ("Column", *(["Unit"] if units else []), "Rows that differ", "Largest", "RMS")
    numeric = range(1 + units, len(heads))
    return [PageFactTable("Columns that differ", "Columns with numbers beyond the tolerance", heads, rows, numeric)]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _curves(result: DiffResult, columns: Sequence[ColumnDifference]) -> PageFigure:
    """Draws the columns that differ most, of A and B in the same panels."""
    require_matplotlib()
    chosen = [column.name for column in columns if not column.text][:DRAWN]
    with ExitStack() as stack:
        figure = TableFigure([result.a, result.b], FigureOptions(y=tuple(chosen)), stack, ["A", "B"])
        figure.read()
        return figure.for_page()


def _pair(result: DiffResult, worst: WorstFrames) -> PictureSlider:
    """Returns the two pictures that differ most, and their difference."""
    assert result.picture
    (a, b), difference, scale = shown_frames(worst)
    facts = frame_facts(result.picture.worst) if result.picture.worst else "no difference"
    when = result.picture.worst.time if result.picture.worst else None
    at = "" if when is None or result.picture.frames == 1 else f"{when:.6g} s: "
    return PictureSlider(
        _address(a), _address(b), a.shape[1], f"{at}{facts}", _address(difference), f"Difference, {scale}"
    )


def _address(pixels: np.ndarray) -> str:
    """Returns a picture as a data URI."""
    content = png(ImageData(np.ascontiguousarray(pixels), 0, None, {}))
    return f"data:image/png;base64,{base64.b64encode(content).decode()}"
