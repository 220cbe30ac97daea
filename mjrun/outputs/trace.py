"""A trace: named, aligned, exact numbers of a simulation, one row per instant."""

import queue
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.errors import concerning
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.column import Column
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.options.option import options
from mjrun.options.trace import TraceOptions
from mjrun.outputs.golden import GoldenTable, check_options, difference_message, golden_files, require_golden_table
from mjrun.outputs.output_files import named_files
from mjrun.outputs.shared_rendering import SharedRendering
from mjrun.outputs.task import Artifact, Context, Job, Output, OutputResult, PassSummary, Preview
from mjrun.outputs.trace_rows import TIME, ProbeSampler, RowBuffer, Rows, rate_warning
from mjrun.physics.observe import Tap
from mjrun.physics.stepper import PhysicsStepper, Stepper
from mjrun.probe.episode import EpisodeColumns
from mjrun.probe.select import available_columns, select, selected_columns
from mjrun.probe.verdict import Verdict
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult
    from mjrun.probe.assertion import Assertion

QUEUED_BLOCKS = 4  # that may wait to be written


@options
class Trace(TraceOptions, Job["TraceResult"]):
    """A trace of a simulation, a table of measured values: its options are keywords.

    Args:
      written: whether the table is written; one that is only compared with a golden table need not be.
    """

    written: bool = True

    @property
    def files(self) -> list[tuple[str, str]]:
        output = self.output if self.written else None
        files = named_files(output=output, contacts=self.contacts, manifest=self.manifest)
        return [*files, *(("golden", file) for file in golden_files(self))]

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """The golden table, if it is only read."""
        return [] if self.update else named_files(golden=self.golden)

    def task(self) -> "TraceTask":
        """Its task, with every format chosen.

        Raises:
          UsageError: a suffix or format that is not known.
        """
        check_options(self)
        target = None if self.output == "-" else self.output
        contacts = None if self.contacts is None else output_format(self.contacts).name
        return TraceTask(self, target, output_format(target, self.format).name, contacts)


@dataclass(frozen=True)
class TraceResult(OutputResult):
    """What table was made.

    Attributes:
      path: where it is; `-` is standard output, and empty a table that is not written.
      format: how it is written.
      rows, columns: its size, `time` included.
      contacts: rows of the contact table; None without one.
      simulated, steps: simulated time [s] and steps taken.
      wall: wall time of all [s].
      assertions: each with the value that it has, and whether it holds.
      warnings: MuJoCo's.
      golden: the comparison with the golden table; None without one.
    """

    format: str
    rows: int
    columns: int
    contacts: int | None
    simulated: float
    steps: int
    wall: float
    assertions: Sequence[Verdict]
    warnings: Sequence[str]
    golden: "DiffResult | None" = None


def columns(simulation: Simulation, probes: Sequence[str] = ()) -> list[Column]:
    """Every column that `simulation` offers, or those of `probes`; `time` first."""
    with collected_warnings():
        model, episode = simulation.load(), simulation.episode.columns if simulation.episode else None
        return [TIME, *(selected_columns(model, probes, episode) if probes else available_columns(model, episode))]


@dataclass(frozen=True)
class TraceTask:
    """A trace, with every format chosen.

    Attributes:
      target: the output; None for standard output.
      contacts_format: of the table of contacts, if there is one.
    """

    job: Trace
    target: str | None
    format: str
    contacts_format: str | None

    renderer = None

    def plan(self, context: Context) -> "TracePlan":
        """Finds the probes in the model and parses the assertions."""
        job = self.job
        require_golden_table(job)
        steps = row_steps(context.timeline, job.every, job.rate)
        for index, name in enumerate(job.probe):
            with concerning("probe", index):  # one by one, so that an error says which
                select(context.model, [name], context.episode)
        table = ProbeSampler(context.model, job.probe, context.timeline, context.episode, job.contacts is not None)
        if text := rate_warning(context.timeline, job.rate):
            context.reporter.warn(text)
        return TracePlan(self, context, steps, table, _assertions(job.assert_, table, context.episode))


@dataclass(frozen=True)
class TracePlan:
    """A trace of a model; `steps` are those of its rows."""

    task: TraceTask
    context: Context
    steps: Sequence[int]
    table: ProbeSampler
    assertions: "Sequence[Assertion]"

    @property
    def keep_partial(self) -> bool:
        return self.task.job.keep_partial

    @property
    def enable_flags(self) -> int:
        return self.table.model.opt.enableflags

    @property
    def until(self) -> int:
        return self.context.timeline.steps

    def preview(self) -> Preview:
        count = len(self.table.columns)
        about = f"{self.task.format}, {count} columns"
        path = self.task.job.output if self.task.job.written else str(self.task.job.golden)
        return Preview("trace", path, len(self.steps), "rows", [count], about)

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "TraceOutput":
        task, job, context, table = self.task, self.task.job, self.context, self.table
        facts = origin(job, job.simulation, context.model, context.timeline)
        writer = TableWriter(task.target, task.format, table.columns, facts) if job.written else None
        if writer is not None:
            stack.enter_context(writer)
        contacts = None
        if task.contacts_format is not None:
            contacts = TableWriter(job.contacts, task.contacts_format, table.contact_columns, facts)
            stack.enter_context(contacts)
        golden = None if job.golden is None else GoldenTable(job, table.columns, facts, stack)
        return TraceOutput(self, facts, writer, contacts, golden)


