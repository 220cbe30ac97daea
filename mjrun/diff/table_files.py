"""Comparisons of files of tables: of two in any formats, of two recordings, and of a golden table with coming rows.

Tables of results of many simulations, the points of a study and the episodes of an evaluation, have keys.
"""

import contextlib
import queue
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.diff.result import TableDifference
from mjrun.diff.sentences import manifest_part, other_model, provenance_notes
from mjrun.diff.tables import compare_rows
from mjrun.diff.tolerances import Tolerance, Tolerances, matches, require_matches
from mjrun.errors import (
    CellError,
    MjrunError,
    UnknownNameError,
    UnrelatedTableError,
    UsageError,
    clean,
    concerning,
    listing,
    option,
    quoted,
)
from mjrun.formats.input_file import is_file, is_folder
from mjrun.formats.manifest import read_sidecar
from mjrun.formats.recording import RecordingReader
from mjrun.formats.table_reader import STDIN, OpenTable, open_table
from mjrun.formats.tables import input_format
from mjrun.model import state
from mjrun.model.table_column import Column
from mjrun.options.diff import ALIGNMENTS, TableDiffOptions
from mjrun.physics.recorded_states import moved_name, require_model
from mjrun.probe.fields import state_columns

STUDY, EPISODES = "results", "episodes"  # kinds, named after the stems of the files
SUFFIXES = (".parquet", ".csv")
POINT, EPISODE, POLICY, SEED, STATUS = "point", "episode", "policy", "seed", "status"
# The columns that identify each kind.
COLUMNS = {
    STUDY: (POINT, STATUS, "steps", "exit_code", "message"),
    EPISODES: (EPISODE, SEED, "return", "length", "steps", "ending", "outcome"),
}
TIME, ROW = ALIGNMENTS
STEP = "step"  # by which the states of recordings are aligned
QUEUED_BLOCKS = 4  # rows for a golden table that may wait for their comparison


@dataclass(frozen=True)
class RecognizedResultTable:
    """A table of results, recognized by its columns: its kind, and the columns that may identify a row.

    Attributes:
      kind: one of `COLUMNS`.
      keys: the columns that may identify a row; for a study they include its metrics.
    """

    kind: str
    keys: Sequence[str]

    @classmethod
    def of(cls, names: Sequence[str]) -> "RecognizedResultTable | None":
        """Returns the table with columns of these names; None if it is another kind of table."""
        if names[:1] == [POINT] and {*COLUMNS[STUDY]} <= {*names}:
            return cls(STUDY, names[: names.index(STATUS)])
        if {*COLUMNS[EPISODES]} <= {*names}:
            return cls(EPISODES, names[: names.index(SEED) + 1])
        return None

    def common_key(
        self, other: "RecognizedResultTable", manifests: Sequence[Mapping[str, Any] | None]
    ) -> tuple[Sequence[str], Sequence[str]]:
        """Returns the columns that identify a row in both tables, and those with row numbers, which are ignored."""
        both = [name for name in self.keys if name in other.keys]
        if self.kind == EPISODES:
            return [name for name in both if name not in (POINT, EPISODE)], (POINT, EPISODE)
        metrics = [manifest["metrics"] for manifest in manifests if manifest and "metrics" in manifest]
        parameters = [name for name in both if name != POINT and not any(name in each for each in metrics)]
        if not metrics or not parameters:  # parameters and metrics cannot be distinguished, or nothing varies
            return [POINT], ()
        return parameters, (POINT,)


def table_path(path: str) -> str:
    """Returns the table in the folder of a study or an evaluation; any other path unchanged."""
    return next(map(str, _tables(Path(path))), path) if is_folder(Path(path)) else path


def is_results(folder: Path) -> bool:
    """Returns whether a folder belongs to a study or an evaluation, and contains a table."""
    return bool(_tables(folder))


def result_manifest(path: Path) -> Mapping[str, Any] | None:
    """Returns the manifest of a .csv of results, which is in the table next to it."""
    beside = path.with_suffix(SUFFIXES[0])
    if path.stem not in COLUMNS or path.suffix != SUFFIXES[1] or not is_file(beside):
        return None
    with contextlib.suppress(MjrunError), open_table(beside, lambda name: False) as table:
        return table.manifest
    return None


def _tables(folder: Path) -> list[Path]:
    """Returns the tables in a folder that can be read here, the best first."""
    paths = [folder / f"{kind}{suffix}" for kind in COLUMNS for suffix in SUFFIXES]
    return [path for path in paths if is_file(path) and _is_readable(path)]


