"""The pass: one simulation, any number of outputs."""

import copy
import os
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

from mjrun import errors
from mjrun.dataclass import dataclass
from mjrun.formats.atomic_output import MovedTogether, OutputWriter, publishing
from mjrun.formats.manifest import ManifestWriter
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.outputs.output import (
    BackendsAndWorkers,
    BlockOutput,
    Context,
    Job,
    Output,
    OutputResult,
    Plan,
    Preview,
    ReservedFiles,
)
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import Stepper
from mjrun.reporter import Reporter, WarningReporter, pass_on
from mjrun.shared_status import doing
from mjrun.simulation.episode import EpisodeResult
from mjrun.simulation.simulation import Simulation
from mjrun.task.episode import EpisodeOver, EpisodeStepper

R = TypeVar("R", bound=OutputResult)


@dataclass(frozen=True)
class PublishedOutput:
    """An output in its place: the facts of its manifest, its result, and its files."""

    facts: Mapping[str, object]
    result: OutputResult
    files: Sequence[Path]


def perform(
    jobs: Sequence[Job[R]], reporter: Reporter | None = None, published: list[PublishedOutput] | None = None
) -> list[R]:
    """Performs all `jobs` of one simulation in one pass, and returns their results.

    Errors that can be detected early are raised before the first step; nothing is made then. Later, a failing output
    does not affect the others: all are drawn and finished before any is published, and those that are complete are
    published.

    Args:
      published: receives the published outputs, also if others fail.

    Raises:
      PartlyDoneError: some outputs were made and others failed.
      FailedAssertionError: an assertion fails; everything is published nevertheless.
      GoldenDifferenceError: a trace differs from its golden table; everything is published nevertheless.
      SimulationError: the simulation became unstable; only outputs that keep partial results are published.
      MjrunError: nothing was published; if several outputs failed, this is the error of the first.
    """
    reporter = reporter or WarningReporter()
    with ExitStack() as stack:
        with doing("simulating"), collected_warnings() as warnings, without_timers():
            current: Pass[R] = Pass(jobs, reporter, stack)
            current.simulate()
            current.draw()
            current.finish()
        if current.instability is None:  # which describes it better
            pass_on(warnings, reporter)
        if current.episode:
            reporter.note(current.episode.sentence)
        current.publish(tuple(warnings), [] if published is None else published)

    if error := current.error():
        error.results = current.results
        raise error
    return current.results


@dataclass(frozen=True)
class PassPreview:
    """A description of the pass that `perform` would make.

    Attributes:
      timestep, steps, duration: the timestep [s], the number of steps and the duration [s] of the simulation.
      outputs: the description of each output.
    """

    timestep: float
    steps: int
    duration: float
    outputs: Sequence[Preview]


def preview(jobs: Sequence[Job[OutputResult]], reporter: Reporter | None = None) -> PassPreview:
    """Describes the pass that `perform` would make, with all names and numbers checked and no step taken.

    Raises:
      MjrunError: the pass would fail before its first step.
    """
    with collected_warnings(), closing(BackendsAndWorkers()) as renderers:
        plans, context, _ = _plan(jobs, reporter or WarningReporter(), renderers)
    timeline = context.timeline
    outputs = [plan.preview for plan in plans]
    return PassPreview(float(timeline.timestep), timeline.steps, float(timeline.duration), outputs)


def _plan(
    jobs: Sequence[Job[R]], reporter: Reporter, renderers: BackendsAndWorkers
) -> tuple[list[Plan[R]], Context, Stepper]:
    """Plans all jobs, after collecting every error in them."""
    if not jobs:
        raise errors.UsageError("nothing to do: no output is requested")
    simulation = jobs[0].simulation
    if any(job.simulation is not simulation for job in jobs):
        raise errors.UsageError("all outputs of one pass must share one simulation")
    collected = _UsageErrors(alone=len(jobs) == 1)
    _check_files(jobs, collected)
    for index, job in enumerate(jobs):
        with collected.errors_of(index):
            job.check()
            if job.renderer_options is not None:
                renderers.detect(job.renderer_options)
    collected.raise_all()

    with collected.errors_of(None):
        context = _context(simulation, reporter)
    collected.raise_all()

    plans = list[Plan[R]]()
    for index, job in enumerate(jobs):
        with collected.errors_of(index):
            plans.append(job.plan(context))
    measured = copy.copy(context.model)
    for plan in plans:
        measured.opt.enableflags |= plan.enable_flags
    with collected.errors_of(None):
        stepper = simulation.stepper(measured)
    collected.raise_all()
    return plans, context, stepper


def _context(simulation: Simulation, reporter: Reporter) -> Context:
    model = simulation.load()
    if simulation.until is None:
        return Context(simulation, model, simulation.timeline(model), reporter)
    from mjrun.outputs.event_detection import final_timeline  # which few simulations need

    return Context(simulation, model, final_timeline(simulation, model), reporter)