class TraceOutput(Output[TraceResult]):
    """A trace whose files are open."""

    def __init__(
        self,
        plan: TracePlan,
        facts: Mapping[str, object],
        writer: TableWriter | None,
        contacts: TableWriter | None,
        golden: GoldenTable | None,
    ) -> None:
        self._plan, self._facts, self._writer, self._contacts, self._golden = plan, facts, writer, contacts, golden
        self._rows = 0
        self._checkers = [assertion.checker() for assertion in plan.assertions]
        self._buffer = RowBuffer(plan.table, plan.steps, self._write)
        self.taps = [Tap(plan.steps, plan.table.read, self._buffer.add)]

    def simulate(self, stepper: Stepper, until: int) -> None:
        """Physics alone is stepped in C, block by block, and written in a thread meanwhile."""
        if isinstance(stepper, PhysicsStepper):
            _stream(self._plan.table.blocks(stepper, self._plan.steps), self._write)
        else:
            super().simulate(stepper, until)

    def finish(self) -> Artifact[TraceResult]:
        self._buffer.flush()
        writers: list[OutputWriter] = [writer for writer in (self._writer, self._contacts) if writer]
        for writer in writers:
            writer.finish()
        verdicts = [checker.verdict() for checker in self._checkers]
        failed = [verdict.message for verdict in verdicts if not verdict.passed]
        if self._golden is None:
            return Artifact(self._facts, writers, partial(self._result, verdicts, None), failed)

        complete = self._rows == len(self._plan.steps)
        source = self._plan.context.simulation.source.text or "the simulation"
        golden, replaced = self._golden.finish(source, replace=complete and not failed)
        differences = [] if golden.equal or self._plan.task.job.update else [difference_message(golden)]
        result = partial(self._result, verdicts, golden)
        return Artifact(self._facts, [*writers, *replaced], result, failed, differences)

    def _write(self, rows: Rows) -> None:
        for checker in self._checkers:
            checker.feed(rows.values, self._rows)
        if self._writer:
            self._writer.write(rows.values)
        if self._golden:
            self._golden.write(rows.values)
        self._rows += len(rows.values)
        if self._contacts and rows.contacts is not None:
            self._contacts.write(rows.contacts)

    def _result(
        self, assertions: Sequence[Verdict], golden: "DiffResult | None", files: Sequence[Path], summary: PassSummary
    ) -> TraceResult:
        task, timeline = self._plan.task, self._plan.context.timeline
        return TraceResult(
            path=task.job.output if task.job.written else "",
            format=task.format,
            rows=self._rows,
            columns=len(self._plan.table.columns),
            contacts=self._contacts.rows if self._contacts else None,
            simulated=float(timeline.duration),
            steps=timeline.steps,
            wall=summary.wall,
            assertions=assertions,
            golden=golden,
            warnings=summary.warnings,
        )


def _stream(parts: Iterator[Callable[[], Rows]], write: Callable[[Rows], object]) -> None:
    """Computes and writes blocks in a thread, while the next ones are simulated in C."""
    waiting: queue.Queue[Callable[[], Rows] | None] = queue.Queue(QUEUED_BLOCKS)
    failures: list[BaseException] = []

    def work() -> None:
        while (part := waiting.get()) is not None:
            if failures:
                continue  # keep taking, so that the simulation never blocks
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
        if failures:  # even if the simulation has failed too: what is written is not the rows up to there
            raise failures[0]


def _assertions(texts: Sequence[str], table: ProbeSampler, episode: EpisodeColumns | None) -> "list[Assertion]":
    """The assertions about a table; without any, nothing of their language is imported."""
    if not texts:
        return []
    from mjrun.probe.assertion import parse
    from mjrun.probe.available import SelectedProbes

    available = SelectedProbes([column.name for column in table.columns], table.model, episode.names if episode else ())
    assertions: list[Assertion] = []
    for index, text in enumerate(texts):
        with concerning("assert", index):
            assertions.append(parse(text, available))
    return assertions


def row_steps(timeline: Timeline, every: int, rate: Fraction | None) -> Sequence[int]:
    """The steps that are measured: every so many, or so many per simulated second."""
    if rate is None:
        return timeline.rows(every=every)
    return timeline.rows(rate=rate)
