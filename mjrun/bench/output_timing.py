"""The wall time of a whole trace and a whole video, from loading the model to the finished file."""

from dataclasses import dataclass, replace

from mjrun.bench.rollout_timing import Clock
from mjrun.formats.temporary_output import scratch_folder
from mjrun.options.view import ViewOptions
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.reporter import WarningReporter
from mjrun.simulation.simulation import Simulation


class SilentReporter(WarningReporter):
    """Reports nothing: `bench` itself says what there is to say of the model."""

    def warn(self, text: str) -> None:
        pass


@dataclass(frozen=True)
class OutputTiming:
    """What a whole output took, loading the model included, but not the start of Python.

    Attributes:
      what: `video` or `trace`.
      simulated: time [s].
      count, unit: number of `frames` or `rows`.
      seconds: wall time [s].
      simulation, rest: wall time of stepping, and of all else [s]; None for a trace.
    """

    what: str
    simulated: float
    count: int
    unit: str
    seconds: float
    simulation: float | None = None
    rest: float | None = None


def timed_trace(simulation: Simulation, clock: Clock) -> OutputTiming:
    """A trace of every step, with the default columns, as CSV.

    Raises:
      MjrunError: it cannot be made.
    """
    with scratch_folder() as folder:
        trace = Trace(simulation, str(folder / "trace.csv"))
        before = clock()
        result = trace.run(SilentReporter())
        seconds = clock() - before
    return OutputTiming("trace", result.simulated, result.rows, "rows", seconds)


def timed_video(simulation: Simulation, drawing: ViewOptions, clock: Clock) -> OutputTiming:
    """A video of what `drawing` shows.

    Raises:
      MjrunError: it cannot be made.
    """
    with scratch_folder() as folder:
        video = replace(
            Video(simulation, str(folder / "video.mp4")),
            camera=drawing.camera,
            view=drawing.view,
            size=drawing.size,
            quality=drawing.quality,
            renderer=drawing.renderer,
            gl=drawing.gl,
            require_gpu=drawing.require_gpu,
        )
        before = clock()
        result = video.run(SilentReporter())
        seconds = clock() - before
    rest = result.wall - result.simulation_wall
    return OutputTiming("video", result.simulated, result.frames, "frames", seconds, result.simulation_wall, rest)
