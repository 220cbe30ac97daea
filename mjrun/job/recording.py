"""A recording: the replayable states of a simulation, one for each step."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from mjrun.formats.recording_writer import RecordingWriter
from mjrun.job.manifest import origin
from mjrun.job.output_files import named
from mjrun.job.perform import Artifact, Context, Preview, Work, perform
from mjrun.job.simulation import Simulation
from mjrun.model import state
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.reporter import Reporter
from mjrun.sim.observe import Tap
from mjrun.sim.replay import sizes


@dataclass(frozen=True)
class Recording:
    """What to record.

    Args:
      simulation: what happens.
      output: a file (.npz).
      manifest: a file for what made the recording.
      command: the command line, for the manifest.
      keep_partial: keep the states before an instability.
    """

    simulation: Simulation
    output: str
    manifest: str | None = None
    command: str = ""
    keep_partial: bool = False

    @property
    def files(self) -> list[tuple[str, str]]:
        """Every file that it writes, with what it is."""
        return named(self, "output", "manifest")

    def run(self, reporter: Reporter | None = None) -> "RecordingResult":
        """Makes the recording. What can fail early fails before the first step.

        Raises:
          MjrunError: nothing was published, unless `keep_partial`, and an existing output is untouched.
        """
        return perform([self], reporter)[0]

    def work(self, stack: ExitStack) -> "RecordingWork":
        """The work that makes it."""
        return RecordingWork(self)


@dataclass(frozen=True)
class RecordingResult:
    """What recording was made.

    Attributes:
      path: where it is.
      states: how many it holds, one for each step and the first.
      size: numbers in a state.
      simulated: simulated time [s].
      wall: wall time of all [s].
      warnings: what MuJoCo warned of.
    """

    path: str
    states: int
    size: int
    simulated: float
    wall: float
    warnings: Sequence[str]


class RecordingWork(Work):
    """A recording in the making."""

    def __init__(self, job: Recording) -> None:
        self._job, self.keeps_partial = job, job.keep_partial

    def plan(self, ground: Context) -> None:
        self._ground, self.model, self.until = ground, ground.model, ground.timeline.steps

    def open(self, stack: ExitStack) -> None:
        job, ground = self._job, self._ground
        told = {"sizes": sizes(ground.model), "physics": physics_fingerprint(ground.model)}
        self._facts = {**origin(job, job.simulation, ground.model, ground.timeline), **told}
        self._sink = stack.enter_context(RecordingWriter(job.output, state.size(ground.model), self._facts))

    def taps(self) -> Sequence[Tap]:
        """The state at each step."""
        every = range(self.until + 1)
        return [Tap(every, lambda stepper: (stepper.step, stepper.state()), lambda row: self._sink.write(*row))]

    def outline(self) -> Preview:
        size = state.size(self._ground.model)
        return Preview("recording", self._job.output, self.until + 1, "states", [size], f"{size} numbers each")

    def finish(self, wall: float) -> Artifact:
        return Artifact(self._facts, self._sink.publish(), self._result)

    def _result(self, wall: float, heard: Sequence[str]) -> RecordingResult:
        timeline, size = self._ground.timeline, state.size(self._ground.model)
        simulated = float(timeline.time(self._sink.count - 1))
        return RecordingResult(self._job.output, self._sink.count, size, simulated, wall, heard)