def _is_readable(path: Path) -> bool:
    with contextlib.suppress(MjrunError):
        input_format(path)
        return True
    return False


def compare_tables(a: str, b: str, options: TableDiffOptions) -> tuple[TableDifference, list[str]]:
    """Compares the columns that two tables have in common.

    Args:
      a, b: files, or folders of a study or an evaluation; one may be `-`, standard input.

    Returns:
      The differences, and possible reasons, in sentences.

    Raises:
      FileError: a file cannot be read as a table, has no rows, or its time decreases.
      UnknownNameError: a wildcard matches no column, or a column to align by is missing.
      UsageError: the tables have no columns in common, or cannot be aligned as requested.
    """
    if a == b == STDIN:
        raise UsageError("only one of the two can come from standard input")
    a, b = table_path(a), table_path(b)
    with ExitStack() as stack:
        (reader_a, names_a), (reader_b, names_b) = _open_both(a, b, options, stack)
        require_matches("columns", options.columns, dict.fromkeys([*names_a, *names_b]))
        manifests = [reader.manifest or result_manifest(Path(path)) for path, reader in ((a, reader_a), (b, reader_b))]
        key, ignored = _key(names_a, names_b, manifests, options)
        keys = [key] if isinstance(key, str) else list(key or ())

        def is_compared(name: str) -> bool:
            return name not in keys and name not in ignored and _is_chosen(name, options)

        columns = [name for name in reader_a.names if is_compared(name)]
        if not columns:
            raise UsageError(_nothing_in_common({a: names_a, b: names_b}, options))

        tolerances = Tolerances(Tolerance(options.atol, options.rtol), options.tol)
        tolerances.require([*columns, *keys])
        chosen_a, chosen_b = ([name for name in names if _is_chosen(name, options)] for names in (names_a, names_b))
        skip = partial(reader_a.skip_equal_rows, reader_b)
        try:
            table = compare_rows(reader_a, reader_b, columns, key, tolerances, chosen_a, chosen_b, skip)
        except CellError as error:
            error.add_note(f"{option('columns')} selects the columns to compare; others may contain anything")
            raise
        for reader in (reader_a, reader_b):
            reader.require_unchanged()
        return table, provenance_notes(*manifests)


def _open_both(a: str, b: str, options: TableDiffOptions, stack: ExitStack) -> list[tuple[OpenTable, list[str]]]:
    """Opens both tables with their common columns; returns each with the names of all of its columns."""
    first, second = (b, a) if b == STDIN else (a, b)  # standard input can be opened once only
    second_names, first_names, opened = _names(second), list[str](), list[OpenTable]()
    others = set(second_names)
    own = RecognizedResultTable.of(second_names)
    keys = {TIME, *_named_keys(options), *(own.keys if own else ())}

    def is_late(name: str) -> bool:
        """Returns whether a key that the first row of JSON Lines lacks belongs to the comparison, which then fails."""
        return not options.common and _is_chosen(name, options)

    def is_common(name: str) -> bool:
        if opened:
            return is_late(name)
        first_names.append(name)
        return name in others and (name in keys or _is_chosen(name, options))

    def is_shared(name: str) -> bool:
        return name in opened[0].names if name in others else is_late(name)

    opened.append(stack.enter_context(open_table(first, is_common, exact=True)))
    opened.append(stack.enter_context(open_table(second, is_shared, exact=True)))
    both = [*zip(opened, (first_names, second_names), strict=True)]
    return both[::-1] if b == STDIN else both


def _names(path: str) -> list[str]:
    """Returns the names of all columns of a file."""
    names: list[str] = []

    def collect(name: str) -> bool:
        names.append(name)
        return False

    open_table(path, collect).close()
    return names


def _is_chosen(name: str, options: TableDiffOptions) -> bool:
    return not options.columns or any(matches(name, pattern) for pattern in options.columns)


def _named_keys(options: TableDiffOptions) -> list[str]:
    """Returns the columns that the option `align` names."""
    return [] if options.align in (None, *ALIGNMENTS) else [name.strip() for name in options.align.split(",")]


def _key(
    names_a: Sequence[str],
    names_b: Sequence[str],
    manifests: Sequence[Mapping[str, Any] | None],
    options: TableDiffOptions,
) -> tuple[str | Sequence[str] | None, Collection[str]]:
    """Returns the columns by which rows are matched, and the columns that are not compared then."""
    both = [name for name in names_a if name in names_b]
    if named := _named_keys(options):
        for name in named:
            if name not in both:
                with concerning("align"):
                    raise UnknownNameError("column", name, both, where="both tables")
        return named, ()
    if options.align == TIME and TIME not in both:
        raise UsageError(f"{option('align')} time requires a column 'time' in both tables")
    if options.align == ROW:
        return None, ()
    if TIME in both:
        return TIME, ()
    results = [RecognizedResultTable.of(names) for names in (names_a, names_b)]
    one, other = results
    if one and other and one.kind == other.kind:
        return one.common_key(other, manifests)
    return None, ()


