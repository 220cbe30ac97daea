"""Comparison of two results: tables, recordings, videos, images or models."""

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import field
from functools import partial
from os import fspath
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

from mjrun.diff.result import DiffResult
from mjrun.diff.sentences import table_sentences
from mjrun.diff.table_files import is_results
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import UsageError, clean, option
from mjrun.formats import codecs, image_reader, tables
from mjrun.formats.image_format import image_format
from mjrun.formats.input_file import is_folder, require_file
from mjrun.formats.recording import ARRAYS
from mjrun.formats.table_reader import STDIN
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.diff import DiffOptions
from mjrun.options.option import is_given, options, options_of
from mjrun.plotting.page_writer import check_page_name
from mjrun.reporter import Reporter, WarningReporter, pass_on

if TYPE_CHECKING:
    from mjrun.diff.images_and_videos import WorstFrames

TABLE, RECORDING, VIDEO, IMAGE, MODEL = "table", "recording", "video", "image", "model"


Compared = tuple[DiffResult, "WorstFrames | None"]  # the result, and the two frames that differ most


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
            check_page_name(self.html)
        if a is None or b is None or (kind := common_kind(a, b)) == MODEL:
            self._require_applicable(MODEL)
            result, worst = _models(self, self.a, self.b, reporter), None
        else:
            self._require_applicable(kind)
            result, worst = COMPARISONS[kind](self, a, b)
        if self.html is not None:
            from mjrun.outputs.comparison_page import write_comparison_page

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
        case Source() | mujoco.MjModel():
            return None
        case str():
            return compared
        case _:
            return fspath(compared)


def _tables(diff: Diff, a: str, b: str) -> Compared:
    from mjrun.diff.table_files import compare_tables

    table, notes = compare_tables(a, b, diff)
    differences = table_sentences(table, clean(a), clean(b), common=diff.common)
    return DiffResult(TABLE, a, b, not differences, differences, notes, table), None


def _recordings(diff: Diff, a: str, b: str) -> Compared:
    from mjrun.diff.recordings import compare_recordings

    model = None if diff.model is None else source_of(diff.model).load()
    table, differences, notes = compare_recordings(a, b, diff, model)
    differences += table_sentences(table, clean(a), clean(b), "state", common=diff.common) if table else []
    return DiffResult(RECORDING, a, b, not differences, differences, notes, table), None


def _models(diff: Diff, a: ModelLike, b: ModelLike, reporter: Reporter | None) -> DiffResult:
    from mjrun.diff.models import compare_models
    from mjrun.diff.sentences import model_sentences

    tolerances = Tolerances(Tolerance(diff.atol, diff.rtol), diff.tol)
    model = compare_models(source_of(a), source_of(b), tolerances)
    pass_on(model.warnings, reporter or WarningReporter())
    return DiffResult(MODEL, model.a, model.b, model.equal, model_sentences(model), model=model)


def _pictures(kind: str, diff: Diff, a: str, b: str) -> Compared:
    from mjrun.diff.images_and_videos import compare_images, compare_videos, require_library
    from mjrun.diff.sentences import picture_sentences
    from mjrun.outputs.worst_difference_image import write_worst_frame

    for path in (a, b):
        if not is_folder(Path(path)):
            require_file(Path(path), kind, [*image_reader.SUFFIXES, *codecs.suffixes()])
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
        facts = [f"{clean(path)} is {_with_article(kind)}" for path, kind in zip((a, b), kinds, strict=True)]
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
        return TABLE if is_results(path) else VIDEO
    if suffix in image_reader.SUFFIXES and not (suffix == ".webp" and _is_animated(path)):
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


def _with_article(kind: str) -> str:
    return f"{'an' if kind == IMAGE else 'a'} {kind}"
