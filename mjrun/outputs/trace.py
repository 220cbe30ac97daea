"""Trace output: named, aligned, exact values of a simulation, one row per instant."""

import queue
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UnrelatedTableError, UsageError, clean, concerning, listing, option
from mjrun.formats.input_file import exists
from mjrun.formats.manifest import TableManifestWriter, sidecar_path
from mjrun.formats.output_writer import OutputWriter
from mjrun.formats.table_writer import TableWriter, metadata_path
from mjrun.formats.tables import FORMATS, input_format, output_format
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.table_column import Column
from mjrun.options.option import options
from mjrun.options.trace import COMMENT, METADATA, GoldenOptions, TraceOptions
from mjrun.outputs import output
from mjrun.outputs.output import named_files
from mjrun.outputs.trace_rows import TIME, ProbeSampler, RowBuffer, SampledRows, rate_warning
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import PhysicsStepper, Stepper
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.select import available_columns, select, selected_columns
from mjrun.probe.verdict import Verdict
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult
    from mjrun.diff.table_files import GoldenComparison
    from mjrun.probe.assertion import Assertion

QUEUED_BLOCKS = 4  # blocks that may wait to be written
STATED = ("mjrun", "mujoco")  # facts of the origin that a verdict always states
LISTED = 10  # maximum number of differences in a message


@options
class Trace(TraceOptions, output.OutputRequest["TraceResult"]):
    """A trace of a simulation, a table of measured values: its options are keywords.

    Args:
      written: whether the table is written; one that is only compared with a golden table need not be.
      rows_to: a function called with the columns, which returns one to call with each block of rows, `(n, columns)`.
    """

    written: bool = True
    rows_to: Callable[[Sequence[Column]], Callable[[np.ndarray], object]] | None = None

    @property
    def files(self) -> list[tuple[str, str]]:
        output = self.output if self.written else None
        files = named_files(output=output, contacts=self.contacts, manifest=self.manifest)
        tables = self._csv_tables() if self.units == METADATA else []
        beside = [("units", str(metadata_path(Path(table)))) for table in tables if table]
        return [*files, *beside, *(("golden", file) for file in golden_files(self))]

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """The golden table, if it is only read."""
        return [] if self.update or self.golden is None else [("golden table", self.golden)]

    @property
    def keeps_partial(self) -> bool:
        return self.keep_partial

    @property
    def target(self) -> str | None:
        """The output path; None for standard output."""
        return None if self.output == "-" else self.output

    def check(self) -> None:
        """Checks all formats.

        Raises:
          UsageError: a suffix or format is unknown.
        """
        if self.golden is not None:
            with concerning("golden"):
                input_format(Path(self.golden))
        output_format(self.target, self.format)
        if self.contacts is not None:
            with concerning("contacts"):
                output_format(self.contacts)
        tables = self._csv_tables()
        if self.units and not tables:
            formats = listing([known.suffixes[0] for known in FORMATS.values() if not known.is_text])
            raise UsageError(f"{option('units')} applies only to .csv tables\n{formats} files hold units themselves")
        if self.units == METADATA and None in tables:
            raise UsageError(
                f"{option('units')} {METADATA} needs a file next to which the units are written\n"
                f"{option('units')} {COMMENT} writes them into the table"
            )

    def _csv_tables(self) -> list[str | None]:
        """Returns the tables in a format whose units may be beside it; None is standard output."""
        formats = {self.target: output_format(self.target, self.format)} if self.written else {}
        if self.contacts is not None:
            formats[self.contacts] = output_format(self.contacts)
        return [table for table, form in formats.items() if form.commented]

    def plan(self, context: output.PassContext) -> "output.OutputPlan[TraceResult]":
        """Resolves the probes in the model and parses the assertions."""
        require_golden_table(self)
        steps = row_steps(context.timeline, self.every, self.rate)
        for index, name in enumerate(self.probe):
            with concerning("probe", index):  # one by one, so that an error names the probe
                select(context.model, [name], context.episode)
        table = ProbeSampler(context.model, self.probe, context.timeline, context.episode, self.contacts is not None)
        if text := rate_warning(context.timeline, self.rate):
            context.reporter.warn(text)
        assertions = _assertions(self.assert_, table, context.episode)

        count, path = len(table.columns), self.output if self.written else self.golden or "memory"
        about = f"{output_format(self.target, self.format).name}, {count} columns"
        preview = output.OutputPreview("trace", path, len(steps), "rows", [count], about)
        return output.OutputPlan(
            preview=preview,
            until=context.timeline.steps,
            open=lambda stack, _: OpenTrace(self, context, table, steps, assertions, stack),
            enable_flags=table.model.opt.enableflags,
        )


