"""A trace: named, aligned, exact numbers of a simulation, one row per instant."""

import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from mjrun.errors import FailedAssertionError, SimulationError, UsageError, clean
from mjrun.export.manifest import ManifestWriter
from mjrun.export.table import TableWriter, table_format
from mjrun.job.manifest import origin
from mjrun.job.report import QuietReporter, Reporter, pass_on
from mjrun.job.simulation import Simulation, positive
from mjrun.job.table import TIME, Rows, Table
from mjrun.model.column import Column
from mjrun.model.native import collected_warnings, without_timers
from mjrun.probe.assertion import Checker, parse
from mjrun.probe.select import DEFAULT, catalogue
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

    def run(self, reporter: Reporter | None = None) -> "TraceResult":
        """Makes the trace. What can fail early fails before the first step.

        Raises:
          FailedAssertionError: an assertion does not hold; the table is published all the same.
          MjrunError: nothing was published, unless `keep_partial`, and an existing output is untouched.
        """
        return _make(self, reporter or QuietReporter())


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
      assertions: what each assertion found.
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
    assertions: Sequence[str]
    warnings: Sequence[str]


def columns(simulation: Simulation) -> list[Column]:
    """Every column that the model of `simulation` offers, `time` first."""
    with collected_warnings():
        return [TIME, *catalogue(simulation.load())]


def _make(job: Trace, reporter: Reporter) -> TraceResult:
    start = time.perf_counter()
    with ManifestWriter(job.manifest) as manifest:
        with collected_warnings() as heard, without_timers():
            made = _trace(job, reporter)
        if not made.failure:  # which says it better
            pass_on(heard, reporter)
        verdicts = [checker.verdict() for checker in made.checkers]
        result = TraceResult(
            path=job.output,
            format=made.format,
            rows=made.rows,
            columns=made.columns,
            contacts=made.contacts,
            simulated=float(made.timeline.duration),
            steps=made.timeline.steps,
            wall=time.perf_counter() - start,
            assertions=[verdict.message for verdict in verdicts],
            warnings=tuple(heard),
        )
        failure = None if made.failure is None else str(made.failure)
        manifest.publish({**made.facts, "result": asdict(result), "failure": failure}, made.files)
    if made.failure:
        raise made.failure
    failed = [verdict.message for verdict in verdicts if not verdict.passed]
    if failed:
        raise FailedAssertionError(failed)
    return result


@dataclass(frozen=True)
class _Made:
    """What is known of a trace once its tables are in their places."""

    timeline: Timeline
    facts: Mapping[str, Any]
    format: str
    files: Sequence[Path]
    rows: int
    columns: int
    contacts: int | None
    checkers: Sequence[Checker]
    failure: SimulationError | None


def _trace(job: Trace, reporter: Reporter) -> _Made:
    with ExitStack() as stack:
        target = None if job.output == "-" else job.output
        written = table_format(target, job.format)
        contacts_written = None if job.contacts is None else table_format(job.contacts)
        _check_apart(job.output, job.contacts, job.manifest)
        model = job.simulation.load()
        timeline = job.simulation.timeline(model)
        rows = _rows(job, timeline)
        table = Table(model, job.probes, timeline, with_contacts=job.contacts is not None)
        checkers = [parse(text, [column.name for column in table.columns]).checker() for text in job.asserts]
        for text in job.simulation.remarks(model):
            reporter.warn(text)
        stepper = job.simulation.stepper(table.model)
        facts = origin(job, job.simulation, model, timeline)
        sink = stack.enter_context(TableWriter(target, written, table.columns, facts))
        contacts = None
        if contacts_written is not None:
            contacts = stack.enter_context(TableWriter(job.contacts, contacts_written, table.contact_columns, facts))
        failure = None
        try:
            _stream(table.blocks(stepper, rows), sink, contacts, checkers)
        except SimulationError as error:
            if not job.keep_partial:
                raise
            failure = error
        return _Made(
            timeline=timeline,
            facts=facts,
            format=written,
            files=[*sink.publish(), *(contacts.publish() if contacts else [])],
            rows=sink.rows,
            columns=len(table.columns),
            contacts=contacts.rows if contacts else None,
            checkers=checkers,
            failure=failure,
        )


def _check_apart(*outputs: str | None) -> None:
    """Two outputs must not be one file."""
    files = [output for output in outputs if output not in (None, "-")]
    for index, output in enumerate(files):
        if any(Path(output).resolve() == Path(other).resolve() for other in files[:index]):
            raise UsageError(f"{clean(output)} is asked for twice: each output needs a file of its own")


def _stream(
    parts: Iterator[Callable[[], Rows]], sink: TableWriter, contacts: TableWriter | None, checkers: Sequence[Checker]
) -> None:
    """Computes and writes blocks in a thread, while the next ones are simulated in C."""
    waiting: queue.Queue[Callable[[], Rows] | None] = queue.Queue(AHEAD)
    failures: list[BaseException] = []

    def write() -> None:
        while (part := waiting.get()) is not None:
            if failures:
                continue  # keep taking, so that the simulation never blocks
            try:
                rows = part()
                for checker in checkers:
                    checker.feed(rows.values, sink.rows)
                sink.write(rows.values)
                if contacts and rows.contacts is not None:
                    contacts.write(rows.contacts)
            except BaseException as failure:  # handed to the thread that waits
                failures.append(failure)

    writer = threading.Thread(target=write, name="table writer")
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


def _rows(job: Trace, timeline: Timeline) -> Sequence[int]:
    if job.rate is not None and job.every != 1:
        raise UsageError("--every and --rate exclude each other: both say how often")
    if job.rate is None:
        return timeline.rows(every=job.every)
    return timeline.rows(rate=positive("--rate", job.rate))
