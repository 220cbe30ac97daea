"""The pass: one simulation, any number of outputs."""

import copy
import os
import time
import warnings
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

from mjrun import errors
from mjrun.dataclass import dataclass
from mjrun.file_version import file_version
from mjrun.formats.manifest import ManifestWriter
from mjrun.formats.output_writer import PublishingTransaction, publishing
from mjrun.model.mujoco_globals import collected_warnings, report_warnings, without_timers
from mjrun.outputs.output import (
    FinishedOutput,
    OpenBlockOutput,
    OpenOutput,
    OutputPlan,
    OutputPreview,
    OutputRequest,
    OutputResult,
    PassContext,
    RenderingResources,
    ReservedFiles,
)
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import Stepper
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.shared_status import doing
from mjrun.simulation.policy_episode import EpisodeResult
from mjrun.simulation.simulation import Simulation
from mjrun.task.episode import EpisodeOver, EpisodeStepper

R = TypeVar("R", bound=OutputResult)


@dataclass(frozen=True)
class PublishedOutput:
    """An output in its place.

    Attributes:
      facts: the facts of its manifest.
      result: its result.
      files: its files.
      units: the units of its columns.
      file_versions: versions of its files and its manifest from before another process could replace them.
    """

    facts: Mapping[str, object]
    result: OutputResult
    files: Sequence[Path]
    units: Mapping[str, str]
    file_versions: Mapping[Path, list[int] | None]


