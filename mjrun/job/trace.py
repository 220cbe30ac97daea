"""A trace: named, aligned, exact numbers of a simulation, one row per instant."""

import copy
import queue
import threading
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import FailedAssertionError, SimulationError, UsageError
from mjrun.export.table import TableWriter, table_format
from mjrun.job.report import QuietReporter, Reporter, pass_on
from mjrun.job.simulation import Simulation, positive
from mjrun.model import faults
from mjrun.model.column import Column
from mjrun.model.native import collected_warnings
from mjrun.probe.assertion import Checker, parse
from mjrun.probe.fields import Probe
from mjrun.probe.select import DEFAULT, catalogue, select
from mjrun.sim.batch import blocks, instant
from mjrun.sim.observe import Tap, observe
from mjrun.sim.stepper import PhysicsStepper, Stepper
from mjrun.timeline import Timeline
from mjrun.version import __version__

TIME = Column("time", "s", "simulated time, exact")
AHEAD = 4  # blocks that may wait to be written
ROWS = 256  # of a block that is read instant by instant


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
    """

    simulation: Simulation
    output: str = "-"
    format: str | None = None
    probes: Sequence[str] = DEFAULT
    every: int = 1
    rate: float | str | Fraction | None = None
    asserts: Sequence[str] = ()
    keep_partial: bool = False

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
      simulated, steps: simulated time [s] and steps taken.
      wall: wall time of all [s].
      assertions: what each assertion found.
      warnings: what MuJoCo warned of.
    """

    path: str
    format: str
    rows: int
    columns: int
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
    with ExitStack() as stack:
        heard = stack.enter_context(collected_warnings())
        target = None if job.output == "-" else job.output
        written = table_format(target, job.format)
        model = job.simulation.load()
        timeline = job.simulation.timeline(model)
        rows = _rows(job, timeline)
        table = Table(model, job.probes, timeline)
        checkers = [parse(text, [column.name for column in table.columns]).checker() for text in job.asserts]
        for text in (*faults.of_model(model), *job.simulation.start.remarks(model)):
            reporter.warn(text)
        stepper = job.simulation.stepper(table.model)
        manifest = _manifest(job, timeline)
        sink = stack.enter_context(TableWriter(target, written, table.columns, manifest))
        try:
            _stream(table.blocks(stepper, rows), sink, checkers)
        except SimulationError:
            if job.keep_partial:
                sink.publish()
            raise
        sink.publish()
    pass_on(heard, reporter)
    verdicts = [checker.verdict() for checker in checkers]
    failed = [verdict.message for verdict in verdicts if not verdict.passed]
    if failed:
        raise FailedAssertionError(failed)
    return TraceResult(
        path=job.output,
        format=written,
        rows=sink.rows,
        columns=len(table.columns),
        simulated=float(timeline.duration),
        steps=timeline.steps,
        wall=time.perf_counter() - start,
        assertions=[verdict.message for verdict in verdicts],
        warnings=tuple(heard),
    )


class Table:
    """The columns of a trace, and its rows as they come.

    Energy is computed when it is measured, whatever the model's flag says; it does not change the motion.
    """

    def __init__(self, model: mujoco.MjModel, asked: Sequence[str], timeline: Timeline) -> None:
        self.probes = select(model, asked)
        self.columns = [TIME, *(column for probe in self.probes for column in probe.columns)]
        self._timeline = timeline
        self._fields = sorted({field for probe in self.probes for field in probe.fields})
        self.model = copy.copy(model)
        if "energy" in self._fields:
            self.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)

    def blocks(self, stepper: PhysicsStepper, rows: Sequence[int]) -> Iterator[Callable[[], np.ndarray]]:
        """Blocks `(n, ncolumns)` of the rows at the steps `rows`, each yet to be computed by whoever takes it."""
        if any(probe.at for probe in self.probes):
            yield from self._by_instants(stepper, rows)
            return
        for first, record in blocks(stepper, self._fields, self._timeline.steps):
            count = len(next(iter(record.values()), np.empty(1)))
            kept = np.array(rows[bisect_left(rows, first) : bisect_left(rows, first + count)])
            if len(kept):
                index = slice(None) if len(kept) == count else kept - first
                yield lambda kept=kept, index=index, record=record: self._join(
                    kept, [probe.compute({f: record[f][index] for f in probe.fields}) for probe in self.probes]
                )

    def _by_instants(self, stepper: PhysicsStepper, rows: Sequence[int]) -> Iterator[Callable[[], np.ndarray]]:
        """The same, read from one consistent MjData per row."""
        for start in range(0, len(rows), ROWS):
            part, found = rows[start : start + ROWS], []
            try:
                observe(stepper, [Tap(part, self._read, found.append)], part[-1])
            except SimulationError:
                if found:
                    yield lambda part=part, found=found: self._stack(part, found)
                raise
            yield lambda part=part, found=found: self._stack(part, found)

    def _stack(self, steps: Sequence[int], found: Sequence[np.ndarray]) -> np.ndarray:
        return self._join(np.array(steps[: len(found)]), [np.stack(found)])

    def _read(self, stepper: Stepper) -> np.ndarray:
        """One row, without its time."""
        record, data = instant(stepper, self._fields), stepper.instant()
        return np.concatenate([_value(probe, record, stepper.model, data) for probe in self.probes])

    def _join(self, steps: np.ndarray, parts: Sequence[np.ndarray]) -> np.ndarray:
        timestep = self._timeline.timestep
        times = steps * timestep.numerator / timestep.denominator  # exact, then rounded once
        return np.column_stack([times, *parts])


def _value(probe: Probe, record: Mapping[str, np.ndarray], model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    return probe.at(model, data) if probe.at else probe.compute(record)[0]


def _stream(parts: Iterator[Callable[[], np.ndarray]], sink: TableWriter, checkers: Sequence[Checker]) -> None:
    """Computes and writes blocks in a thread, while the next ones are simulated in C."""
    waiting: queue.Queue[Callable[[], np.ndarray] | None] = queue.Queue(AHEAD)
    failures: list[BaseException] = []

    def write() -> None:
        while (part := waiting.get()) is not None:
            if failures:
                continue  # keep taking, so that the simulation never blocks
            try:
                block = part()
                for checker in checkers:
                    checker.feed(block, sink.rows)
                sink.write(block)
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


def _manifest(job: Trace, timeline: Timeline) -> dict[str, Any]:
    """What made the table."""
    return {
        "mjrun": __version__,
        "mujoco": mujoco.mj_versionString(),
        "numpy": np.__version__,
        "model": str(getattr(job.simulation.model, "path", "")),
        "key": job.simulation.key,
        "seed": job.simulation.seed,
        "timestep": float(timeline.timestep),
        "steps": timeline.steps,
        "probes": list(job.probes),
    }
