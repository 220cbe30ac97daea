"""Recording output: the replayable states of a simulation, one for each step."""

from contextlib import ExitStack

from mjrun.dataclass import dataclass
from mjrun.formats.recording import RecordingWriter
from mjrun.model import state
from mjrun.model.source import physics_fingerprint
from mjrun.options.option import options
from mjrun.options.trace import RecordingOptions
from mjrun.outputs import output
from mjrun.physics.simulation_loop import Tap
from mjrun.physics.stepper import Stepper


@options
class Recording(RecordingOptions, output.OutputRequest["RecordingResult"]):
    """A recording of the states of all steps of a simulation: its options are keywords."""

    @property
    def keeps_partial(self) -> bool:
        return self.keep_partial

    def plan(self, context: output.PassContext) -> "output.OutputPlan[RecordingResult]":
        """Plans the recording; there is nothing to check."""
        size, steps = state.size(context.model), context.timeline.steps
        preview = output.OutputPreview("recording", self.output, steps + 1, "states", [size], f"{size} numbers each")
        return output.OutputPlan(
            preview=preview, until=steps, open=lambda stack, _: OpenRecording(self, context, stack)
        )


@dataclass(frozen=True)
class RecordingResult(output.OutputResult):
    """The result of a recording output.

    Attributes:
      path: path of the recording.
      states: the number of states: one for each step, and the first.
      size: numbers in a state.
      simulated: simulated time [s].
    """

    states: int
    size: int
    simulated: float


class OpenRecording(output.OpenOutput[RecordingResult]):
    """A recording with an open file."""

    def __init__(self, request: Recording, context: output.PassContext, stack: ExitStack) -> None:
        model = context.model
        self._request, self._context = request, context
        self._facts = {**context.facts(request), **state.layout(model), "physics": physics_fingerprint(model)}
        self._writer = stack.enter_context(RecordingWriter(request.output, state.size(model), self._facts))
        self.taps = [Tap(range(context.timeline.steps + 1), self._record)]

    def finish(self, simulation_wall: float) -> output.FinishedOutput[RecordingResult]:
        count = self._writer.count
        result = RecordingResult(
            path=self._request.output,
            states=count,
            size=state.size(self._context.model),
            simulated=float(self._context.timeline.time(count - 1)),
        )
        self._writer.finish()
        return output.FinishedOutput(result, [self._writer], self._facts)

    def _record(self, stepper: Stepper) -> None:
        self._writer.write(stepper.step, stepper.state())
