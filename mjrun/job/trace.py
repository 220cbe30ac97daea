"""A trace: named, aligned, exact numbers of a simulation, one row per instant."""

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction

from mjrun.errors import UsageError
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.job.manifest import origin
from mjrun.job.output_files import named
from mjrun.job.perform import Artifact, Context, Preview, Work, perform
from mjrun.job.simulation import Simulation, lone, positive
from mjrun.job.trace_rows import TIME, RowBuffer, Rows, Table, repeated
from mjrun.model.column import Column
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.probe.assertion import Verdict, parse
from mjrun.probe.available import SelectedProbes
from mjrun.probe.select import DEFAULT, catalogue, chosen
from mjrun.reporter import Reporter
from mjrun.sim.observe import Tap
from mjrun.sim.stepper import PhysicsStepper, Stepper
from mjrun.timeline import Timeline

AHEAD = 4  # blocks that may wait to be written


@dataclass(frozen=True)
class Trace:
    """What to measure.

    Args:
      simulation: what happens.
      output: a file (.csv .jsonl .parquet .feather .npz .mat), or `-` for stdout.
      format: instead of the output's suffix.
      probes: names such as `qpos`, `qpos[left_*]`, `xpos/hand/z`.
      every: steps between rows.
      rate: rows per simulated second [Hz], instead of `every`.
      asserts: expressions that must hold, `max(abs(energy/drift)) < 1e-3`.
      keep_partial: keep the rows before an instability.
      contacts: a file for the long table of contacts, a row for each contact of each instant.
      manifest: a file for what made the trace.
      command: the command line, for the manifest.
    """

    simulation: Simulation
    output: str = "-"
    format: str | None = None
    probes: Sequence[str] = DEFAULT
    every: int = 1
    rate: float | str | Fraction | None = None
    asserts: Sequence[str] = ()
    keep_partial: bool = False
    contacts: str | None = None
    manifest: str | None = None
    command: str = ""

    def __post_init__(self) -> None:
        lone(self, "probes", "asserts")

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return named(self, "output", "contacts", "manifest")

    def run(self, reporter: Reporter | None = None) -> "TraceResult":
        """Makes the trace. What can fail early fails before the first step.

        Raises:
          FailedAssertionError: an assertion does not hold; the table is published all the same.
          MjrunError: nothing was published, unless `keep_partial`, and an existing output is untouched.
        """
        return perform([self], reporter)[0]

    def work(self, stack: ExitStack) -> "TraceWork":
        """The work that makes it."""
        return TraceWork(self, stack)


@dataclass(frozen=True)
class TraceResult:
    """What table was made.

    Attributes:
      path: where it is; `-` is standard output.
      format: how it is written.
      rows, columns: its size, `time` included.
      contacts: rows of the contact table; None without one.
      simulated, steps: simulated time [s] and steps taken.
      wall: wall time of all [s].
      assertions: each with what it found, and whether it holds.
      warnings: what MuJoCo warned of.
    """

    path: str
    format: str
    rows: int
    columns: int
    contacts: int | None
    simulated: float
    steps: int
    wall: float
    assertions: Sequence[Verdict]
    warnings: Sequence[str]


def columns(simulation: Simulation, probes: Sequence[str] = ()) -> list[Column]:
    """Every column that the model of `simulation` offers, or those of `probes`; `time` first."""
    with collected_warnings():
        model = simulation.load()
        return [TIME, *(chosen(model, probes) if probes else catalogue(model))]


class TraceWork(Work):
    """A trace in the making."""

    def __init__(self, job: Trace, stack: ExitStack) -> None:
        self._job = job
        self._target = None if job.output == "-" else job.output
        self._format = output_format(self._target, job.format).name
        self._contacts_format = None if job.contacts is None else output_format(job.contacts).name
        self.keeps_partial = job.keep_partial

    def plan(self, ground: Context) -> None:
        job = self._job
        self._ground, self.until = ground, ground.timeline.steps
        self._rows = rows(ground.timeline, job.every, job.rate)
        self._table = Table(ground.model, job.probes, ground.timeline, with_contacts=job.contacts is not None)
        self.model = self._table.model
        if text := repeated(ground.timeline, job.rate):
            ground.reporter.warn(text)
        names = [column.name for column in self._table.columns]
        self._checkers = [parse(text, SelectedProbes(names, self.model)).checker() for text in job.asserts]

    def open(self, stack: ExitStack) -> None:
        job, ground, table = self._job, self._ground, self._table
        self._facts = origin(job, job.simulation, ground.model, ground.timeline)
        self._sink = stack.enter_context(TableWriter(self._target, self._format, table.columns, self._facts))
        self._contacts = None
        if self._contacts_format is not None:
            sink = TableWriter(job.contacts, self._contacts_format, table.contact_columns, self._facts)
            self._contacts = stack.enter_context(sink)
        self._waiting = RowBuffer(table, self._rows, self._write)

    def taps(self) -> Sequence[Tap]:
        """A row at each of its instants."""
        return [Tap(self._rows, self._table.read, self._waiting.add)]

    def drive(self, stepper: Stepper) -> None:
        """Physics alone is stepped in C, block by block, and written in a thread meanwhile."""
        if not isinstance(stepper, PhysicsStepper):
            super().drive(stepper)
            return
        _stream(self._table.blocks(stepper, self._rows), self._write)

    def outline(self) -> Preview:
        about = f"{self._format}, {len(self._table.columns)} columns"
        return Preview("trace", self._job.output, len(self._rows), "rows", [len(self._table.columns)], about)

    def finish(self, wall: float) -> Artifact:
        self._waiting.flush()
        files = [*self._sink.publish(), *(self._contacts.publish() if self._contacts else [])]
        verdicts = [checker.verdict() for checker in self._checkers]
        failed = [verdict.message for verdict in verdicts if not verdict.passed]
        return Artifact(self._facts, files, lambda total, heard: self._result(verdicts, total, heard), failed)

    def _write(self, rows: Rows) -> None:
        for checker in self._checkers:
            checker.feed(rows.values, self._sink.rows)
        self._sink.write(rows.values)
        if self._contacts and rows.contacts is not None:
            self._contacts.write(rows.contacts)

    def _result(self, assertions: Sequence[Verdict], wall: float, heard: Sequence[str]) -> TraceResult:
        return TraceResult(
            path=self._job.output,
            format=self._format,
            rows=self._sink.rows,
            columns=len(self._table.columns),
            contacts=self._contacts.rows if self._contacts else None,
            simulated=float(self._ground.timeline.duration),
            steps=self._ground.timeline.steps,
            wall=wall,
            assertions=assertions,
            warnings=heard,
        )


def _stream(parts: Iterator[Callable[[], Rows]], write: Callable[[Rows], object]) -> None:
    """Computes and writes blocks in a thread, while the next ones are simulated in C."""
    waiting: queue.Queue[Callable[[], Rows] | None] = queue.Queue(AHEAD)
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
    if failures:
        raise failures[0]


def rows(timeline: Timeline, every: int, rate: float | str | Fraction | None) -> Sequence[int]:
    """The steps that are measured: every so many, or so many per simulated second."""
    if rate is not None and every != 1:
        raise UsageError("--every and --rate exclude each other: both say how often")
    if rate is None:
        return timeline.rows(every=every)
    return timeline.rows(rate=positive("--rate", rate))
