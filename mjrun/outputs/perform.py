"""One simulation, any number of outputs, in one pass."""

import copy
import os
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

import mujoco

from mjrun.activity import doing
from mjrun.errors import (
    ControllerError,
    FailedAssertionError,
    GoldenDifferenceError,
    InvalidJobsError,
    MjrunError,
    PartlyDoneError,
    SimulationError,
    UsageError,
    concerning,
    listing,
    option,
)
from mjrun.formats.atomic_output import nobody_else_publishes
from mjrun.formats.manifest import ManifestWriter
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.outputs.output_files import ReservedFiles
from mjrun.outputs.shared_rendering import SharedRendering
from mjrun.outputs.task import (
    Artifact,
    Context,
    EventDrivenOutput,
    EventSteps,
    Job,
    Output,
    OutputResult,
    PassSummary,
    Plan,
    Preview,
)
from mjrun.physics.observe import AnyTap, Tap, observe
from mjrun.physics.stepper import Stepper
from mjrun.reporter import Reporter, WarningReporter, pass_on
from mjrun.simulation.episode import EpisodeResult
from mjrun.task.episode import EpisodeOver, EpisodeStepper

T = TypeVar("T")
R = TypeVar("R", bound=OutputResult)
AnyOutput = Output[R] | EventDrivenOutput[R]


# What is told of each output that is published: what its manifest says, its result, and its files.
Published = Callable[[Mapping[str, object], OutputResult, Sequence[Path]], None]


def perform(jobs: Sequence[Job[R]], reporter: Reporter | None = None, published: Published | None = None) -> list[R]:
    """Does all `jobs`, which are of one simulation, in one pass over it, and returns their results.

    What can fail early fails before the first step, and then nothing is made. Later, an output that fails does not
    cost the others: all are finished before any is published, and those that are complete are published, and
    `published` is told of each.

    Raises:
      PartlyDoneError: some outputs were made and some were not.
      FailedAssertionError: an assertion does not hold; everything is published all the same.
      GoldenDifferenceError: a trace differs from its golden table; everything is published all the same.
      SimulationError: nothing was published but what keeps partial results.
      MjrunError: nothing was published; if several outputs failed, this is the error of the first.
    """
    reporter, start = reporter or WarningReporter(), time.perf_counter()
    with ExitStack() as stack:
        manifests = [stack.enter_context(ManifestWriter(job.manifest)) if job.manifest else None for job in jobs]
        with doing("simulating"), collected_warnings() as warnings, without_timers():
            simulated = _open(jobs, reporter, stack)
            simulated.run(stack)
            artifacts = simulated.finish()
        if simulated.instability is None:  # which says it better
            pass_on(warnings, reporter)
        episode = simulated.episode
        if episode:
            reporter.note(episode.sentence)

        results: list[R] = []
        made: list[str] = []
        failure = None if simulated.instability is None else str(simulated.instability)

        def told(artifact: Artifact[R], files: Sequence[Path]) -> tuple[R, dict[str, object]]:
            summary = PassSummary(time.perf_counter() - start, simulated.wall, tuple(warnings))
            result = replace(artifact.result(files, summary), episode=episode)
            return result, {**artifact.facts, "result": asdict(result), "failure": failure}

        with nobody_else_publishes([writer for artifact in artifacts.values() for writer in artifact.writers]):
            for index, artifact in artifacts.items():
                with simulated.failing(index):
                    files, result, facts = _publish(artifact, manifests[index], partial(told, artifact))
                    results.append(result)
                    made += artifact.paths
                    if published:
                        published(facts, result, files)

    if error := simulated.error(made, _verdicts([*artifacts.values()])):
        error.results = results
        raise error
    return results


@dataclass(frozen=True)
class PassPreview:
    """What `perform` would do.

    Attributes:
      timestep, steps, duration: of the simulation [s].
      outputs: of each job.
    """

    timestep: float
    steps: int
    duration: float
    outputs: Sequence[Preview]


def preview(jobs: Sequence[Job[OutputResult]], reporter: Reporter | None = None) -> PassPreview:
    """What `perform` would do, with all names and numbers checked, and no step taken.

    Raises:
      MjrunError: it would fail at once.
    """
    with collected_warnings(), ExitStack() as stack:
        plans, context, _, _ = _plan(jobs, reporter or WarningReporter(), stack)
        timeline = context.timeline
        outputs = [plan.preview() for plan in plans]
        return PassPreview(float(timeline.timestep), timeline.steps, float(timeline.duration), outputs)


