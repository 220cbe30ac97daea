"""Comparison of two results: tables, recordings, videos, images or models."""

import math
import os
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import field
from functools import partial
from os import fspath
from pathlib import Path

import mujoco
import numpy as np

from mjrun.diff.images_and_videos import WorstFramePair, compare_images, compare_videos, is_colour, require_library
from mjrun.diff.result import ColumnDifference, DiffResult, FrameDifference
from mjrun.diff.sentences import frame_facts, model_sentences, percent, picture_sentences, table_sentences
from mjrun.diff.table_files import compare_tables, is_results
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import UsageError, clean, file_errors, option
from mjrun.formats import codecs, tables
from mjrun.formats.image_and_video_reader import IMAGE_SUFFIXES
from mjrun.formats.image_encoding import ImageData, png
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.formats.input_file import is_folder, require_file
from mjrun.formats.recording import ARRAYS
from mjrun.formats.table_reader import STDIN
from mjrun.model.mujoco_globals import report_warnings
from mjrun.model.source import ModelSource
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.diff import DiffOptions
from mjrun.options.option import is_given, options, options_of
from mjrun.options.plot import FigureOptions
from mjrun.options.report import PageOptions
from mjrun.plotting import html_page
from mjrun.plotting.figure_writer import require_matplotlib
from mjrun.plotting.table_figure import TableFigure
from mjrun.rendering.colormaps import UNSEEN, colormap_table
from mjrun.rendering.text import BACKGROUND, INK, baseline, crisp, fitted, letters, spacing, text_size, write
from mjrun.reporter import PythonApiReporter, Reporter

TABLE, RECORDING, VIDEO, IMAGE, MODEL = "table", "recording", "video", "image", "model"


BY_CONTENT = (".npz", ".webp")  # suffixes of files of two kinds
Compared = tuple[DiffResult, WorstFramePair | None]  # the result, and the two frames that differ most
DRAWN = 4  # columns whose curves are shown
LISTED = 100  # columns, and differences of models
GAP = 8  # pixels between the images
LEGIBLE = 240  # minimum width and height of an image [pixels]: smaller ones are enlarged
FAINT = (168, 170, 176)  # the second line of a label
GAINS = (1, 2, 4, 8, 16, 32, 64, 128, 255)  # factors that make a difference visible
TYPICAL = 99.0  # percentile of the differences that amplification must not clip
COMMON = (1, 92)  # percentiles at the ends of the colour scale: the horizon is far away
MAP, DIFFERENCE_MAP = "turbo", "inferno"


@options
class Diff(DiffOptions):
    """A comparison of two tables, recordings, videos, images or models: its options are keywords.

    Args:
      a, b: the inputs, both of the same kind, which is detected from the files; a model may be compiled.
      command: the command line, for the page.
    """

    a: ModelLike = field(kw_only=False)
    b: ModelLike = field(kw_only=False)
    command: str = ""

    def run(self, reporter: Reporter | None = None) -> DiffResult:
        """Compares the two inputs.

        Raises:
          FileError: a file cannot be read.
          ModelError: a model cannot be found, read or compiled.
          UsageError: the inputs are of different kinds, or an option does not apply to their kind.
        """
        a, b = _name(self.a), _name(self.b)
        if self.html is not None:
            html_page.check_page_name(self.html)
        if a is None or b is None or (kind := common_kind(a, b)) == MODEL:
            self._require_applicable(MODEL)
            result, worst = _models(self, self.a, self.b, reporter), None
        else:
            self._require_applicable(kind)
            result, worst = COMPARISONS[kind](self, a, b)
        if self.html is not None:
            write_comparison_page(result, self, worst, self.command)
        return result

    def _require_applicable(self, kind: str) -> None:
        """Raises UsageError if an option is set that does not apply to results of this kind."""
        useless = [each.name for each in options_of(DiffOptions) if is_given(self, each.name)]
        useless = [option(name) for name in useless if name not in APPLICABLE[kind]]
        if useless:
            raise UsageError(f"{', '.join(useless)} does not apply to {kind}s")


def _name(compared: ModelLike) -> str | None:
    """Returns the path or source text of an input; None for a model object."""
    match compared:
        case ModelSource() | mujoco.MjModel():
            return None
        case str():
            return compared
        case _:
            return fspath(compared)