def _nothing_in_common(names: Mapping[str, Sequence[str]], options: TableDiffOptions) -> str:
    which = f" selected by {option('columns')}" if options.columns else ""
    exception = " except time" if all(TIME in each for each in names.values()) else ""
    lists = [f"{clean(path)}: {listing(each) or 'none'}" for path, each in names.items()]
    return "\n".join([f"the tables have no columns{which} in common{exception}", *lists])


class _RecordedRows:
    """The states of a recording as rows, after a column with their steps."""

    def __init__(self, recording: RecordingReader, names: Sequence[str]) -> None:
        self.path: Path = recording.path
        self.names = [STEP, *names]
        self.units: Mapping[str, str] = {}
        self._recording = recording

    def blocks(self) -> Iterator[np.ndarray]:
        """Yields blocks of float64 `(n, 1 + size)`."""
        for steps, states in self._recording.blocks():
            yield np.column_stack([steps, states])


def compare_recordings(
    a: str, b: str, options: TableDiffOptions, model: mujoco.MjModel | None = None
) -> tuple[TableDifference | None, list[str], list[str]]:
    """Compares the states of the same steps.

    Args:
      model: the model whose joints name the numbers of a state; without it, they have their index in their field:
        `qpos/3`.

    Returns:
      The differences of the states, None if their sizes differ; other differences; and possible reasons, in sentences.

    Raises:
      FileError: a file is not a complete recording.
      UnknownNameError: a wildcard matches no number of the state.
      UsageError: an option does not apply to recordings, or they do not belong to `model`.
    """
    with ExitStack() as stack:
        one, other = (stack.enter_context(RecordingReader(path)) for path in (a, b))
        notes = provenance_notes(one.facts, other.facts)
        if differences := _layout_differences(one, other, clean(a), clean(b)):
            return None, differences, notes

        names = _state_names(one, model)
        require_matches("columns", options.columns, names)
        chosen = [n for n in names if not options.columns or any(matches(n, pattern) for pattern in options.columns)]
        tolerances = Tolerances(Tolerance(options.atol, options.rtol), options.tol)
        tolerances.require(chosen)
        rows = _RecordedRows(one, names), _RecordedRows(other, names)
        return compare_rows(*rows, chosen, STEP, tolerances, chosen, chosen), [], notes


def _state_names(recording: RecordingReader, model: mujoco.MjModel | None) -> list[str]:
    """Returns the names of the numbers of a state."""
    if model is not None:
        with concerning("model"):
            require_model(model, recording, recording.facts)
        return state_columns(model)

    sizes = recorded_sizes(recording.facts)
    names = [
        "time" if field == "time" else f"{field}/{i}"
        for field, part in (state.fields(sizes) if sizes else {}).items()
        for i in range(part.stop - part.start)
    ]
    return names if len(names) == recording.size else [f"state/{i}" for i in range(recording.size)]


def recorded_sizes(facts: Mapping[str, Any]) -> dict[str, int]:
    """Returns the sizes of the recorded model; empty unless the untrusted recording has all of them."""
    sizes = manifest_part(facts, "sizes")
    if not all(type(sizes.get(name)) is int for name in state.SIZES):
        return {}
    return {name: sizes[name] for name in state.SIZES}


def _layout_differences(one: RecordingReader, other: RecordingReader, a: str, b: str) -> list[str]:
    """Returns a sentence for each difference in the layouts of the states of two models."""
    first, second = recorded_sizes(one.facts), recorded_sizes(other.facts)
    pairs = [(name, first[name], second[name]) for name in first if second]
    differing = [f"{name} is {x} in {a}, {y} in {b}" for name, x, y in pairs if x != y]
    if not differing and one.size != other.size:
        differing = [f"a state has {one.size} numbers in {a}, {other.size} in {b}"]
    if not differing and (moved := moved_name(one.facts, other.facts)):
        kind, name, there, here = moved
        differing = [f"{kind} {quoted(name)} is number {there} in {a}, {here} in {b}"]
    return differing


