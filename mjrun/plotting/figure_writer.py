"""Writes figures: a drawing becomes one published file, with the same bytes for the same drawing."""

import io
import re
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.errors import BadValueError, clean, option
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile, StandardOutput
from mjrun.formats.figure_format import DRAWINGS
from mjrun.formats.image_format import FORMATS, ImageData
from mjrun.packages import require
from mjrun.plotting.drawing import Drawing
from mjrun.plotting.panel_grid import PanelGrid
from mjrun.plotting.theme import THEMES, Theme

if TYPE_CHECKING:
    from mjrun.plotting.canvas import Canvas

# Draws a canvas in a theme; letters that the font does not have are left as they are, or not.
Draw = Callable[[Theme, bool], "Canvas"]

LIBRARY, EXTRA = "matplotlib", "plot"


def require_matplotlib() -> None:
    """Raises MissingExtraError or WrongVersionError if matplotlib cannot be used."""
    require("a plot", EXTRA, LIBRARY)


class FigureWriter(OutputWriter):
    """Writes one figure. Opening it proves that the output can be written.

    Args:
      output: a file, or None for standard output.
      format: a name from `mjrun.formats.figure_format`.
      size: width and height [pixels].
      tags: title, comment and description, embedded where the format can hold them.

    Raises:
      FileError: the output cannot be written.
      BadValueError: the format cannot hold so large a figure.
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
            raise BadValueError(option("size"), f"{size[0]}x{size[1]}", f"at most {largest} a side, as {format} holds")
        super().__init__(StandardOutput(terminal=format == "svg") if output is None else StagedFile(Path(output)))

    def write(self, drawing: Drawing, grid: PanelGrid, style: str) -> None:
        """Draws and writes the figure.

        Raises:
          FileError: the disk is full.
          ClosedPipeError: nobody reads standard output any more.
        """
        self.write_file(encoded(drawing, grid, style, self._name, self._tags))

    def write_drawn(self, draw: Draw, style: str) -> None:
        """Writes what a function draws.

        Raises:
          FileError, ClosedPipeError: as `write`.
        """
        self.write_file(encoded_canvas(draw, style, self._name, self._tags))


def encoded(drawing: Drawing, grid: PanelGrid, style: str, format: str, tags: Mapping[str, str]) -> bytes:  # noqa: A002
    """The figure as the content of a file."""
    return encoded_canvas(partial(_draw, drawing, grid), style, format, tags)


def encoded_canvas(draw: Draw, style: str, format: str, tags: Mapping[str, str]) -> bytes:  # noqa: A002
    """What a function draws as the content of a file."""
    from mjrun.plotting.canvas import settings

    with settings(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        canvas = draw(THEMES[style], format == "svg")
        if format not in DRAWINGS:
            encode = FORMATS["rgb"][format].encode
            assert encode  # all of colours have one
            return encode(ImageData(canvas.pixels(), 0, None, tags))
        file = io.BytesIO()
        canvas.figure.savefig(file, format=format, facecolor="auto", metadata=_metadata(format, tags))
        return file.getvalue() if format == "pdf" else _svg(file.getvalue().decode()).encode()


def svg_text(drawing: Drawing, grid: PanelGrid, style: str) -> str:
    """The figure as an `<svg>` element, to stand in a page."""
    return drawn_svg(partial(_draw, drawing, grid), style)


def drawn_svg(draw: Draw, style: str) -> str:
    """What a function draws as an `<svg>` element."""
    document = encoded_canvas(draw, style, "svg", {}).decode()
    return document[document.index("<svg") :]


def _draw(drawing: Drawing, grid: PanelGrid, theme: Theme, any_letter: bool) -> "Canvas":
    from mjrun.plotting.figure import draw

    return draw(drawing, grid, theme, any_letter=any_letter)


def _metadata(format: str, tags: Mapping[str, str]) -> dict[str, str | None]:  # noqa: A002
    """What matplotlib embeds: our tags, and nothing that changes from day to day."""
    if format == "pdf":
        names = {"title": "Title", "comment": "Creator", "description": "Subject"}
        return {"CreationDate": None, "Producer": None, **{names[key]: text for key, text in tags.items()}}
    names = {"title": "Title", "comment": "Source", "description": "Description"}
    return {"Date": None, "Creator": None, **{names[key]: text for key, text in tags.items()}}


def _svg(document: str) -> str:
    """The document with fonts to fall back on where DejaVu Sans is not installed."""
    return re.sub(r"'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif", document)