def _tables(diff: Diff, a: str, b: str) -> Compared:
    table, notes = compare_tables(a, b, diff)
    differences = table_sentences(table, clean(a), clean(b), common=diff.common)
    return DiffResult(TABLE, a, b, not differences, differences, notes, table), None


def _recordings(diff: Diff, a: str, b: str) -> Compared:
    from mjrun.diff.table_files import compare_recordings

    model = None if diff.model is None else source_of(diff.model).load()
    table, differences, notes = compare_recordings(a, b, diff, model)
    differences += table_sentences(table, clean(a), clean(b), "state", common=diff.common) if table else []
    return DiffResult(RECORDING, a, b, not differences, differences, notes, table), None


def _models(diff: Diff, a: ModelLike, b: ModelLike, reporter: Reporter | None) -> DiffResult:
    from mjrun.diff.models import compare_models

    tolerances = Tolerances(Tolerance(diff.atol, diff.rtol), diff.tol)
    model = compare_models(source_of(a), source_of(b), tolerances)
    report_warnings(model.warnings, reporter or PythonApiReporter())
    return DiffResult(MODEL, model.a, model.b, model.equal, model_sentences(model), model=model)


def _pictures(kind: str, diff: Diff, a: str, b: str) -> Compared:
    for path in (a, b):
        if not is_folder(Path(path)):
            require_file(Path(path), kind, [*IMAGE_SUFFIXES, *codecs.suffixes()])
    require_library(diff)
    if diff.output is not None:
        image_format(diff.output, "rgb")
    compare = compare_videos if kind == VIDEO else compare_images
    picture, worst = compare(a, b, Tolerance(diff.atol, diff.rtol))
    differences = picture_sentences(picture, clean(a), clean(b), diff)
    if diff.output is not None and worst is not None:
        write_worst_frame(diff.output, worst, (a, b), picture.worst)
    return DiffResult(kind, a, b, not differences, differences, picture=picture), worst


# Options that apply to files of each kind.
TOLERANCE, PAGE = {"atol", "rtol"}, {"html", "embed_up_to"}
LIMITS = {"min_psnr", "min_ssim", "max_changed", "output"}
APPLICABLE = {
    TABLE: TOLERANCE | PAGE | {"tol", "columns", "align", "common"},
    RECORDING: TOLERANCE | PAGE | {"tol", "columns", "model", "common"},
    VIDEO: TOLERANCE | PAGE | LIMITS,
    IMAGE: TOLERANCE | PAGE | LIMITS,
    MODEL: TOLERANCE | PAGE | {"tol"},
}

# The function that compares files of each kind.
COMPARISONS: Mapping[str, Callable[[Diff, str, str], Compared]] = {
    TABLE: _tables,
    RECORDING: _recordings,
    VIDEO: partial(_pictures, VIDEO),
    IMAGE: partial(_pictures, IMAGE),
}


def common_kind(a: str, b: str) -> str:
    """Returns the kind of both files.

    Raises:
      UsageError: the files are of different kinds.
      FileError: one of them does not exist.
    """
    kinds = kind_of(a), kind_of(b)
    if kinds[0] != kinds[1]:
        for path, kind in zip((a, b), kinds, strict=True):
            if kind == MODEL and (file := source_of(path).main_file):  # as is whatever has another suffix, or none
                require_file(file, "file", tables.suffixes())
            elif Path(path).suffix.lower() in BY_CONTENT:
                require_file(Path(path), "file", tables.suffixes())
        pairs = zip((a, b), kinds, strict=True)
        facts = [f"{clean(path)} is {'an' if kind == IMAGE else 'a'} {kind}" for path, kind in pairs]
        raise UsageError(f"{' and '.join(facts)}: only results of the same kind can be compared")
    return kinds[0]


def kind_of(name: str) -> str:
    """Returns the kind of a file by its suffix, and of an archive or a .webp by its content.

    Any other file is a model. A folder is that of a study or an evaluation, or contains the frames of a video.
    """
    path, suffix = Path(name), Path(name).suffix.lower()
    if name == STDIN:
        return TABLE
    if suffix == ".npz":
        return RECORDING if _is_recording(path) else TABLE
    if suffix in tables.suffixes():
        return TABLE
    if is_folder(path):
        with file_errors(name), os.scandir(name):  # a folder that cannot be read is neither
            return TABLE if is_results(path) else VIDEO
    if suffix in IMAGE_SUFFIXES and not (suffix == ".webp" and _is_animated(path)):
        return IMAGE
    return VIDEO if suffix in codecs.suffixes() else MODEL


