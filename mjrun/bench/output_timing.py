"""The wall time of a whole film and a whole trace."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from mjrun.bench.rollout_timing import Clock
from mjrun.job.simulation import Simulation
from mjrun.job.trace import Trace
from mjrun.job.video import Video
from mjrun.job.view import Drawing


class Silence:
    """A reporter that says nothing: what there is to say of a job, `bench` says itself."""

    def note(self, text: str) -> None:
        pass

    def warn(self, text: str) -> None:
        pass

    def progress(self, what: str, done: int, total: int) -> None:
        pass


@dataclass(frozen=True)
class Whole:
    """What all of a job took, loading included, but not the start of Python.

    Attributes:
      what: `video` or `trace`.
      simulated: time [s].
      count, unit: `frames` or `rows` that were made.
      seconds: wall time [s].
      simulation, rest: of which stepping, and all else, where the job tells; else None.
    """

    what: str
    simulated: float
    count: int
    unit: str
    seconds: float
    simulation: float | None = None
    rest: float | None = None


def whole_trace(simulation: Simulation, clock: Clock) -> Whole:
    """A trace of every step with the columns that it has by default, as CSV.

    Raises:
      MjrunError: it cannot be made.
    """
    with tempfile.TemporaryDirectory() as folder:
        job = Trace(simulation, str(Path(folder) / "trace.csv"))
        before = clock()
        made = job.run(Silence())
        took = clock() - before
    return Whole("trace", made.simulated, made.rows, "rows", took)


def whole_film(simulation: Simulation, drawing: Drawing | None, clock: Clock) -> Whole:
    """A film as it is by default, or of what `drawing` shows.

    Raises:
      MjrunError: it cannot be made.
    """
    with tempfile.TemporaryDirectory() as folder:
        job = Video(simulation, str(Path(folder) / "film.mp4"))
        if drawing is not None:
            same = ("camera", "view", "size", "visual", "renderer", "gl", "require_gpu")
            job = replace(job, **{name: getattr(drawing, name) for name in same})
        before = clock()
        made = job.run(Silence())
        took = clock() - before
    rest = made.wall - made.simulation_wall
    return Whole("video", made.simulated, made.frames, "frames", took, made.simulation_wall, rest)
