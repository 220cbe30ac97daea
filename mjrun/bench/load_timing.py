"""The wall time of loading a model: reading, parsing, compiling."""

from dataclasses import dataclass

import mujoco

from mjrun.bench.rollout_timing import Clock
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.confinement.sandbox import confined_load
from mjrun.model.compilation import lengthen_buffers
from mjrun.model.override import apply
from mjrun.model.source import Source
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
