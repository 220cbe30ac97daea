"""A keyframe: the model's XML with an instant of a simulation in it, to start from."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjrun.errors import FileError, UsageError, clean, listing, option, quoted
from mjrun.formats.keyframe_writer import KeyframeWriter
from mjrun.model.keyframe_text import key_names
from mjrun.model.names import names
from mjrun.options.keyframe import KeyframeOptions
from mjrun.options.option import options
from mjrun.outputs.output_files import named_files
from mjrun.outputs.shared_rendering import SharedRendering
from mjrun.outputs.task import Artifact, Context, Job, Output, OutputResult, PassSummary, Preview
from mjrun.physics.observe import Tap
from mjrun.simulation.manifest import origin
from mjrun.timeline import nearest

SUFFIX = ".xml"


@options
class Keyframe(KeyframeOptions, Job["KeyframeResult"]):
    """A keyframe of an instant of a simulation, in the model's XML: its options are keywords."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return named_files(output=self.output, manifest=self.manifest)

    @property
    def rewritten_inputs(self) -> Sequence[str]:
        """The model, which may get the keyframe itself."""
        return [self.output]

    def task(self) -> "KeyframeTask":
        """Its task, with the text of the model.

        Raises:
          UsageError: the output is no .xml file, or the model has no XML of its own.
          FileError: the model cannot be read.
        """
        if Path(self.output).suffix != SUFFIX:
            raise UsageError(
                f"{option('save_key')} {clean(self.output)}: a keyframe is saved in the model's XML, an {SUFFIX} file",
                path=("output",),
            )
        if not self.name.strip():
            raise UsageError(f"{option('save_key')}: a keyframe needs a name to start from it", path=("name",))
        source = self.simulation.source
        main = source.main_file
        if main is None or main.suffix != SUFFIX:
            model = clean(source.text) or "a compiled model"
            raise UsageError(
                f"{option('save_key')}: {model} has no {SUFFIX} file of its own that a keyframe could stand in"
            )
        return KeyframeTask(self, main)


@dataclass(frozen=True)
class KeyframeResult(OutputResult):
    """What keyframe was saved.

    Attributes:
      path: the file.
      name: of the key.
      time: simulated time [s] at which it is.
      step: the same as a step.
      wall: wall time of all [s].
      warnings: MuJoCo's.
    """

    name: str
    time: float
    step: int
    wall: float
    warnings: Sequence[str]


@dataclass(frozen=True)
class KeyframeTask:
    """A keyframe, with the main file of the model."""

    job: Keyframe
    source: Path

    renderer = None

    def plan(self, context: Context) -> "KeyframePlan":
        """Reads the XML, and looks for a place in it."""
        job = self.job
        try:
            xml = self.source.read_bytes()
            written = key_names(xml)
        except OSError as error:
            raise FileError(self.source, f"cannot be read: {error.strerror or error}") from None
        except ValueError as error:
            raise UsageError(f"{option('save_key')}: {clean(str(self.source))} cannot take a key: {error}") from None
        if job.name in names(context.model, "keyframe") and job.name not in written:
            raise UsageError(
                f"{option('save_key')}: the model has a keyframe {quoted(job.name)} in a file that it includes\n"
                f"give another name, as in {clean(job.output)}:NAME",
                path=("name",),
            )
        return KeyframePlan(job, self.source, xml, context)


@dataclass(frozen=True)
class KeyframePlan:
    """A keyframe of a model whose main file holds `xml`."""

    job: Keyframe
    source: Path
    xml: bytes
    context: Context

    keep_partial = False
    enable_flags = 0

    @property
    def until(self) -> int:
        job, timeline = self.job, self.context.timeline
        if job.step is not None:
            return job.step
        return timeline.steps if job.time is None else nearest(job.time / timeline.timestep)

    def preview(self) -> Preview:
        model = self.context.model
        numbers = 1 + model.nq + model.nv + model.na + model.nu + 7 * model.nmocap
        return Preview("keyframe", self.job.output, 1, "key", [numbers], f"{clean(self.job.name)}, {numbers} numbers")

    def open(self, stack: ExitStack, rendering: SharedRendering) -> "KeyframeOutput":
        job, context = self.job, self.context
        model, source = context.model, job.simulation.source
        if source.overrides:
            model = replace(source, overrides=()).load()
            overrides = listing([str(override) for override in source.overrides])
            context.reporter.warn(f"{job.output} has the model as it was: {overrides} is not in it")
        facts = origin(job, job.simulation, context.model, context.timeline)
        writer = stack.enter_context(KeyframeWriter(job.output, self.source, self.xml, job.name, model))
        return KeyframeOutput(self, facts, writer)


class KeyframeOutput(Output[KeyframeResult]):
    """A keyframe whose file is open."""

    def __init__(self, plan: KeyframePlan, facts: Mapping[str, object], writer: KeyframeWriter) -> None:
        self._plan, self._facts, self._writer = plan, facts, writer
        self._state = np.empty(0)
        self.taps = [Tap([plan.until], lambda stepper: stepper.state(), self._take)]

    def finish(self) -> Artifact[KeyframeResult]:
        context = self._plan.context
        for text in self._writer.write(context.model, self._state):
            context.reporter.warn(f"{clean(self._plan.job.output)}: {text}")
        self._writer.finish()
        return Artifact(self._facts, [self._writer], self._result)

    def _take(self, state: np.ndarray) -> None:
        self._state = state

    def _result(self, files: Sequence[Path], summary: PassSummary) -> KeyframeResult:
        plan = self._plan
        return KeyframeResult(
            path=plan.job.output,
            name=plan.job.name,
            time=float(plan.context.timeline.time(plan.until)),
            step=plan.until,
            wall=summary.wall,
            warnings=summary.warnings,
        )
