"""Keyframe output: the model's XML with an instant of the simulation added as a keyframe."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, file_errors, listing, option, quoted
from mjrun.formats.keyframe_writer import KeyframeWriter, key_names
from mjrun.model.names import names
from mjrun.options.option import options
from mjrun.options.output import KeyframeOptions
from mjrun.outputs import output
from mjrun.physics.simulation_loop import Tap
from mjrun.physics.stepper import Stepper
from mjrun.timeline import nearest

SUFFIX = ".xml"


@options
class Keyframe(KeyframeOptions, output.OutputRequest["KeyframeResult"]):
    """A keyframe with an instant of a simulation, saved in the model's XML: its options are keywords."""

    @property
    def rewritten_inputs(self) -> Sequence[str]:
        """The model file, which may be replaced by one with the keyframe."""
        return [self.output]

    def check(self) -> None:
        """Checks the file name, the key name, and that the model has XML.

        Raises:
          UsageError: the output is not an .xml file, or the model has no XML file.
        """
        if Path(self.output).suffix != SUFFIX:
            raise UsageError(
                f"{clean(self.output)}: keyframes are saved as XML; give an {SUFFIX} file",
                path=("output",),
            )
        if not self.name.strip():
            raise UsageError("the keyframe needs a name", path=("name",))
        if self.simulation.position_control is not None:
            reason = "the controls of the keyframe would be positions, and the file has no servos"
            raise UsageError(f"{option('position_control')} and a keyframe exclude each other: {reason}", ("output",))
        self._main_file()

    def _main_file(self) -> Path:
        """Returns the file that the keyframe is added to."""
        source = self.simulation.source
        main = source.main_file
        if main is None or main.suffix != SUFFIX:
            model = f"the model {clean(source.text)}" if source.text else "a compiled model"
            raise UsageError(f"{model} has no {SUFFIX} file to add a keyframe to")
        return main

    def plan(self, context: output.PassContext) -> "output.OutputPlan[KeyframeResult]":
        """Reads the XML and finds the place for the key.

        Raises:
          FileError: the model cannot be read.
          UsageError: the key cannot be added to the XML.
        """
        model, file = context.model, self._main_file()
        with file_errors(file):
            xml = file.read_bytes()
        try:
            written = key_names(xml)
        except ValueError as error:
            raise UsageError(f"cannot add a key to {clean(str(file))}: {error}") from None
        if self.name in names(model, "keyframe") and self.name not in written:
            raise UsageError(
                f"keyframe {quoted(self.name)} already exists in a file that the model includes\nchoose another name",
                path=("name",),
            )

        step, timeline = self.step, context.timeline
        if step is None:
            step = timeline.steps if self.time is None else nearest(self.time / timeline.timestep)
        numbers = 1 + model.nq + model.nv + model.na + model.nu + 7 * model.nmocap
        about = f"{clean(self.name)}, {numbers} numbers"
        preview = output.OutputPreview("keyframe", self.output, 1, "key", [numbers], about)
        return output.OutputPlan(
            preview=preview, until=step, open=lambda stack, _: OpenKeyframe(self, context, step, file, xml, stack)
        )


@dataclass(frozen=True)
class KeyframeResult(output.OutputResult):
    """The result of a keyframe output.

    Attributes:
      path: path of the file.
      name: name of the key.
      time: simulated time of the key [s].
      step: step of the key.
    """

    name: str
    time: float
    step: int


class OpenKeyframe(output.OpenOutput[KeyframeResult]):
    """A keyframe with an open file.

    Args:
      file, xml: the main file of the model and its content.
    """

    def __init__(
        self, request: Keyframe, context: output.PassContext, step: int, file: Path, xml: bytes, stack: ExitStack
    ) -> None:
        self._request, self._context, self._step = request, context, step
        self._state = np.empty(0)
        model, origin = context.model, request.simulation.source
        if origin.overrides:
            model = replace(origin, overrides=()).load()
            overrides = listing([str(override) for override in origin.overrides])
            context.reporter.warn(f"{request.output} holds the model without its overrides: {overrides} is left out")
        self._facts = context.facts(request)
        self.taps = [Tap([step], self._record)]
        self._writer = stack.enter_context(KeyframeWriter(request.output, file, xml, request.name, model))

    def finish(self, simulation_wall: float) -> output.FinishedOutput[KeyframeResult]:
        for text in self._writer.write(self._context.model, self._state):
            self._context.reporter.warn(f"{clean(self._request.output)}: {text}")
        result = KeyframeResult(
            path=self._request.output,
            name=self._request.name,
            time=float(self._context.timeline.time(self._step)),
            step=self._step,
        )
        self._writer.finish()
        return output.FinishedOutput(result, [self._writer], self._facts)

    def _record(self, stepper: Stepper) -> None:
        self._state = stepper.state()
