"""One simulation, any number of outputs, in one pass: how jobs are done, alone and together."""

import copy
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TypeVar

import mujoco

from mjrun.errors import ControllerError, FailedAssertionError, JobsError, SimulationError, UsageError, listing
from mjrun.formats.manifest import ManifestWriter
from mjrun.job.event_detection import EventDetector
from mjrun.job.output_files import ReservedFiles
from mjrun.job.simulation import Simulation
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.reporter import QuietReporter, Reporter, pass_on
from mjrun.sim.observe import Tap, observe
from mjrun.sim.stepper import Stepper
from mjrun.timeline import Timeline

T = TypeVar("T")


@dataclass(frozen=True)
class Context:
    """What the outputs of a simulation have in common."""

    simulation: Simulation
    model: mujoco.MjModel
    timeline: Timeline
    reporter: Reporter


@dataclass(frozen=True)
class Artifact:
    """What is known of an output once it is in its place.

    Attributes:
      facts: for the manifest.
      files: that were published.
      result: makes the result, a dataclass, from the wall time of all [s] and MuJoCo's warnings.
      failed: assertions that do not hold.
    """

    facts: Mapping[str, Any]
    files: Sequence[Path]
    result: Callable[[float, Sequence[str]], Any]
    failed: Sequence[str] = ()


@dataclass(frozen=True)
class Preview:
    """What will be made.

    Attributes:
      kind: `film`, `still`, `trace`, `plot` or `recording`.
      path: where.
      count: frames, pictures, rows, samples or states; None while an event decides.
      unit: what is counted.
      size: width and height [pixels], or columns alone.
      about: what else there is to know, in words.
    """

    kind: str
    path: str
    count: int | None
    unit: str
    size: Sequence[int]
    about: str = ""


class Work(ABC):
    """An output in the making. Artifact from what can be checked without the model, while that is not loaded yet.

    Attributes:
      model: to be simulated, so that all that is measured can be; known from `plan` on.
      until: the last step that is needed; known from `plan` on.
      conditions: events whose steps have to be known before the taps are.
      keeps_partial: whether what was measured before an instability is worth publishing.
    """

    model: mujoco.MjModel
    until: int
    conditions: Sequence[str] = ()
    keeps_partial = False

    @abstractmethod
    def plan(self, ground: Context) -> None:
        """Finds every name and checks every number."""

    @abstractmethod
    def open(self, stack: ExitStack) -> None:
        """Opens the outputs, which proves that they can be written; `stack` discards what is not published."""

    def settle(self, happened: Mapping[str, Sequence[int]]) -> None:
        """Takes the steps at which each of `conditions` begins to hold."""
        assert not happened

    @abstractmethod
    def taps(self) -> Sequence[Tap]:
        """What is looked at while the simulation runs."""

    def drive(self, stepper: Stepper) -> None:
        """Runs the simulation for this work alone."""
        observe(stepper, self.taps(), self.until)

    @abstractmethod
    def outline(self) -> Preview:
        """What will be made, known from `plan` on."""

    @abstractmethod
    def finish(self, wall: float) -> Artifact:
        """Makes and publishes the outputs; `wall` is what the simulation took [s]."""


class Job(Protocol):
    """What to make of a simulation, as a value."""

    @property
    def simulation(self) -> Simulation: ...

    @property
    def manifest(self) -> str | None: ...

    @property
    def files(self) -> Sequence[tuple[str, str]]: ...

    def work(self, stack: ExitStack) -> Work:
        """The work that makes it; `stack` ends what that begins."""
        ...


def perform(jobs: Sequence[Job], reporter: Reporter | None = None) -> list[Any]:
    """Does all `jobs`, which are of one simulation, in one pass over it, and returns their results.

    Raises:
      FailedAssertionError: an assertion does not hold; everything is published all the same.
      SimulationError: nothing was published but what keeps partial results.
      MjrunError: nothing was published by the job that failed and those after it.
    """
    reporter, start = reporter or QuietReporter(), time.perf_counter()
    with ExitStack() as stack:
        manifests = [stack.enter_context(ManifestWriter(job.manifest)) if job.manifest else None for job in jobs]
        with collected_warnings() as heard, without_timers():
            everything, failure = _made(jobs, reporter)
        if failure is None:  # which says it better
            pass_on(heard, reporter)
        results = []
        for made, manifest in zip(everything, manifests, strict=True):
            if made is None:
                continue
            results.append(made.result(time.perf_counter() - start, tuple(heard)))
            failed = None if failure is None else str(failure)
            if manifest:
                manifest.write({**made.facts, "result": asdict(results[-1]), "failure": failed}, made.files)
                manifest.publish()
    wrong = [message for made in everything if made for message in made.failed]
    error = failure or (FailedAssertionError(wrong) if wrong else None)
    if error is None:
        return results
    error.results = results
    if failure and results:
        failure.add_note(f"kept, up to there: {listing([result.path for result in results])}")
    raise error