class _Pass(Generic[R]):
    """The simulation with its open outputs. An output that fails is left out from there on.

    Attributes:
      failures: path and error of outputs, by index.
      instability: what ended the simulation too early, if it did.
      wall: wall time of the simulation [s].
    """

    def __init__(self, plans: Sequence[Plan[R]], outputs: Sequence[AnyOutput[R]], context: Context, stepper: Stepper):
        self.failures: dict[int, tuple[str, MjrunError]] = {}
        self.instability: SimulationError | None = None
        self.wall = 0.0
        self._plans, self._context, self._stepper = plans, context, stepper
        self._until = max(plan.until for plan in plans)
        self._outputs = {i: output for i, output in enumerate(outputs) if isinstance(output, Output)}
        self._waiting = {i: output for i, output in enumerate(outputs) if not isinstance(output, Output)}

    def run(self, stack: ExitStack) -> None:
        """Runs the simulation once; outputs that wait for events look at its recording."""
        start = time.perf_counter()
        try:
            if len(self._plans) == len(self._outputs) == 1:
                self._run_alone(self._outputs[0])
            else:
                self._run_together(stack)
        except SimulationError as error:
            self.instability = error
        except EpisodeOver as error:
            raise UsageError(f"{error}, earlier than when it was simulated before: the policy acts at random") from None
        except MjrunError as error:
            if error not in [failure for _, failure in self.failures.values()]:  # a controller's, which concerns all
                raise
        self.wall = time.perf_counter() - start

    @property
    def episode(self) -> EpisodeResult | None:
        """What came of the policy's episode, as far as it was simulated; None without a policy."""
        episode, stepper = self._context.simulation.episode, self._stepper
        return episode.result(stepper) if episode and isinstance(stepper, EpisodeStepper) else None

    def finish(self) -> dict[int, Artifact[R]]:
        """The artifacts of the outputs that can be completed, by index."""
        artifacts: dict[int, Artifact[R]] = {}
        for index, output in sorted(self._outputs.items()):
            wanted = self.instability is None or self._plans[index].keep_partial
            if wanted and index not in self.failures:
                with self.failing(index):
                    artifacts[index] = output.finish()
        return artifacts

    @contextmanager
    def failing(self, index: int, path: str | None = None) -> Generator[None]:
        """Notes an error as a failure of this output, or of what belongs to it at `path`."""
        try:
            yield
        except MjrunError as error:
            self.failures[index] = path or self._plans[index].preview().path, error

    def error(self, made: Sequence[str], verdicts: Sequence[MjrunError]) -> MjrunError | None:
        """What to raise at the end, if anything, given the paths of what was made and what is not as it should be."""
        failures = [failure for _, failure in sorted(self.failures.items())]
        others: list[MjrunError] = [error for _, error in failures]
        main: MjrunError | None = None
        if failures and not made:
            main = others.pop(0)
            others += [self.instability] if self.instability else []
        elif self.instability:
            main = self.instability
            if made:
                main.add_note(f"kept, up to there: {listing(made)}")
        elif failures:
            main, others = PartlyDoneError(made, failures), []
        others += verdicts
        if main is None and others:
            main = others.pop(0)
        if main:
            for other in others:
                main.add_note(other.spelled(option))
        return main

    def _run_alone(self, output: Output[R]) -> None:
        try:
            output.simulate(self._stepper, self._until)
        except SimulationError:
            raise
        except MjrunError as error:
            if isinstance(error.__context__, SimulationError):
                self.instability = error.__context__
            self._fail([0], error)

    def _run_together(self, stack: ExitStack) -> None:
        taps = [tap for i, output in self._outputs.items() for tap in self._guarded(output.taps, [i])]
        if not self._waiting:
            observe(self._stepper, taps, self._until)
            return
        from mjrun.outputs.event_detection import EventDetector

        context = self._context
        conditions = {text for output in self._waiting.values() for text in output.conditions}
        detector = EventDetector(context.model, context.timeline, conditions, context.episode)
        stack.callback(detector.close)
        taps += self._guarded(detector.taps(self._until), list(self._waiting))
        observe(self._stepper, taps, self._until)

        scheduled = {i: output for i in self._waiting if (output := self._scheduled(i, detector.event_steps))}
        taps = [tap for i, output in scheduled.items() for tap in self._guarded(output.taps, [i])]
        observe(detector.replay(self._stepper.model), taps, self._until)
        self._outputs |= scheduled

    def _scheduled(self, index: int, event_steps: EventSteps) -> Output[R] | None:
        if index in self.failures:
            return None
        try:
            return self._waiting[index].schedule(event_steps)
        except MjrunError as error:
            self._fail([index], error)
            return None

    def _guarded(self, taps: Sequence[AnyTap], indices: Sequence[int]) -> list[AnyTap]:
        """`taps` whose first error fails the outputs with these indices, and ends them alone."""

        def take(tap: AnyTap, stepper: Stepper) -> None:
            if indices[0] in self.failures:
                return
            try:
                tap.take(stepper)
            except SimulationError:
                raise
            except MjrunError as error:
                self._fail(indices, error)

        return [Tap(tap.steps, lambda stepper: stepper, partial(take, tap)) for tap in taps]

    def _fail(self, indices: Sequence[int], error: MjrunError) -> None:
        """Notes a failure; with nothing left to make, the simulation need not go on."""
        for index in indices:
            self.failures[index] = self._plans[index].preview().path, error
        if len(self.failures) == len(self._plans):
            raise error


