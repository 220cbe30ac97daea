"""The wall time of loading a model, and of a whole trace and a whole video from the model to the finished file."""

from dataclasses import dataclass, replace

import mujoco

from mjrun.bench.rollout_timing import Clock
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.confinement.sandbox import confined_load
from mjrun.formats.temporary_output import scratch_folder
from mjrun.model.compilation import lengthen_buffers
from mjrun.model.override import apply
from mjrun.model.source import Source
from mjrun.options.view import ViewOptions
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.reporter import WarningReporter
from mjrun.simulation.simulation import Simulation
from mjrun.suffixes import XML

REPEATS = 3


@dataclass(frozen=True)
class LoadTiming:
    """Wall time to load the model [s].

    Attributes:
      first: in all, the first time in this process.
      parse, compile: from the file to an MjSpec, and from there to an MjModel, repeated with MuJoCo's cache of assets
        warm; None for other files than MJCF and URDF.
    """

    first: float
    parse: SampleStatistics | None = None
    compile: SampleStatistics | None = None


def timed_load(source: Source, clock: Clock) -> tuple[mujoco.MjModel, LoadTiming]:
    """The compiled model, and the wall time of loading it.

    Raises:
      ModelError: it cannot be loaded.
      UsageError: an override names nothing, or its value does not fit.
    """
    return confined_load(lambda: _timed_load(source, clock))


def _timed_load(source: Source, clock: Clock) -> tuple[mujoco.MjModel, LoadTiming]:
    before = clock()
    model = source.load()
    first = clock() - before

    if source.main_file is None or source.main_file.suffix not in XML:
        return model, LoadTiming(first)
    parses, compiles = [], []
    for _ in range(REPEATS):
        before = clock()
        spec = mujoco.MjSpec.from_file(str(source.main_file))
        parsed = clock()
        for override in source.overrides:
            apply(spec, override)
        lengthen_buffers(spec, source.overrides)
        ready = clock()
        spec.compile()
        compiles.append(clock() - ready)
        parses.append(parsed - before)
    return model, LoadTiming(first, summarized(parses), summarized(compiles))


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