class _UsageErrors:
    """A collector of the errors in jobs, which raises all of them together.

    Args:
      alone: whether there is only one job, whose single error is raised unchanged.
    """

    def __init__(self, *, alone: bool) -> None:
        self._alone = alone
        self._errors: list[tuple[int | None, errors.UsageError]] = []

    @contextmanager
    def errors_of(self, index: int | None) -> Generator[None]:
        """Records a UsageError in the `with` block for the job with this index, or for all jobs if it is None."""
        try:
            yield
        except errors.ControllerError:  # user code, with its traceback
            raise
        except errors.UsageError as error:
            self._errors.append((index, error))

    def raise_all(self) -> None:
        """Raises the collected errors, if any."""
        if self._errors:
            together = errors.FaultyJobsError(self._errors)
            if self._alone and len(self._errors) == 1:
                raise self._errors[0][1] from together
            raise together


def _check_files(jobs: Sequence[Job[OutputResult]], collected: _UsageErrors) -> None:
    """Collects an error for each file that is written twice, or overwrites an input that it is not made from."""
    reserved = ReservedFiles()
    rewritten = {os.path.realpath(path) for job in jobs for path in job.rewritten_inputs}
    inputs = [(path, f"the {what}, which is read") for what, path in jobs[0].simulation.inputs]
    known = {os.path.realpath(path) for path, _ in inputs}
    for what, path in (each for job in jobs for each in job.inputs):  # several jobs may read one file
        if os.path.realpath(path) not in known:
            known.add(os.path.realpath(path))
            inputs.append((Path(path), f"the {what}, which is read"))
    for path, owner in inputs:
        if os.path.realpath(path) not in rewritten:
            reserved.reserve_input(path, owner)
    for index, job in enumerate(jobs):
        with collected.errors_of(index):
            for name, path in job.files:
                with collected.errors_of(index), errors.concerning(name):
                    reserved.reserve(path, f"the {name}")


