"""Writing of figures: a drawing becomes one published file, with the same bytes for the same drawing."""

import io
import os
import warnings
from collections.abc import Mapping
from pathlib import Path

from mjrun.errors import BadValueError, clean, option
from mjrun.formats.image_encoding import ImageData
from mjrun.formats.image_format import DRAWINGS, FORMATS
from mjrun.formats.output_writer import OutputWriter, StagedFile, StandardOutput
from mjrun.packages import require
from mjrun.plotting.figure_data import DrawnFigure, PanelGrid
from mjrun.plotting.study.figure_data import DrawnStudyFigure
from mjrun.plotting.theme import THEMES, adaptive

LIBRARY, EXTRA = "matplotlib", "plot"
EPOCH = "SOURCE_DATE_EPOCH"  # the date of a pdf, which matplotlib parses even if there is to be none


def require_matplotlib() -> None:
    """Raises MissingExtraError or WrongVersionError if matplotlib cannot be used."""
    require("a plot", EXTRA, LIBRARY)


class FigureWriter(OutputWriter):
    """A writer of one figure. Opening it proves that the output can be written.

    Args:
      output: a file, or None for standard output.
      format: name of a format in `mjrun.formats.image_format`.
      size: width and height [pixels].
      tags: title, comment and description, embedded if the format supports them.

    Raises:
      FileError: the output cannot be written.
      BadValueError: the format does not support a figure of this size.
    """

    def __init__(
        self,
        output: str | None,
        format: str,  # noqa: A002
        size: tuple[int, int],
        tags: Mapping[str, str] | None = None,
    ) -> None:
        self._name, self._tags = format, {name: clean(text) for name, text in (tags or {}).items()}
        largest = None if format in DRAWINGS else FORMATS["rgb"][format].largest
        if largest and max(size) > largest:
            raise BadValueError(option("size"), f"{size[0]}x{size[1]}", f"at most {largest} a side for {format}")
        super().__init__(StandardOutput(terminal=format == "svg") if output is None else StagedFile(Path(output)))

    def write(self, drawing: DrawnFigure | DrawnStudyFigure, grid: PanelGrid, style: str) -> None:
        """Draws and writes the figure.

        Raises:
          FileError: the disk is full.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        self.write_file(encoded(drawing, grid, style, self._name, self._tags))


def encoded(
    drawing: DrawnFigure | DrawnStudyFigure,
    grid: PanelGrid,
    style: str,
    format: str,  # noqa: A002
    tags: Mapping[str, str],
) -> bytes:
    """Draws a figure and returns it as the content of a file."""
    from mjrun.plotting.matplotlib_drawing import paint
    from mjrun.plotting.matplotlib_layout import MatplotlibFigure, settings
    from mjrun.plotting.study.matplotlib_drawing import paint_study

    theme = THEMES[style]
    with settings(theme, grid.em), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        canvas = MatplotlibFigure(grid, theme, any_letter=format == "svg")
        if isinstance(drawing, DrawnFigure):
            paint(drawing, grid, canvas)
        else:
            paint_study(drawing, grid, canvas)
        if format not in DRAWINGS:
            return FORMATS["rgb"][format].encode(ImageData(canvas.pixels(), 0, None, tags))
        # Not by savefig, which draws every figure once before, for the sake of its layout.
        file, metadata = io.BytesIO(), _metadata(format, tags)
        if format == "pdf":
            from matplotlib.backends.backend_pdf import FigureCanvasPdf

            epoch = os.environ.pop(EPOCH, None)
            try:
                FigureCanvasPdf(canvas.figure).print_pdf(file, metadata=metadata)
            finally:
                os.environ.update({} if epoch is None else {EPOCH: epoch})
            return file.getvalue()
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        FigureCanvasSVG(canvas.figure).print_svg(file, metadata=metadata)
        # Other fonts for systems without DejaVu Sans.
        return file.getvalue().replace(b"'DejaVu Sans'", b"'DejaVu Sans', Verdana, sans-serif")


def svg_text(drawing: DrawnFigure | DrawnStudyFigure, grid: PanelGrid, style: str) -> str:
    """Draws a figure as an `<svg>` element."""
    document = encoded(drawing, grid, style, "svg", {}).decode()
    return document[document.index("<svg") :]


def page_svg(drawing: DrawnFigure | DrawnStudyFigure, grid: PanelGrid, style: str = "light") -> str:
    """Draws a figure as an `<svg>` element for a page; in the light style, it follows the colours of the page."""
    svg = svg_text(drawing, grid, style)
    return adaptive(svg) if style == "light" else svg


def _metadata(format: str, tags: Mapping[str, str]) -> dict[str, str | None]:  # noqa: A002
    """Returns the metadata for matplotlib: mjrun's tags, and nothing that changes from day to day."""
    if format == "pdf":
        names = {"title": "Title", "comment": "Creator", "description": "Subject"}
        return {"CreationDate": None, "Producer": None, **{names[key]: text for key, text in tags.items()}}
    names = {"title": "Title", "comment": "Source", "description": "Description"}
    return {"Date": None, "Creator": None, **{names[key]: text for key, text in tags.items()}}
