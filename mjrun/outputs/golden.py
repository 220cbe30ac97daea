"""The golden table of a trace: the stored reference that results are compared with, or that they replace."""

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
from mjrun.model.table_column import Column
from mjrun.options.option import is_given
from mjrun.options.trace import GoldenOptions

if TYPE_CHECKING:
    from mjrun.diff.golden import GoldenComparison
    from mjrun.diff.result import DiffResult

KIND = "golden"
STATED = ("mjrun", "mujoco")  # facts of the origin that a verdict always states
LISTED = 10  # maximum number of differences in a message


def check_options(options: GoldenOptions) -> None:
    """Raises UsageError if golden-table options are set without a table, or if the table's format cannot be read."""
    if options.golden is None:
        useless = [name for name in ("update", "atol", "rtol", "tol") if is_given(options, name)]
        if useless:
            raise UsageError(f"{option(useless[0])} requires {option('golden')} FILE")
        return
    input_format(Path(options.golden))


def require_golden_table(options: GoldenOptions) -> None:
    """Raises FileError if the golden table does not exist and is not to be created."""
    if options.golden is not None and not options.update and not exists(options.golden):
        raise FileError(
            options.golden, "the golden table does not exist", f"{option('update')} creates it from this simulation"
        )


def golden_files(options: GoldenOptions) -> list[str]:
    """Returns the files that an update writes: the golden table, and its manifest if that is a separate file."""
    if options.golden is None or not options.update:
        return []
    beside = sidecar_path(Path(options.golden))
    return [options.golden, *([str(beside)] if beside else [])]


class GoldenTable:
    """An open golden table: to compare with, to replace, or both.

    Args:
      options: options with `golden` set.
      columns: the columns of the new rows.
      facts: the facts for the manifest.
      stack: closes the open files.

    Raises:
      FileError: the table cannot be read or written.
      UsageError: the table has no column in common with the rows, or a tolerance matches none of them.
    """

    def __init__(
        self, options: GoldenOptions, columns: Sequence[Column], facts: Mapping[str, object], stack: ExitStack
    ) -> None:
        assert options.golden is not None
        self._path, self._update, self._facts = options.golden, options.update, facts
        self._comparison: GoldenComparison | None = None
        self._table: TableWriter | None = None
        self._obstacle = ""  # why there is no comparison with the table that is replaced
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
        """Compares and writes rows, float64 `(n, columns)`."""
        if self._comparison:
            self._comparison.add(values)
        if self._table:
            self._table.write(values)

    def finish(self, source: str, *, replace: bool) -> "tuple[DiffResult, list[OutputWriter]]":
        """Completes the comparison, and returns it with the writers that are ready to publish.

        Args:
          source: the name of the simulation.
          replace: whether the rows may become the golden table if an update is requested.
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
    """Lists the differences from a golden table in a few lines."""
    from mjrun.diff.sentences import golden_versions

    assert result.golden
    hidden = len(result.differences) - LISTED
    more = [f"… and {hidden} more"] if hidden > 0 else []
    lines = [*result.differences[:LISTED], *more, *result.notes]
    verdict = f"{clean(result.b)} differs from the golden table {clean(result.a)}"
    return "\n".join([f"{verdict}; {golden_versions(result.golden)}", *lines])
