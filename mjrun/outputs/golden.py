"""The golden table of a trace: what is measured must agree with it, or becomes it."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjrun.errors import FileError, UsageError, clean, option
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.input_file import exists
from mjrun.formats.manifest import SidecarWriter, sidecar_path
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import input_format, output_format
from mjrun.model.column import Column
from mjrun.options.option import is_given
from mjrun.options.trace import GoldenOptions

if TYPE_CHECKING:
    from mjrun.diff.golden import GoldenComparison
    from mjrun.diff.result import DiffResult

KIND = "golden"
STATED = ("mjrun", "mujoco")  # what a verdict says of the origin in any case
LISTED = 10  # differences that a message lists


def check_options(options: GoldenOptions) -> None:
    """Raises UsageError if options of a golden table are given without one, or it has no format that can be read."""
    if options.golden is None:
        useless = [name for name in ("update", "atol", "rtol", "tol") if is_given(options, name)]
        if useless:
            raise UsageError(f"{option(useless[0])} is about a golden table; which one? give {option('golden')} FILE")
        return
    input_format(Path(options.golden))


def require_golden_table(options: GoldenOptions) -> None:
    """Raises FileError if there is no golden table, and none is to be made."""
    if options.golden is not None and not options.update and not exists(options.golden):
        raise FileError(
            options.golden, "there is no such golden table", f"{option('update')} makes it of this simulation"
        )


def golden_files(options: GoldenOptions) -> list[str]:
    """The files that an update writes: the golden table, and its manifest where that is beside it."""
    if options.golden is None or not options.update:
        return []
    beside = sidecar_path(Path(options.golden))
    return [options.golden, *([str(beside)] if beside else [])]


class GoldenTable:
    """A golden table that is open: to compare with, to be replaced, or both.

    Args:
      options: with a `golden` one.
      columns: of the rows that come.
      facts: what makes them, for the manifest.
      stack: closes what is open.

    Raises:
      FileError: it cannot be read, or written.
      UsageError: it has no column in common with the rows, or a tolerance is for none of them.
    """

    def __init__(
        self, options: GoldenOptions, columns: Sequence[Column], facts: Mapping[str, object], stack: ExitStack
    ) -> None:
        assert options.golden is not None
        self._path, self._update, self._facts = options.golden, options.update, facts
        self._comparison: GoldenComparison | None = None
        self._table: TableWriter | None = None
        self._obstacle = ""  # to a comparison with what is replaced
        if not self._update or exists(self._path):
            self._compare(options, columns, stack)
        self._writers: list[OutputWriter] = []
        if self._update:
            name = output_format(self._path).name
            self._table = stack.enter_context(TableWriter(self._path, name, columns, facts))
            self._writers.append(self._table)
            if beside := sidecar_path(Path(self._path)):
                self._writers.append(stack.enter_context(SidecarWriter(self._table, beside, facts)))

    def write(self, values: np.ndarray) -> None:
        """Takes rows, float64 `(n, columns)`."""
        if self._comparison:
            self._comparison.add(values)
        if self._table:
            self._table.write(values)

    def finish(self, source: str, *, replace: bool) -> "tuple[DiffResult, list[OutputWriter]]":
        """What the comparison comes to, and what there is to publish.

        Args:
          source: what the simulation is called.
          replace: whether the rows are worth a golden table, if one is to be made.
        """
        from mjrun.diff.provenance import provenance_notes
        from mjrun.diff.result import DiffResult, GoldenFacts
        from mjrun.diff.sentences import table_sentences

        table = self._comparison.finish() if self._comparison else None
        differences = [self._obstacle] if self._obstacle else []
        differences += table_sentences(table, clean(self._path), clean(source)) if table else []
        manifest = self._comparison.manifest if self._comparison else None
        writers = self._writers if replace else []
        for writer in writers:
            writer.finish()
        versions = [str((each or {}).get(key) or "") for each in (manifest, self._facts) for key in STATED]
        facts = GoldenFacts(*versions, updated=bool(writers))
        notes = provenance_notes(_rest(manifest or {}), _rest(self._facts))
        equal = not differences
        return DiffResult(KIND, self._path, source, equal, differences, notes, table, golden=facts), writers

    def _compare(self, options: GoldenOptions, columns: Sequence[Column], stack: ExitStack) -> None:
        from mjrun.diff.golden import GoldenComparison
        from mjrun.diff.tolerances import Tolerance, Tolerances

        tolerances = Tolerances(Tolerance(options.atol, options.rtol), options.tol)
        try:
            self._comparison = GoldenComparison(self._path, columns, tolerances)
        except (FileError, UsageError) as error:
            if not self._update:
                raise
            self._obstacle = str(error).splitlines()[0]
        else:
            stack.callback(self._comparison.close)


def _rest(manifest: Mapping[str, object]) -> dict[str, object]:
    return {key: value for key, value in manifest.items() if key not in STATED}


def difference_message(result: "DiffResult") -> str:
    """What differs from a golden table, in a few lines."""
    from mjrun.diff.sentences import golden_versions

    assert result.golden
    hidden = len(result.differences) - LISTED
    more = [f"… and {hidden} more"] if hidden > 0 else []
    lines = [*result.differences[:LISTED], *more, *result.notes]
    verdict = f"{clean(result.b)} differs from the golden table {clean(result.a)}"
    return "\n".join([f"{verdict}; {golden_versions(result.golden)}", *lines])
