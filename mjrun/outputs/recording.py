"""A recording: the replayable states of a simulation, one for each step."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mjrun.formats.recording import RecordingWriter
from mjrun.model import state
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.options.option import options
from mjrun.options.trace import RecordingOptions
from mjrun.outputs.output import (
    Context,
    EventSteps,
    Job,
    Output,
    OutputResult,
    PassSummary,
    Plan,
    Preview,
    SharedRendering,
)
from mjrun.outputs.output_files import named_files
from mjrun.physics.observe import AnyTap, Tap


@options
class Recording(RecordingOptions, Job["RecordingResult"]):
    """A recording of a simulation, the states of all steps: its options are keywords."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return named_files(output=self.output, manifest=self.manifest)

    @property
    def keeps_partial(self) -> bool:
        return self.keep_partial

    def plan(self, context: Context) -> "Plan[RecordingResult]":
        """The plan; a recording has nothing to check."""
        size, steps = state.size(context.model), context.timeline.steps
        preview = Preview("recording", self.output, steps + 1, "states", [size], f"{size} numbers each")
        return Plan(preview, steps, partial(RecordingOutput, self, context))


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


class RecordingOutput(Output[RecordingResult]):
    """A recording whose file is open."""

    def __init__(self, job: Recording, context: Context, stack: ExitStack, _: SharedRendering) -> None:
        model = context.model
        self._job, self._context = job, context
        self.facts = {**context.facts(job), "sizes": state.sizes(model), "physics": physics_fingerprint(model)}
        self._writer = stack.enter_context(RecordingWriter(job.output, state.size(model), self.facts))

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        every = range(self._context.timeline.steps + 1)
        return [Tap(every, lambda stepper: (stepper.step, stepper.state()), lambda row: self._writer.write(*row))]

    def finish(self) -> Sequence[RecordingWriter]:
        self._writer.finish()
        return [self._writer]

    def result(self, files: Sequence[Path], summary: PassSummary) -> RecordingResult:
        count = self._writer.count
        return RecordingResult(
            path=self._job.output,
            states=count,
            size=state.size(self._context.model),
            simulated=float(self._context.timeline.time(count - 1)),
            wall=summary.wall,
            warnings=summary.warnings,
        )
