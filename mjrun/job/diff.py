"""`mjrun diff`: whether two results agree, and where they do not."""

from collections.abc import Callable, Mapping
from dataclasses import field
from os import PathLike, fspath

from mjrun.diff import file_kind
from mjrun.diff.result import DiffResult
from mjrun.diff.sentences import table_sentences
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.errors import UsageError, clean, option
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.diff import DiffOptions
from mjrun.options.option import is_given, options
from mjrun.reporter import Reporter, WarningReporter, pass_on

NOT_OF_MODELS = ("columns", "align", "model", "min_psnr", "min_ssim", "max_changed", "output")


@options
class Diff(DiffOptions):
    """A comparison of two tables, recordings, videos, images or models: its options are keywords.

    Args:
      a, b: what is compared; the kind is told from the files, and is the same for both. A model may be compiled.
    """

    a: ModelLike = field(kw_only=False)
    b: ModelLike = field(kw_only=False)

    def run(self, reporter: Reporter | None = None) -> DiffResult:
        """Compares them.

        Raises:
          FileError: a file cannot be read.
          ModelError: a model cannot be found, read or compiled.
          UsageError: they are of two kinds, or an option does not fit them.
        """
        if not (isinstance(self.a, str | PathLike) and isinstance(self.b, str | PathLike)):
            return _models(self, self.a, self.b, reporter)
        a, b = fspath(self.a), fspath(self.b)
        kind = file_kind.common_kind(a, b)
        if kind == file_kind.MODEL:
            return _models(self, a, b, reporter)
        return COMPARISONS[kind](self, a, b)


def _tables(diff: Diff, a: str, b: str) -> DiffResult:
    from mjrun.diff.table_files import compare_tables

    table, notes = compare_tables(a, b, diff)
    differences = table_sentences(table, clean(a), clean(b))
    return DiffResult(file_kind.TABLE, a, b, not differences, differences, notes, table)


def _recordings(diff: Diff, a: str, b: str) -> DiffResult:
    from mjrun.diff.recordings import compare_recordings

    model = None if diff.model is None else source_of(diff.model).load()
    table, differences, notes = compare_recordings(a, b, diff, model)
    differences += table_sentences(table, clean(a), clean(b), "state") if table else []
    return DiffResult(file_kind.RECORDING, a, b, not differences, differences, notes, table)


def _models(diff: Diff, a: ModelLike, b: ModelLike, reporter: Reporter | None) -> DiffResult:
    from mjrun.diff.model_lines import model_sentences
    from mjrun.diff.models import compare_models

    useless = [option(name) for name in NOT_OF_MODELS if is_given(diff, name)]
    if useless:
        raise UsageError(f"{', '.join(useless)}: this is for other results; models are compared without it")
    tolerances = Tolerances(Tolerance(diff.atol, diff.rtol), diff.tol)
    model = compare_models(source_of(a), source_of(b), tolerances)
    pass_on(model.warnings, reporter or WarningReporter())
    return DiffResult(file_kind.MODEL, model.a, model.b, model.equal, model_sentences(model), model=model)


# What compares two files of each kind.
COMPARISONS: Mapping[str, Callable[[Diff, str, str], DiffResult]] = {
    file_kind.TABLE: _tables,
    file_kind.RECORDING: _recordings,
}