def perform(
    requests: Sequence[OutputRequest[R]],
    reporter: Reporter | None = None,
    published: list[PublishedOutput] | None = None,
) -> list[R]:
    """Performs all `requests` of one simulation in one pass, and returns their results.

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
    reporter, start = reporter or PythonApiReporter(), time.perf_counter()
    with ExitStack() as stack:
        with doing("simulating"), collected_warnings() as messages, without_timers():
            backends = stack.enter_context(closing(RenderingResources()))
            plan = plan_pass(requests, reporter, backends)
            current = open_pass(plan, stack, backends)
            current.simulate()
            current.finish()
        if current.instability is None:  # which describes it better
            report_warnings(messages, reporter)
        if current.episode:
            reporter.note(current.episode.sentence)
        current.publish(tuple(messages), start, [] if published is None else published)

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
    outputs: Sequence[OutputPreview]


def preview(requests: Sequence[OutputRequest[OutputResult]], reporter: Reporter | None = None) -> PassPreview:
    """Describes the pass that `perform` would make, with all names and numbers checked and no step taken.

    Raises:
      MjrunError: the pass would fail before its first step.
    """
    with collected_warnings(), closing(RenderingResources()) as backends:
        plan = plan_pass(requests, reporter or PythonApiReporter(), backends)
    timeline = plan.context.timeline
    outputs = [each.preview for each in plan.outputs]
    return PassPreview(float(timeline.timestep), timeline.steps, float(timeline.duration), outputs)


def rehearse(requests: Sequence[OutputRequest[OutputResult]]) -> None:
    """Plans and opens a pass like one that will follow, takes no step, and publishes nothing.

    Raises:
      MjrunError: the pass would fail before its first step.
    """
    with ExitStack() as stack, collected_warnings():
        backends = stack.enter_context(closing(RenderingResources()))
        plan = plan_pass(requests, PythonApiReporter(), backends)
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore", errors.MjrunWarning)  # the pass will report it when it opens its files
        open_pass(plan, stack, backends)


@dataclass(frozen=True)
class PassPlan(Generic[R]):
    """The planned outputs of one simulation.

    Attributes:
      stepper: takes the steps; its model computes everything that the outputs measure.
      outputs: the plan of each request.
      file_versions: versions of the simulation's files before they were read.
    """

    requests: Sequence[OutputRequest[R]]
    context: PassContext
    stepper: Stepper
    outputs: Sequence[OutputPlan[R]]
    file_versions: Mapping[Path, list[int] | None]


def plan_pass(requests: Sequence[OutputRequest[R]], reporter: Reporter, backends: RenderingResources) -> PassPlan[R]:
    """Plans all requests, after collecting every error in them.

    Raises:
      FaultyRequestsError: there are several errors; a single one is raised unchanged.
    """
    if not requests:
        raise errors.UsageError("nothing to do: no output is requested")
    simulation = requests[0].simulation
    if any(request.simulation is not simulation for request in requests):
        raise errors.UsageError("all outputs of one pass must share one simulation")
    collected = _UsageErrors(alone=len(requests) == 1)
    _check_files(requests, collected)
    for index, request in enumerate(requests):
        with collected.errors_of(index):
            request.check()
            if request.renderer_options is not None:
                backends.detect(request.renderer_options)
    collected.raise_all()

    file_versions = simulation.file_versions()
    with collected.errors_of(None):
        context = _context(simulation, reporter)
    collected.raise_all()

    plans = list[OutputPlan[R]]()
    for index, request in enumerate(requests):
        with collected.errors_of(index):
            plans.append(request.plan(context))
    measured = copy.copy(context.model)
    for plan in plans:
        measured.opt.enableflags |= plan.enable_flags
    with collected.errors_of(None):
        stepper = simulation.stepper(measured)
    collected.raise_all()
    return PassPlan(requests, context, stepper, plans, file_versions)


def _context(simulation: Simulation, reporter: Reporter) -> PassContext:
    model = simulation.load()
    if simulation.until is None:
        return PassContext(simulation, model, simulation.timeline(model), reporter)
    from mjrun.outputs.event_detection import final_timeline  # which few simulations need

    return PassContext(simulation, model, final_timeline(simulation, model), reporter)


class _UsageErrors:
    """A collector of the errors in requests, which raises all of them together.

    Args:
      alone: whether there is only one request, whose single error is raised unchanged.
    """

    def __init__(self, *, alone: bool) -> None:
        self._alone = alone
        self._errors: list[tuple[int | None, errors.UsageError]] = []

    @contextmanager
    def errors_of(self, index: int | None) -> Generator[None]:
        """Records a UsageError in the `with` block for the request with this index, or for all if it is None."""
        try:
            yield
        except errors.ControllerError:  # user code, with its traceback
            raise
        except errors.UsageError as error:
            self._errors.append((index, error))

    def raise_all(self) -> None:
        """Raises the collected errors, if any."""
        if self._errors:
            together = errors.FaultyRequestsError(self._errors)
            if self._alone and len(self._errors) == 1:
                raise self._errors[0][1] from together
            raise together


def _check_files(requests: Sequence[OutputRequest[OutputResult]], collected: _UsageErrors) -> None:
    """Collects an error for each file that is written twice, or overwrites an input that it is not made from."""
    reserved = ReservedFiles()
    rewritten = {os.path.realpath(path) for request in requests for path in request.rewritten_inputs}
    inputs = [(path, f"the {what}, which is read") for what, path in requests[0].simulation.inputs]
    known = {os.path.realpath(path) for path, _ in inputs}
    for what, path in (each for request in requests for each in request.inputs):  # several requests may read one file
        if os.path.realpath(path) not in known:
            known.add(os.path.realpath(path))
            inputs.append((Path(path), f"the {what}, which is read"))
    for path, owner in inputs:
        if os.path.realpath(path) not in rewritten:
            reserved.reserve_input(path, owner)
    for index, request in enumerate(requests):
        with collected.errors_of(index):
            for name, path in request.files:
                with collected.errors_of(index), errors.concerning(name):
                    reserved.reserve(path, f"the {name}")


def open_pass(plan: PassPlan[R], stack: ExitStack, backends: RenderingResources) -> "OpenPass[R]":
    """Opens all files, whose unpublished ones the stack removes, and starts encoders and drawing processes.

    Raises:
      FaultyRequestsError: there are several errors in options; a single one is raised unchanged.
      MjrunError: a file cannot be written, an input has changed while it was read, or no backend works.
    """
    context = plan.context
    context.simulation.require_unchanged_files(plan.file_versions)  # before outputs state what they are made from
    manifests = [
        stack.enter_context(ManifestWriter(request.manifest)) if request.manifest else None for request in plan.requests
    ]
    for text in context.simulation.notes(context.model):
        context.reporter.note(text)
    remarks = context.simulation.remarks(context.model)
    if max(each.until for each in plan.outputs) == context.timeline.steps:
        remarks += context.simulation.remarks_on_end(context.model)
    for text in remarks:
        context.reporter.warn(text)
    collected, opened = _UsageErrors(alone=len(plan.outputs) == 1), list[OpenOutput[R]]()
    for index, each in enumerate(plan.outputs):
        with collected.errors_of(index):
            opened.append(each.open(stack, backends))
    collected.raise_all()
    return OpenPass(plan, manifests, opened)


class OpenPass(Generic[R]):
    """A simulation with its open outputs. An output that fails is left out from then on.

    Attributes:
      outputs: the open outputs.
      failures: path and error of each failed output, by index.
      instability: the error that ended the simulation early, if any.
      results: the results of the published outputs.
    """

    def __init__(
        self, plan: PassPlan[R], manifests: Sequence[ManifestWriter | None], outputs: Sequence[OpenOutput[R]]
    ) -> None:
        self.outputs = outputs
        self.failures: dict[int, tuple[str, errors.MjrunError]] = {}
        self.instability: errors.SimulationError | None = None
        self.results: list[R] = []
        self._plan, self._manifests = plan, manifests
        self._simulation_wall = 0.0
        self._finished: dict[int, FinishedOutput[R]] = {}
        self._made: list[str] = []

    def simulate(self) -> None:
        """Runs the simulation once; outputs that wait for events observe its recording."""
        start = time.perf_counter()
        stepper, until = self._plan.stepper, max(each.until for each in self._plan.outputs)
        waiting = [index for index, each in enumerate(self._plan.outputs) if each.conditions]
        try:
            if waiting:
                self._simulate_and_replay(until, waiting)
            elif len(self.outputs) == 1 and isinstance(self.outputs[0], OpenBlockOutput):
                self.outputs[0].simulate(stepper, until)
            else:
                run_with_taps(stepper, self._taps(range(len(self.outputs))), until)
        except errors.SimulationError as error:
            self.instability = error
        except EpisodeOver as error:
            raise errors.UsageError(
                f"{error}, earlier than when it was simulated before: the policy acts at random"
            ) from None
        except errors.MjrunError as error:
            if len(self.outputs) == 1:
                self._fail([0], error)
                if isinstance(error.__context__, errors.SimulationError):
                    self.instability = error.__context__
            elif error not in [failure for _, failure in self.failures.values()]:  # a controller's, which affects all
                raise
        self._simulation_wall = time.perf_counter() - start

    @property
    def episode(self) -> EpisodeResult | None:
        """The result of the policy's episode so far; None if there is no policy, or the outputs play others."""
        episode, stepper = self._plan.context.simulation.episode, self._plan.stepper
        if episode is None or not isinstance(stepper, EpisodeStepper):
            return None
        return episode.result(stepper) if any(each.until for each in self._plan.outputs) else None

    def finish(self) -> None:
        """Draws what the outputs recorded, and completes their files."""
        for index, output in enumerate(self.outputs):
            if self._can_finish(index):
                with self._failing(index):
                    self._finished[index] = output.finish(self._simulation_wall)

    def publish(self, warnings: Sequence[str], start: float, published: list[PublishedOutput]) -> None:
        """Moves the finished outputs to their places, each only together with its manifest; signals wait.

        Args:
          warnings: MuJoCo's warnings.
          start: time at which the pass began, on the clock of `perf_counter` [s].
          published: receives the published outputs.
        """
        with publishing([writer for finished in self._finished.values() for writer in finished.writers]):
            for index, finished in self._finished.items():
                with self._failing(index):
                    manifest, wall = self._manifests[index], time.perf_counter() - start
                    result = replace(finished.result, episode=self.episode, wall=wall, warnings=warnings)
                    failure = None if self.instability is None else str(self.instability)
                    facts = {**finished.facts, "result": asdict(result), "failure": failure}
                    with PublishingTransaction() as together:
                        files = [file for writer in finished.writers for file in together.move(writer)]
                        made = [*files]
                        if manifest:
                            manifest.write(facts, files)
                            manifest.finish()
                            made += together.move(manifest)
                    self.results.append(result)
                    versions = {path: file_version(str(path)) for path in made}
                    published.append(PublishedOutput(facts, result, files, finished.units, versions))
                    writers = [*finished.writers, *([manifest] if manifest else [])]
                    for part in (part for writer in writers for part in writer.together):
                        self._made.append(str(part.destination.shown))
                        if part.destination.remark:
                            self._plan.context.reporter.warn(part.destination.remark)

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

    def _verdicts(self) -> list[errors.MjrunError]:
        """Returns the errors of finished outputs with failed assertions or golden differences."""
        finished = self._finished.values()
        assertions = [message for output in finished for message in output.failed_assertions]
        differences = [message for output in finished for message in output.golden_differences]
        failed: list[errors.MjrunError] = [errors.FailedAssertionError(assertions)] if assertions else []
        return [*failed, *([errors.GoldenDifferenceError(differences)] if differences else [])]

    def _simulate_and_replay(self, until: int, waiting: Sequence[int]) -> None:
        """Runs the simulation while events are detected, and then replays it for the outputs that wait for them."""
        from mjrun.outputs.event_detection import EventDetector  # which few passes need

        context = self._plan.context
        conditions = {text for index in waiting for text in self._plan.outputs[index].conditions}
        with closing(EventDetector(context.model, context.timeline, conditions, context.episode)) as detector:
            taps = self._taps([index for index in range(len(self.outputs)) if index not in waiting])
            taps += self._guarded(detector.taps(until), waiting)
            try:
                run_with_taps(self._plan.stepper, taps, until)
            except errors.SimulationError as error:
                self.instability, until = error, detector.last_step

            for index in waiting:
                if self._can_finish(index):
                    with self._failing(index):
                        self.outputs[index].choose_taps(detector.event_steps)
            observing = [index for index in waiting if self._can_finish(index)]
            if observing:
                run_with_taps(detector.replay(self._plan.stepper.model), self._taps(observing), until)

    def _can_finish(self, index: int) -> bool:
        """Returns whether an output has not failed, and has all steps or keeps partial results."""
        return index not in self.failures and (self.instability is None or self._plan.requests[index].keeps_partial)

    def _taps(self, indices: Iterable[int]) -> list[Tap]:
        """Returns the taps of the outputs with these indices, of which each output fails alone."""
        return [tap for index in indices for tap in self._guarded(self.outputs[index].taps, [index])]

    def _guarded(self, taps: Sequence[Tap], indices: Sequence[int]) -> list[Tap]:
        """Returns `taps` whose first error fails the outputs with these indices; without others, it ends the run."""
        if len(self.outputs) == 1:
            return [*taps]

        def record(tap: Tap, stepper: Stepper) -> None:
            if indices[0] in self.failures:
                return
            try:
                tap.record(stepper)
            except errors.SimulationError:
                raise
            except errors.MjrunError as error:
                self._fail(indices, error)
                if len(self.failures) == len(self.outputs):
                    raise

        return [Tap(tap.steps, partial(record, tap)) for tap in taps]

    def _fail(self, indices: Sequence[int], error: errors.MjrunError) -> None:
        """Records a failure of the outputs with these indices."""
        for index in indices:
            self.failures[index] = self._plan.outputs[index].preview.path, error

    @contextmanager
    def _failing(self, index: int) -> Generator[None]:
        """Records an error as a failure of this output."""
        try:
            yield
        except errors.MjrunError as error:
            self._fail([index], error)