class Pass(Generic[R]):
    """A simulation with its open outputs. An output that fails is left out from then on.

    Args:
      stack: discards everything that is not published.

    Attributes:
      outputs: the open outputs.
      failures: path and error of each failed output, by index.
      instability: the error that ended the simulation early, if any.
      results: the results of the published outputs.
    """

    def __init__(self, jobs: Sequence[Job[R]], reporter: Reporter, stack: ExitStack) -> None:
        self.failures: dict[int, tuple[str, errors.MjrunError]] = {}
        self.instability: errors.SimulationError | None = None
        self.results: list[R] = []
        self._made: list[str] = []
        self._start = time.perf_counter()
        self._simulation_wall = 0.0
        self._jobs, self._stack = jobs, stack
        self._manifests = [stack.enter_context(ManifestWriter(job.manifest)) if job.manifest else None for job in jobs]

        renderers = stack.enter_context(closing(BackendsAndWorkers()))
        self._plans, self._context, self._stepper = _plan(jobs, reporter, renderers)
        for text in self._context.simulation.notes(self._context.model):
            reporter.note(text)
        for text in self._context.simulation.remarks(self._context.model):
            reporter.warn(text)
        self.outputs = [plan.open(stack, renderers) for plan in self._plans]
        self._writers: dict[int, Sequence[OutputWriter]] = {}  # of the outputs that are complete

    def simulate(self) -> None:
        """Runs the simulation once; outputs that wait for events observe its recording."""
        start = time.perf_counter()
        until = max(plan.until for plan in self._plans)
        waiting = [index for index, plan in enumerate(self._plans) if plan.conditions]
        try:
            if len(self._plans) == 1 and not waiting:
                self._simulate_alone(until)
            else:
                self._simulate_together(until, waiting)
        except errors.SimulationError as error:
            self.instability = error
        except EpisodeOver as error:
            raise errors.UsageError(
                f"{error}, earlier than when it was simulated before: the policy acts at random"
            ) from None
        except errors.MjrunError as error:
            if error not in [failure for _, failure in self.failures.values()]:  # a controller's, which affects all
                raise
        self._simulation_wall = time.perf_counter() - start

    @property
    def episode(self) -> EpisodeResult | None:
        """The result of the policy's episode so far; None if there is no policy, or the outputs play others."""
        episode, stepper = self._context.simulation.episode, self._stepper
        if episode is None or not isinstance(stepper, EpisodeStepper) or not any(plan.until for plan in self._plans):
            return None
        return episode.result(stepper)

    def draw(self) -> None:
        """Draws what the outputs recorded."""
        for index, output in self._completed():
            with self._failing(index):
                output.draw()

    def finish(self) -> None:
        """Completes the outputs that can be completed."""
        for index, output in self._completed():
            with self._failing(index):
                writers = output.written()
                for part in (part for writer in writers for part in writer.together):
                    part.finish()
                self._writers[index] = writers

    def publish(self, warnings: Sequence[str], published: list[PublishedOutput]) -> None:
        """Moves the outputs that are complete to their places, each only together with its manifest; signals wait."""
        with publishing([writer for writers in self._writers.values() for writer in writers]):
            for index, writers in self._writers.items():
                with self._failing(index):
                    output, manifest = self.outputs[index], self._manifests[index]
                    wall = time.perf_counter() - self._start
                    with MovedTogether() as together:
                        files = [file for writer in writers for file in together.move(writer)]
                        result = output.result(files, self._simulation_wall)
                        result = replace(result, episode=self.episode, wall=wall, warnings=warnings)
                        failure = None if self.instability is None else str(self.instability)
                        facts = {**output.facts, "result": asdict(result), "failure": failure}
                        if manifest:
                            manifest.write(facts, files)
                            together.move(manifest)
                    for text in output.remarks():
                        self._context.reporter.warn(text)
                    self.results.append(result)
                    self._made += [str(part.destination.shown) for writer in writers for part in writer.together]
                    published.append(PublishedOutput(facts, result, files))

    def error(self) -> errors.MjrunError | None:
        """Returns the error to raise at the end, if any."""
        failures = [failure for _, failure in sorted(self.failures.items())]
        others: list[errors.MjrunError] = [error for _, error in failures]
        main: errors.MjrunError | None = None
        if failures and not self._made:
            main = others.pop(0)
            others += [self.instability] if self.instability else []
        elif self.instability:
            main = self.instability
            if self._made:
                main.add_note(f"kept, up to there: {errors.listing(self._made)}")
        elif failures:
            main, others = errors.PartlyDoneError(self._made, failures), []
        others += self._verdicts()
        if main is None and others:
            main = others.pop(0)
        if main:
            for other in others:
                main.add_note(other.spelled(errors.option))
        return main

    def _completed(self) -> Iterator[tuple[int, Output[R]]]:
        """Yields the outputs that can be completed: those that have not failed, and keep what an instability left."""
        for index, output in enumerate(self.outputs):
            if index not in self.failures and (self.instability is None or self._jobs[index].keeps_partial):
                yield index, output

    def _verdicts(self) -> list[errors.MjrunError]:
        """Returns the errors of complete outputs with failed assertions or golden differences."""
        complete = [self.outputs[index] for index in self._writers]
        assertions = [message for output in complete for message in output.failed_assertions]
        differences = [message for output in complete for message in output.golden_differences]
        failed: list[errors.MjrunError] = [errors.FailedAssertionError(assertions)] if assertions else []
        return [*failed, *([errors.GoldenDifferenceError(differences)] if differences else [])]

    def _simulate_alone(self, until: int) -> None:
        (output,) = self.outputs
        try:
            if isinstance(output, BlockOutput):
                output.simulate(self._stepper, until)
            else:
                run_with_taps(self._stepper, output.taps({}), until)
        except errors.SimulationError:
            raise
        except errors.MjrunError as error:
            if isinstance(error.__context__, errors.SimulationError):
                self.instability = error.__context__
            self._fail([0], error)

    def _simulate_together(self, until: int, waiting: Sequence[int]) -> None:
        others = [index for index in range(len(self._plans)) if index not in waiting]
        taps = [tap for index in others for tap in self._guarded(self.outputs[index].taps({}), [index])]
        if not waiting:
            run_with_taps(self._stepper, taps, until)
            return
        from mjrun.outputs.event_detection import EventDetector

        context = self._context
        conditions = {text for index in waiting for text in self._plans[index].conditions}
        detector = EventDetector(context.model, context.timeline, conditions, context.episode)
        self._stack.callback(detector.close)
        run_with_taps(self._stepper, [*taps, *self._guarded(detector.taps(until), waiting)], until)

        taps = list[Tap]()
        for index in waiting:
            if index not in self.failures:
                with self._failing(index):
                    taps += self._guarded(self.outputs[index].taps(detector.event_steps), [index])
        run_with_taps(detector.replay(self._stepper.model), taps, until)

    def _guarded(self, taps: Sequence[Tap], indices: Sequence[int]) -> list[Tap]:
        """Returns `taps` whose first error fails the outputs with these indices, and ends them alone."""

        def record(tap: Tap, stepper: Stepper) -> None:
            if indices[0] in self.failures:
                return
            try:
                tap.record(stepper)
            except errors.SimulationError:
                raise
            except errors.MjrunError as error:
                self._fail(indices, error)

        return [Tap(tap.steps, partial(record, tap)) for tap in taps]

    def _fail(self, indices: Sequence[int], error: errors.MjrunError) -> None:
        """Records a failure; without any output left, the simulation stops."""
        for index in indices:
            self.failures[index] = self._plans[index].preview.path, error
        if len(self.failures) == len(self._plans):
            raise error

    @contextmanager
    def _failing(self, index: int) -> Generator[None]:
        """Records an error as a failure of this output."""
        try:
            yield
        except errors.MjrunError as error:
            self.failures[index] = self._plans[index].preview.path, error