def _publish(
    artifact: Artifact[R],
    manifest: ManifestWriter | None,
    told: Callable[[Sequence[Path]], tuple[R, dict[str, object]]],
) -> tuple[list[Path], R, dict[str, object]]:
    """Publishes an output, and the manifest with it; returns its files, and what is `told` of them."""
    if manifest is None:
        files = artifact.publish()
        return files, *told(files)
    last: list[tuple[R, dict[str, object]]] = []

    def written(files: Sequence[Path]) -> ManifestWriter:
        last.append(told(files))
        manifest.write(last[0][1], files)
        return manifest

    files = artifact.publish(written)
    return files, *last[0]


def _verdicts(artifacts: Sequence[Artifact[R]]) -> list[MjrunError]:
    """What is complete, and not as it should be."""
    assertions = [message for artifact in artifacts for message in artifact.failed_assertions]
    differences = [message for artifact in artifacts for message in artifact.golden_differences]
    failed: list[MjrunError] = [FailedAssertionError(assertions)] if assertions else []
    return [*failed, *([GoldenDifferenceError(differences)] if differences else [])]


def _open(jobs: Sequence[Job[R]], reporter: Reporter, stack: ExitStack) -> _Pass[R]:
    plans, context, stepper, rendering = _plan(jobs, reporter, stack)
    for text in context.simulation.remarks(context.model):
        reporter.warn(text)
    return _Pass(plans, [plan.open(stack, rendering) for plan in plans], context, stepper)


def _plan(
    jobs: Sequence[Job[R]], reporter: Reporter, stack: ExitStack
) -> tuple[list[Plan[R]], Context, Stepper, SharedRendering]:
    """The plans of all jobs, once everything that can be wrong with them was looked for."""
    _check_one_simulation(jobs)
    rendering = stack.enter_context(SharedRendering())
    with _UsageErrors(jobs) as errors:
        _check_files(jobs, errors)
        tasks = [task for i, job in enumerate(jobs) if (task := errors.collect(i, job.task))]
        for i, task in enumerate(tasks):
            if task.renderer is not None:
                errors.collect(i, partial(rendering.detect, task.renderer))
    simulation = jobs[0].simulation
    with _UsageErrors(jobs) as errors:
        model = errors.collect(None, simulation.load)
    assert model
    with _UsageErrors(jobs) as errors:
        timeline = errors.collect(None, lambda: simulation.timeline(model))
    assert timeline
    context = Context(simulation, model, timeline, reporter, simulation.episode.columns if simulation.episode else None)
    with _UsageErrors(jobs) as errors:
        plans = [plan for i, task in enumerate(tasks) if (plan := errors.collect(i, partial(task.plan, context)))]
        stepper = errors.collect(None, lambda: simulation.stepper(_measured(model, plans)))
    assert stepper
    return plans, context, stepper, rendering


class _UsageErrors:
    """Collects what is wrong with jobs, so that all of it is raised together at the end of a `with` block."""

    def __init__(self, jobs: Sequence[Job[OutputResult]]) -> None:
        self._alone = len(jobs) == 1
        self._errors: list[tuple[int | None, UsageError]] = []

    def collect(self, index: int | None, function: Callable[[], T]) -> T | None:
        """What `function` returns; None if it raises a UsageError, which is that of the job with this index."""
        try:
            return function()
        except ControllerError:  # somebody's code, with its traceback
            raise
        except UsageError as error:
            self._errors.append((index, error))
            return None

    def __enter__(self) -> "_UsageErrors":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._errors:
            together = InvalidJobsError(self._errors)
            if self._alone and len(self._errors) == 1:
                raise self._errors[0][1] from together
            raise together


def _measured(model: mujoco.MjModel, plans: Sequence[Plan[OutputResult]]) -> mujoco.MjModel:
    """A copy of the model with everything switched on that any of `plans` measures."""
    measured = copy.copy(model)
    for plan in plans:
        measured.opt.enableflags |= plan.enable_flags
    return measured


def _check_one_simulation(jobs: Sequence[Job[OutputResult]]) -> None:
    if not jobs:
        raise UsageError("there is nothing to do: no output was asked for")
    if any(job.simulation is not jobs[0].simulation for job in jobs):
        raise UsageError("all outputs of one pass must be of the same simulation")


def _check_files(jobs: Sequence[Job[OutputResult]], errors: _UsageErrors) -> None:
    """No file is written twice, or read and written, unless its output is made of what was read."""
    reserved = ReservedFiles()
    rewritten = {os.path.realpath(path) for job in jobs for path in job.rewritten_inputs}
    inputs = [(path, f"the {what}, which is read") for what, path in jobs[0].simulation.inputs]
    known = {os.path.realpath(path) for path, _ in inputs}
    for what, path in (each for job in jobs for each in job.inputs):  # several jobs may read one
        if os.path.realpath(path) not in known:
            known.add(os.path.realpath(path))
            inputs.append((Path(path), f"the {what} table, which is read"))
    for path, owner in inputs:
        if os.path.realpath(path) not in rewritten:
            reserved.reserve_input(path, owner)
    for i, job in enumerate(jobs):
        for what, path in errors.collect(i, lambda job=job: job.files) or ():
            errors.collect(i, partial(_reserve, reserved, what, path))


def _reserve(reserved: ReservedFiles, name: str, path: str) -> None:
    with concerning(name):
        reserved.reserve(path, f"the {name}")