@dataclass(frozen=True)
class TraceResult(output.OutputResult):
    """The result of a trace output.

    Attributes:
      path: path of the table; `-` is standard output; empty if the table is not written.
      format: name of the format.
      rows, columns: the numbers of its rows and columns.
      contacts: rows of the contact table, or None.
      simulated, steps: simulated time [s] and steps taken.
      assertions: each assertion with its value and verdict.
      golden: the comparison with the golden table, or None.
    """

    format: str
    rows: int
    columns: int
    contacts: int | None
    simulated: float
    steps: int
    assertions: Sequence[Verdict]
    golden: "DiffResult | None" = None


def columns(simulation: Simulation, probes: Sequence[str] = ()) -> list[Column]:
    """Returns every column that `simulation` offers, or those of `probes`; `time` first."""
    with collected_warnings():
        model, episode = simulation.load(), simulation.episode.columns if simulation.episode else None
        return [TIME, *(selected_columns(model, probes, episode) if probes else available_columns(model, episode))]


class OpenTrace(output.OpenBlockOutput[TraceResult]):
    """A trace with open files.

    Args:
      table: its columns.
      steps: the steps of its rows.
    """

    def __init__(
        self,
        request: Trace,
        context: output.PassContext,
        table: ProbeSampler,
        steps: Sequence[int],
        assertions: "Sequence[Assertion]",
        stack: ExitStack,
    ) -> None:
        self._request, self._context, self._table, self._steps = request, context, table, steps
        self._facts = context.facts(request)
        self._format = output_format(request.target, request.format).name
        self._writer = self._contacts = self._golden = None
        if request.written:
            self._writer = stack.enter_context(
                TableWriter(request.target, self._format, table.columns, self._facts, request.units)
            )
        if request.contacts is not None:
            form = output_format(request.contacts).name
            self._contacts = stack.enter_context(
                TableWriter(request.contacts, form, table.contact_columns, self._facts, request.units)
            )
        if request.golden is not None:
            self._golden = _OpenGoldenTable(request, table.columns, self._facts, stack)
        self._rows_to = request.rows_to(table.columns) if request.rows_to else None
        self._checkers = [assertion.checker() for assertion in assertions]
        self._buffer = RowBuffer(table, steps, self._write)
        self.taps = [Tap(steps, self._buffer.record)]
        self._rows = 0

    def simulate(self, stepper: Stepper, until: int) -> None:
        """Steps physics in C, block by block, and writes blocks in a thread meanwhile."""
        if isinstance(stepper, PhysicsStepper):
            _stream(self._table.blocks(stepper, self._steps), self._write)
            stepper.advance(until)
        else:
            run_with_taps(stepper, self.taps, until)

    def finish(self, simulation_wall: float) -> output.FinishedOutput[TraceResult]:
        self._buffer.flush()
        writers: list[OutputWriter] = [writer for writer in (self._writer, self._contacts) if writer]
        for writer in writers:
            writer.finish()
        verdicts = [checker.verdict() for checker in self._checkers]
        failed = [verdict.message for verdict in verdicts if not verdict.passed]
        comparison, differences = None, list[str]()
        if self._golden:
            complete = self._rows == len(self._steps) and not failed
            source = self._context.simulation.source.text or "the simulation"
            comparison, replaced = self._golden.finish(source, replace=complete)
            writers += replaced
            if not (comparison.equal or self._request.update):
                differences.append(difference_message(comparison))

        timeline = self._context.timeline
        result = TraceResult(
            path=self._request.output if self._request.written else "",
            format=self._format,
            rows=self._rows,
            columns=len(self._table.columns),
            contacts=self._contacts.rows if self._contacts else None,
            simulated=float(timeline.time(timeline.steps)),
            steps=timeline.steps,
            assertions=verdicts,
            golden=comparison,
        )
        units = {clean(column.name): column.unit for column in self._table.columns}
        return output.FinishedOutput(result, writers, self._facts, failed, differences, units)

    def _write(self, rows: SampledRows) -> None:
        for checker in self._checkers:
            checker.feed(rows.values, self._rows)
        if self._writer:
            self._writer.write(rows.values)
        if self._golden:
            self._golden.write(rows.values)
        if self._rows_to:
            self._rows_to(rows.values)
        self._rows += len(rows.values)
        if self._contacts and rows.contacts is not None:
            self._contacts.write(rows.contacts)