class GoldenComparison:
    """The comparison of a golden table with rows that are still to come.

    The golden table is opened at once, and read while rows come, in a thread that ends with `finish` or `close`.

    Args:
      path: the path of the golden table.
      columns: the columns of the measured rows.
      tolerances: the tolerances within which numbers agree.
      replacement: the manifest of the rows if they are to replace the golden table.

    Attributes:
      manifest: the manifest of the golden table, in it or next to it, or None.

    Raises:
      FileError: the golden table cannot be read.
      UsageError: it has no column except time in common with the rows, or a tolerance applies to none of them.
      UnrelatedTableError: it has no such column and no manifest, or is to be replaced by rows of another model.
    """

    def __init__(
        self,
        path: str,
        columns: Sequence[Column],
        tolerances: Tolerances,
        replacement: Mapping[str, Any] | None = None,
    ) -> None:
        golden_names: list[str] = []
        names = {*(column.name for column in columns), *(clean(column.name) for column in columns)}

        def is_common(name: str) -> bool:
            golden_names.append(name)
            return name in names

        self._table = open_table(path, is_common, exact=True)
        try:
            self.manifest = self._table.manifest or read_sidecar(Path(path))
            if replacement and (other := other_model(self.manifest or {}, replacement)):
                raise UnrelatedTableError(f"the golden table {clean(path)} was made from another model: {other}")
            self._rows = _ComingRows(columns, golden_names)
            self._names = golden_names, list(self._rows.names)
            self._key = TIME if TIME in golden_names else None
            self._columns = [name for name in self._rows.names if name in golden_names and name != self._key]
            if not self._columns:
                kind = UsageError if self.manifest else UnrelatedTableError
                raise kind(_nothing_measured(path, *self._names))
            tolerances.require([*self._columns, *([self._key] if self._key else [])])
        except BaseException:
            self._table.close()
            raise

        self._tolerances = tolerances
        self._result: TableDifference | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._compare, name="golden table")
        self._thread.start()

    def add(self, block: np.ndarray) -> None:
        """Adds rows, float64 `(n, columns)`, which may be changed afterwards.

        Raises:
          FileError: the golden table cannot be read further.
        """
        self._raise_failure()
        self._rows.add(np.array(block))

    def finish(self) -> TableDifference:
        """Returns the differences between the golden table, `a`, and all rows, `b`.

        Raises:
          FileError: the golden table cannot be read to its end.
        """
        self._end(completely=True)
        self._raise_failure()
        assert self._result
        return self._result

    def close(self) -> None:
        """Cancels the comparison, unless it is finished."""
        self._end(completely=False)

    def _end(self, *, completely: bool) -> None:
        if self._thread.is_alive():
            self._rows.end(completely=completely)
        self._thread.join()
        self._table.close()

    def _compare(self) -> None:
        try:
            self._result = compare_rows(
                self._table, self._rows, self._columns, self._key, self._tolerances, *self._names
            )
            self._table.require_unchanged()
        except BaseException as failure:  # handed to the thread that adds rows
            self._failure = failure
        self._rows.drain()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure


class _GivenUpError(Exception):
    """The comparison was cancelled: no more rows come, and the result is unused."""


class _ComingRows:
    """Rows that one thread adds and another reads; the last item of the queue is whether the rows are complete."""

    path = Path("the simulation")

    def __init__(self, columns: Sequence[Column], golden_names: Sequence[str]) -> None:
        # .csv contains cleaned names.
        self.names = [c.name if c.name in golden_names else clean(c.name) for c in columns]
        self.units: Mapping[str, str] = {n: c.unit for n, c in zip(self.names, columns, strict=True)}
        self._queue: queue.Queue[np.ndarray | bool] = queue.Queue(QUEUED_BLOCKS)
        self._is_ended = False

    def add(self, block: np.ndarray) -> None:
        if len(block):
            self._queue.put(block)

    def end(self, *, completely: bool) -> None:
        self._queue.put(completely)

    def blocks(self) -> Iterator[np.ndarray]:
        while not isinstance(block := self._queue.get(), bool):
            yield block
        self._is_ended = True
        if not block:
            raise _GivenUpError

    def drain(self) -> None:
        """Discards the remaining rows, so that adding never blocks."""
        while not self._is_ended:
            self._is_ended = isinstance(self._queue.get(), bool)


def _nothing_measured(path: str, golden: Sequence[str], measured: Sequence[str]) -> str:
    lists = [f"{clean(path)}: {listing(golden) or 'none'}", f"measured: {listing(measured)}"]
    fault = f"the golden table {clean(path)} and the measured columns have nothing except time in common"
    return "\n".join([fault, *lists])
