"""The wall time of getting a model: reading, parsing, compiling."""

from dataclasses import dataclass

import mujoco

from mjrun.bench.rollout_timing import Clock
from mjrun.bench.statistics import Stat, stat
from mjrun.model.override import apply
from mjrun.model.source import Source

REPEATS = 3
PARSED = (".xml", ".urdf")


@dataclass(frozen=True)
class Load:
    """What it took to get the model [s].

    Attributes:
      first: all of it, the first time in this process.
      parse, compile: from the file to an MjSpec, and from there to an MjModel, again and again, with MuJoCo's cache of
        assets warm; None for what is not MJCF or URDF.
    """

    first: float
    parse: Stat | None = None
    compile: Stat | None = None


def timed_load(source: Source, clock: Clock) -> tuple[mujoco.MjModel, Load]:
    """The compiled model, and what it took.

    Raises:
      ModelError: it cannot be loaded.
      UsageError: an override names nothing, or its value does not fit.
    """
    before = clock()
    model = source.load()
    first = clock() - before
    if source.main_file is None or source.main_file.suffix not in PARSED:
        return model, Load(first)
    parses, compiles = [], []
    for _ in range(REPEATS):
        before = clock()
        spec = mujoco.MjSpec.from_file(str(source.main_file))
        parsed = clock()
        for setting in source.settings:
            apply(spec, setting)
        ready = clock()
        spec.compile()
        compiles.append(clock() - ready)
        parses.append(parsed - before)
    return model, Load(first, stat(parses), stat(compiles))
