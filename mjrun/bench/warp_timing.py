"""The wall time of steps of many worlds at once; and which engine takes the steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mjrun.bench.step_timing import Stepping, Threads
from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.sim.rollout_timing import Clock, Profile, Run

C, WARP = ENGINES = ("c", "warp")
LEFT_OUT = "warp tells of no phases and no arena; each world plays the noise of the one before it, a step ahead"


class Worlds(Protocol):
    """Copies of a run that are stepped at once, as `mjrun.sim.warp_engine` has them."""

    copies: int

    def first(self, clock: Clock) -> float: ...

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray: ...

    def profile(self, steps: int) -> Profile: ...

    def overflows(self) -> Sequence[str]: ...


class WorldsEngine(Protocol):
    """What makes them."""

    worlds: int

    def open(self, run: Run) -> Worlds: ...


@dataclass
class WorldsStepping(Stepping):
    """The steps of many worlds being timed, rollout by rollout. `step` is that of one world.

    Attributes:
      engine: takes the steps.
    """

    engine: WorldsEngine = field(kw_only=True)
    _worlds: Worlds = field(init=False)

    def threads(self, counts: Sequence[int]) -> list[Threads]:
        return []

    def _opened(self, most: int) -> float:
        self.run = self.make(most + self.engine.worlds)  # each world is a step ahead of the one before it
        self._roller = self._worlds = self.engine.open(self.run)
        self.first = self._worlds.first(self.clock)
        return self._longest(most)

    def _profiled(self) -> Profile:
        found = self._worlds.profile(self.steps)
        self.overflows = self._worlds.overflows()
        return found


def check_engine(engine: str, of_c: Mapping[str, bool], of_warp: Mapping[str, int | str | None]) -> None:
    """Refuses what the engine cannot do.

    Args:
      of_c: options, and whether they ask for what only MuJoCo itself can do.
      of_warp: options of mujoco_warp, and their values.

    Raises:
      UsageError: says which option.
    """
    if engine not in ENGINES:
        raise UnknownNameError("engine", engine, ENGINES)
    for flag, value in of_warp.items():
        if isinstance(value, int) and value < 1:
            raise BadValueError(flag, value, "a positive whole number")
    if engine == WARP:
        for flag, asked in of_c.items():
            if asked:
                raise UsageError(
                    f"{flag} is for --engine {C}; --engine {WARP} times steps alone, of --worlds N at once"
                )
    else:
        for flag, value in of_warp.items():
            if value is not None and (flag, value) != ("--worlds", 1):
                raise UsageError(f"{flag} is for --engine {WARP}; in {C}, --threads N runs copies side by side")