def _stream(parts: Iterator[Callable[[], SampledRows]], write: Callable[[SampledRows], object]) -> None:
    """Computes and writes blocks in a thread while C code simulates the next ones."""
    waiting: queue.Queue[Callable[[], SampledRows] | None] = queue.Queue(QUEUED_BLOCKS)
    failures: list[BaseException] = []

    def work() -> None:
        while (part := waiting.get()) is not None:
            if failures:
                continue  # keeps the queue moving, so that the simulation never blocks
            try:
                write(part())
            except BaseException as failure:  # handed to the thread that waits
                failures.append(failure)

    writer = threading.Thread(target=work, name="table writer")
    writer.start()
    try:
        for part in parts:
            if failures:
                break
            waiting.put(part)
    finally:
        waiting.put(None)
        writer.join()
        if failures:  # even if the simulation has failed too: the rows written are incomplete
            raise failures[0]


def _assertions(texts: Sequence[str], table: ProbeSampler, episode: EpisodeColumns | None) -> "list[Assertion]":
    """Parses the assertions about a table; without any, their parser is not imported."""
    if not texts:
        return []
    from mjrun.probe.assertion import parse_all
    from mjrun.probe.vocabularies import TraceVocabulary

    available = TraceVocabulary(
        [column.name for column in table.columns], table.model, episode.names if episode else ()
    )
    return parse_all(texts, available)


def row_steps(timeline: Timeline, every: int, rate: Fraction | None) -> Sequence[int]:
    """Returns the steps to measure: every N-th, or a number per simulated second."""
    if rate is None:
        return timeline.rows(every=every)
    return timeline.rows(rate=rate)


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


class _OpenGoldenTable:
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
                self._writers.append(stack.enter_context(TableManifestWriter(self._table, beside, facts)))

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
        from mjrun.diff.result import DiffResult, GoldenVersions
        from mjrun.diff.sentences import provenance_notes, table_sentences

        table = self._comparison.finish() if self._comparison else None
        differences = [self._obstacle] if self._obstacle else []
        differences += table_sentences(table, clean(self._path), clean(source)) if table else []
        manifest = self._comparison.manifest if self._comparison else None
        writers = self._writers if replace else []
        for writer in writers:
            writer.finish()
        versions = [str((each or {}).get(key) or "") for each in (manifest, self._facts) for key in STATED]
        facts = GoldenVersions(*versions, updated=bool(writers))
        notes = provenance_notes(_rest(manifest or {}), _rest(self._facts))
        equal = not differences
        return DiffResult("golden", self._path, source, equal, differences, notes, table, golden=facts), writers

    def _compare(self, options: GoldenOptions, columns: Sequence[Column], stack: ExitStack) -> None:
        from mjrun.diff.table_files import GoldenComparison
        from mjrun.diff.tolerances import Tolerance, Tolerances

        tolerances = Tolerances(Tolerance(options.atol, options.rtol), options.tol)
        try:
            replacement = self._facts if self._update else None
            self._comparison = GoldenComparison(self._path, columns, tolerances, replacement)
        except (FileError, UsageError) as error:
            if self._update and isinstance(error, UnrelatedTableError):
                error.add_note(f"{option('update')} does not replace it: remove it, or give another file")
                raise
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