def _is_recording(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return {f"{name}.npy" for name in ARRAYS} <= set(archive.namelist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return False  # reading it as a table reports the fault


def _is_animated(path: Path) -> bool:
    """Returns whether a WebP file is animated: https://developers.google.com/speed/webp/docs/riff_container."""
    try:
        with path.open("rb") as file:
            head = file.read(21)
    except OSError:
        return False
    return head[12:16] == b"VP8X" and len(head) == 21 and bool(head[20] & 2)


def write_comparison_page(
    result: DiffResult, options: PageOptions, worst: WorstFramePair | None = None, command: str = ""
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
    html_page.write_page(options.html, comparison_page(result, options, worst, command))


def comparison_page(
    result: DiffResult, options: PageOptions, worst: WorstFramePair | None = None, command: str = ""
) -> html_page.Page:
    """Returns the page about a comparison."""
    columns = [column for column in result.table.columns if column.first] if result.table else []
    has_files = result.kind == "table" and STDIN not in (result.a, result.b)
    versions = {"mujoco": mujoco.mj_versionString(), "numpy": np.__version__}
    paths = [path for path in (result.a, result.b) if Path(path).suffix.lower() in html_page.VIDEOS]
    return html_page.Page(
        title=f"{result.a} and {result.b}",
        maker=html_page.MAKER,
        verdict=(result.equal, "they agree" if result.equal else "they differ"),
        facts=[*_differences(result), *_columns(columns, result)],
        figures=[_curves(result, columns)] if has_files and columns else [],
        pairs=[_pair(result, worst)] if worst is not None else [],
        files=[html_page.page_file(path, str(options.html), options.embed_up_to) for path in paths],
        manifests=[html_page.origin("This comparison", command, (result.a, result.b), versions)],
        notes=[f"Possible reason: {note}" for note in result.notes],
    )


def _differences(result: DiffResult) -> list[html_page.PageFactTable]:
    if not result.differences:
        return []
    rows = [[str(number + 1), sentence] for number, sentence in enumerate(result.differences[:LISTED])]
    if (more := len(result.differences) - LISTED) > 0:
        rows.append(["…", f"and {more} more"])
    return [html_page.PageFactTable("Differences", "What differs", ("", "Difference"), rows)]


def _columns(columns: Sequence[ColumnDifference], result: DiffResult) -> list[html_page.PageFactTable]:
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
    return [
        html_page.PageFactTable(
            "Columns that differ", "Columns with numbers beyond the tolerance", heads, rows, numeric
        )
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _curves(result: DiffResult, columns: Sequence[ColumnDifference]) -> html_page.PageFigure:
    """Draws the columns that differ most, of A and B in the same panels."""
    require_matplotlib()
    chosen = [column.name for column in columns if not column.text][:DRAWN]
    with ExitStack() as stack:
        figure = TableFigure([result.a, result.b], FigureOptions(y=tuple(chosen)), stack, ["A", "B"])
        figure.read()
        return figure.for_page()


def _pair(result: DiffResult, worst: WorstFramePair) -> html_page.ImageSlider:
    """Returns the two pictures that differ most, and their difference."""
    assert result.picture
    (a, b), difference, scale = shown_frames(worst)
    facts = frame_facts(result.picture.worst) if result.picture.worst else "no difference"
    when = result.picture.worst.time if result.picture.worst else None
    at = "" if when is None or result.picture.frames == 1 else f"{when:.6g} s: "
    return html_page.ImageSlider(
        _address(a), _address(b), a.shape[1], f"{at}{facts}", _address(difference), f"Difference, {scale}"
    )


def _address(pixels: np.ndarray) -> str:
    """Returns a picture as a data URI."""
    return html_page.data_uri("image/png", png(ImageData(np.ascontiguousarray(pixels), 0, None, {})))


def write_worst_frame(output: str, frames: WorstFramePair, names: Sequence[str], frame: FrameDifference | None) -> None:
    """Writes the comparison image.

    Args:
      output: path of a colour image.
      names: names of A and B for the labels.
      frame: the difference of the two frames; None if they are equal.

    Raises:
      FileError: the image cannot be written.
      UnknownNameError, UsageError: the suffix does not suit a colour image.
    """
    picture = worst_frame(frames, names, frame)
    form = image_format(output, "rgb")
    with ImageWriter(output, "rgb", form, (picture.shape[1], picture.shape[0])) as writer:
        writer.write(picture)
        writer.publish()


def worst_frame(frames: WorstFramePair, names: Sequence[str], frame: FrameDifference | None) -> np.ndarray:
    """Returns the comparison image, `(height, width, 3)` uint8."""
    shown, difference, scale = shown_frames(frames)
    factor = max(1, math.ceil(LEGIBLE / min(frames.a.shape[:2])))
    panels = [panel.repeat(factor, axis=0).repeat(factor, axis=1) for panel in (*shown, difference)]
    when = "" if frame is None or frame.time is None else f"frame {frame.frame}, {frame.time:.6g} s"
    labels = [("A", Path(names[0]).name, when), ("B", Path(names[1]).name, when), ("difference", scale, _facts(frame))]
    return _side_by_side(panels, labels)


def shown_frames(frames: WorstFramePair) -> tuple[list[np.ndarray], np.ndarray, str]:
    """Returns A and B and their difference as colours, `(height, width, 3)` uint8 each, and the scale of the latter."""
    return (_colours if is_colour(frames.a) else _numbers)(frames.a, frames.b)


def _facts(frame: FrameDifference | None) -> str:
    if frame is None:
        return "none"
    psnr = "" if frame.psnr is None else f"{frame.psnr:.1f} dB"
    ssim = "" if frame.ssim is None else f"SSIM {frame.ssim:.3f}"
    return ", ".join(filter(None, (psnr, ssim, f"{percent(frame.changed)} changed")))


def _colours(a: np.ndarray, b: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, str]:
    """Returns both images, their amplified difference, and the gain."""
    one, other = a[..., :3], b[..., :3]
    size = np.abs(one.astype(np.int16) - other)
    # The few pixels that differ most may be clipped, so that the others become visible.
    large = float(np.percentile(size[size > 0], TYPICAL)) if size.any() else 255.0
    gain = max((gain for gain in GAINS if gain * large <= 255), default=1)
    return [one, other], np.minimum(size * gain, 255).astype(np.uint8), f"× {gain}"


def _numbers(a: np.ndarray, b: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, str]:
    """Maps both to one colour scale and their difference to another; values that are not finite are grey."""
    one, other = a.astype(np.float64), b.astype(np.float64)
    finite = np.concatenate([one[np.isfinite(one)], other[np.isfinite(other)]])
    low, high = np.percentile(finite, COMMON).tolist() if finite.size else (0.0, 0.0)
    with np.errstate(invalid="ignore"):
        size = np.where(one == other, 0.0, np.abs(one - other))
    changed = size[np.isfinite(size) & (size > 0)]
    large = float(np.percentile(changed, TYPICAL)) if changed.size else 0.0
    shown = [_mapped(values, low, high, MAP) for values in (one, other)]
    return shown, _mapped(size, 0.0, large, DIFFERENCE_MAP), f"0 to {large:.3g}"


def _mapped(values: np.ndarray, low: float, high: float, colormap: str) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.nan_to_num((values - low) / (high - low), nan=0.0, posinf=0.0, neginf=0.0)
    colours = colormap_table(colormap)[np.round(255 * share.clip(0, 1)).astype(int)]
    colours[~np.isfinite(values)] = UNSEEN
    return colours


def _side_by_side(panels: Sequence[np.ndarray], labels: Sequence[tuple[str, str, str]]) -> np.ndarray:
    """Places images of one size side by side, each under two lines: a word with a name, and facts."""
    height, width = panels[0].shape[:2]
    size = crisp(text_size(height))
    _, _, _, line = spacing(size)
    top = 2 * line + 2 * GAP
    canvas = np.full((top + height + GAP, GAP + len(panels) * (width + GAP), 3), BACKGROUND, np.uint8)
    for index, (panel, (word, name, facts)) in enumerate(zip(panels, labels, strict=True)):
        left = GAP + index * (width + GAP)
        canvas[top : top + height, left : left + width] = panel
        for row, (text, colour) in enumerate(((f"{word}  {name}", INK), (facts, FAINT))):
            shown = fitted(letters(text), size, width)
            write(canvas, shown, (left, baseline(GAP + row * line, line, size)), size, colour)
    return canvas