@dataclass(frozen=True)
class Plan:
    """What `perform` would do.

    Attributes:
      timestep, steps, duration: of the simulation [s].
      outlines: of each job.
    """

    timestep: float
    steps: int
    duration: float
    outlines: Sequence[Preview]


def planned(jobs: Sequence[Job], reporter: Reporter | None = None) -> Plan:
    """What `perform` would do, with all names and numbers checked, and no step taken.

    Raises:
      MjrunError: it would fail at once.
    """
    with collected_warnings(), ExitStack() as stack:
        works, ground, _ = _planned(jobs, reporter or QuietReporter(), stack)
        line = ground.timeline
        outlines = [work.outline() for work in works]
        return Plan(float(line.timestep), line.steps, float(line.duration), outlines)


def _planned(jobs: Sequence[Job], reporter: Reporter, stack: ExitStack) -> tuple[list[Work], Context, Stepper]:
    """What all jobs are made with, once everything that can be wrong with them was looked for."""
    _check_one_simulation(jobs)
    with _Faults(jobs) as faults:
        _check_files(jobs, faults)
        works = [work for i, job in enumerate(jobs) if (work := faults.tried(i, partial(job.work, stack)))]
    simulation = jobs[0].simulation
    model = simulation.load()
    ground = Context(simulation, model, simulation.timeline(model), reporter)
    with _Faults(jobs) as faults:
        for i, work in enumerate(works):
            faults.tried(i, partial(work.plan, ground))
        stepper = faults.tried(None, lambda: simulation.stepper(model if faults.found else _measured(model, works)))
    assert stepper
    return works, ground, stepper


class _Faults:
    """What is wrong with jobs: all of it is told at the end, at once."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._alone = len(jobs) == 1
        self.found: list[tuple[int | None, UsageError]] = []

    def tried(self, index: int | None, make: Callable[[], T]) -> T | None:
        """What `make` makes; None if it is wrong, which is noted of the job with this index."""
        try:
            return make()
        except ControllerError:  # somebody's code, with its traceback
            raise
        except UsageError as error:
            self.found.append((index, error))
            return None

    def __enter__(self) -> "_Faults":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self.found:
            together = JobsError(self.found)
            if self._alone and len(self.found) == 1:
                raise self.found[0][1] from together
            raise together


def _made(jobs: Sequence[Job], reporter: Reporter) -> tuple[list[Artifact | None], SimulationError | None]:
    with ExitStack() as stack:
        works, ground, stepper = _planned(jobs, reporter, stack)
        for text in ground.simulation.remarks(ground.model):
            reporter.warn(text)
        for work in works:
            work.open(stack)
        start, failure, finished = time.perf_counter(), None, works
        try:
            _simulate(works, stepper, ground, stack)
        except SimulationError as error:
            failure, finished = error, [work for work in works if work.keeps_partial]
            if not finished:
                raise
        wall = time.perf_counter() - start
        return [work.finish(wall) if work in finished else None for work in works], failure


def _measured(model: mujoco.MjModel, works: Sequence[Work]) -> mujoco.MjModel:
    """The model with all that any of `works` measures switched on."""
    measured = copy.copy(model)
    for work in works:
        measured.opt.enableflags |= work.model.opt.enableflags
    return measured


def _simulate(works: Sequence[Work], stepper: Stepper, ground: Context, stack: ExitStack) -> None:
    """Runs the simulation once; what waits for events looks at its recording."""
    late = [work for work in works if work.conditions]
    if not late and len(works) == 1:
        works[0].drive(stepper)
        return
    taps = [tap for work in works if work not in late for tap in work.taps()]
    until = max(work.until for work in works)
    if not late:
        observe(stepper, taps, until)
        return
    happening = EventDetector(ground.model, ground.timeline, {text for work in late for text in work.conditions})
    stack.callback(happening.close)
    observe(stepper, [*taps, *happening.taps(until)], until)
    for work in late:
        work.settle(happening.found)
    observe(happening.replay(stepper.model), [tap for work in late for tap in work.taps()], until)


def _check_one_simulation(jobs: Sequence[Job]) -> None:
    if not jobs:
        raise UsageError("there is nothing to do: no output was asked for")
    if any(job.simulation is not jobs[0].simulation for job in jobs):
        raise UsageError("all outputs of one pass must be of the same simulation")


def _check_files(jobs: Sequence[Job], faults: _Faults) -> None:
    """No file is written twice, or read and written."""
    taken = ReservedFiles()
    for what, path in jobs[0].simulation.inputs:
        taken.take(path, f"the {what}, which is read")
    for i, job in enumerate(jobs):
        for what, path in faults.tried(i, lambda job=job: job.files) or ():
            faults.tried(i, partial(taken.take, path, f"the {what}"))
