"""A recording: the replayable states of a simulation, one for each step."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mjrun.formats.recording_writer import RecordingWriter
from mjrun.model import state
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.options.option import options
from mjrun.options.trace import RecordingOptions
from mjrun.outputs.output_files import named_files
from mjrun.outputs.shared_rendering import SharedRendering
from mjrun.outputs.task import Artifact, Context, Job, Output, OutputResult, PassSummary, Preview
from mjrun.physics.observe import Tap
from mjrun.simulation.manifest import origin


@options
class Recording(RecordingOptions, Job["RecordingResult"]):
    """A recording of a simulation, the states of all steps: its options are keywords."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return named_files(output=self.output, manifest=self.manifest)

    def task(self) -> "RecordingTask":
        """Its task."""
        return RecordingTask(self)


@dataclass(frozen=True)
class RecordingResult(OutputResult):
    """What recording was made.

    Attributes:
      path: where it is.
      states: how many it holds, one for each step and the first.
      size: numbers in a state.
      simulated: simulated time [s].
      wall: wall time of all [s].
      warnings: MuJoCo's.
    """

    states: int
    size: int
    simulated: float
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class RecordingTask:
    """A recording, of which nothing can be decided without the model."""

    job: Recording

    renderer = None

    def plan(self, context: Context) -> "RecordingPlan":
        return RecordingPlan(self.job, context)


@dataclass(frozen=True)
class RecordingPlan:
    """A recording of a model."""

    job: Recording
    context: Context

    @property
    def keep_partial(self) -> bool:
        return self.job.keep_partial

    @property
    def enable_flags(self) -> int:
        return self.context.model.opt.enableflags

    @property
    def until(self) -> int:
        return self.context.timeline.steps

    def preview(self) -> Preview:
        size = state.size(self.context.model)
        return Preview("recording", self.job.output, self.until + 1, "states", [size], f"{size} numbers each")

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "RecordingOutput":
        job, model = self.job, self.context.model
        facts = {
            **origin(job, job.simulation, model, self.context.timeline),
            "sizes": state.sizes(model),
            "physics": physics_fingerprint(model),
        }
        writer = stack.enter_context(RecordingWriter(job.output, state.size(model), facts))
        return RecordingOutput(self, facts, writer)


class RecordingOutput(Output[RecordingResult]):
    """A recording whose file is open."""

    def __init__(self, plan: RecordingPlan, facts: Mapping[str, object], writer: RecordingWriter) -> None:
        self._plan, self._facts, self._writer = plan, facts, writer
        every = range(plan.until + 1)
        self.taps = [Tap(every, lambda stepper: (stepper.step, stepper.state()), lambda row: writer.write(*row))]

    def finish(self) -> Artifact[RecordingResult]:
        self._writer.finish()
        return Artifact(self._facts, [self._writer], self._result)

    def _result(self, files: Sequence[Path], summary: PassSummary) -> RecordingResult:
        context, count = self._plan.context, self._writer.count
        return RecordingResult(
            path=self._plan.job.output,
            states=count,
            size=state.size(context.model),
            simulated=float(context.timeline.time(count - 1)),
            wall=summary.wall,
            warnings=summary.warnings,
        )
