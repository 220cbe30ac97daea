"""Comparison of two results: tables, recordings, videos, images or models."""

from collections.abc import Callable, Mapping
from dataclasses import field
from functools import partial
from os import fspath
from pathlib import Path

import mujoco

from mjrun.diff import file_kind
from mjrun.diff.result import DiffResult
from mjrun.diff.sentences import table_sentences
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import UsageError, clean, option
from mjrun.formats import codecs, image_reader
from mjrun.formats.image_format import image_format
from mjrun.formats.input_file import is_folder, require_file
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.diff import DiffOptions
from mjrun.options.option import is_given, options, options_of
from mjrun.reporter import Reporter, WarningReporter, pass_on


@options
class Diff(DiffOptions):
    """A comparison of two tables, recordings, videos, images or models: its options are keywords.

    Args:
      a, b: the inputs, both of the same kind, which is detected from the files; a model may be compiled.
    """

    a: ModelLike = field(kw_only=False)
    b: ModelLike = field(kw_only=False)

    def run(self, reporter: Reporter | None = None) -> DiffResult:
        """Compares the two inputs.

        Raises:
          FileError: a file cannot be read.
          ModelError: a model cannot be found, read or compiled.
          UsageError: the inputs are of different kinds, or an option does not apply to their kind.
        """
        a, b = _name(self.a), _name(self.b)
        if a is None or b is None or (kind := file_kind.common_kind(a, b)) == file_kind.MODEL:
            self._require_applicable(file_kind.MODEL)
            return _models(self, self.a, self.b, reporter)
        self._require_applicable(kind)
        return COMPARISONS[kind](self, a, b)

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


def _tables(diff: Diff, a: str, b: str) -> DiffResult:
    from mjrun.diff.table_files import compare_tables

    table, notes = compare_tables(a, b, diff)
    differences = table_sentences(table, clean(a), clean(b), common=diff.common)
    return DiffResult(file_kind.TABLE, a, b, not differences, differences, notes, table)


def _recordings(diff: Diff, a: str, b: str) -> DiffResult:
    from mjrun.diff.recordings import compare_recordings

    model = None if diff.model is None else source_of(diff.model).load()
    table, differences, notes = compare_recordings(a, b, diff, model)
    differences += table_sentences(table, clean(a), clean(b), "state", common=diff.common) if table else []
    return DiffResult(file_kind.RECORDING, a, b, not differences, differences, notes, table)


def _models(diff: Diff, a: ModelLike, b: ModelLike, reporter: Reporter | None) -> DiffResult:
    from mjrun.diff.models import compare_models
    from mjrun.diff.sentences import model_sentences

    tolerances = Tolerances(Tolerance(diff.atol, diff.rtol), diff.tol)
    model = compare_models(source_of(a), source_of(b), tolerances)
    pass_on(model.warnings, reporter or WarningReporter())
    return DiffResult(file_kind.MODEL, model.a, model.b, model.equal, model_sentences(model), model=model)


def _pictures(kind: str, diff: Diff, a: str, b: str) -> DiffResult:
    from mjrun.diff.pictures import compare_images, compare_videos, require_library
    from mjrun.diff.sentences import picture_sentences
    from mjrun.outputs.worst_frame_image import write_worst_frame

    for path in (a, b):
        if not is_folder(Path(path)):
            require_file(Path(path), kind, [*image_reader.SUFFIXES, *codecs.suffixes()])
    require_library(diff)
    if diff.output is not None:
        image_format(diff.output, "rgb")
    compare = compare_videos if kind == file_kind.VIDEO else compare_images
    picture, worst = compare(a, b, Tolerance(diff.atol, diff.rtol))
    differences = picture_sentences(picture, clean(a), clean(b), diff)
    if diff.output is not None and worst is not None:
        write_worst_frame(diff.output, worst, (a, b), picture.worst)
    return DiffResult(kind, a, b, not differences, differences, picture=picture)


# Options that apply to files of each kind.
TOLERANCE = {"atol", "rtol"}
LIMITS = {"min_psnr", "min_ssim", "max_changed", "output"}
APPLICABLE = {
    file_kind.TABLE: TOLERANCE | {"tol", "columns", "align", "common"},
    file_kind.RECORDING: TOLERANCE | {"tol", "columns", "model", "common"},
    file_kind.VIDEO: TOLERANCE | LIMITS,
    file_kind.IMAGE: TOLERANCE | LIMITS,
    file_kind.MODEL: TOLERANCE | {"tol"},
}

# The function that compares files of each kind.
COMPARISONS: Mapping[str, Callable[[Diff, str, str], DiffResult]] = {
    file_kind.TABLE: _tables,
    file_kind.RECORDING: _recordings,
    file_kind.VIDEO: partial(_pictures, file_kind.VIDEO),
    file_kind.IMAGE: partial(_pictures, file_kind.IMAGE),
}
