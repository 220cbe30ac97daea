"""`mjrun diff`: whether two results agree, and where they do not."""

from collections.abc import Callable, Mapping
from dataclasses import field
from os import fspath
from pathlib import Path

from mjrun.diff import file_kind
from mjrun.diff.result import DiffResult
from mjrun.diff.sentences import table_sentences
from mjrun.errors import clean
from mjrun.model.sources import source_of
from mjrun.options.diff import DiffOptions
from mjrun.options.option import options
from mjrun.reporter import Reporter


@options
class Diff(DiffOptions):
    """A comparison of two tables, recordings, videos, images or models: its options are keywords.

    Args:
      a, b: what is compared; the kind is told from the files, and is the same for both.
    """

    a: str | Path = field(kw_only=False)
    b: str | Path = field(kw_only=False)

    def run(self, reporter: Reporter | None = None) -> DiffResult:
        """Compares them.

        Raises:
          FileError: a file cannot be read.
          UsageError: they are of two kinds, or an option does not fit them.
        """
        a, b = fspath(self.a), fspath(self.b)
        kind = file_kind.common_kind(a, b)
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


# What compares two files of each kind.
COMPARISONS: Mapping[str, Callable[[Diff, str, str], DiffResult]] = {
    file_kind.TABLE: _tables,
    file_kind.RECORDING: _recordings,
}
