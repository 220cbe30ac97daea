"""The wall time of steps of many worlds at once; and which engine takes the steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.bench.rollout_timing import Clock, RolloutInputs, StepProfile, blocks_of
from mjrun.bench.step_timing import StepTimer, ThreadScaling
from mjrun.errors import BadValueError, SimulationError, UnknownNameError, UsageError, option
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_engine import WarpWorlds

C, WARP = ENGINES = ("c", "warp")
ON_GPU, ON_CPU = 4096, 8  # worlds, if nobody says how many
LEFT_OUT = "warp tells of no phases and no arena; each world plays the noise of the one before it, a step ahead"


class WarpOptions:
    """How many worlds to time, on which device.

    Args:
      device, nconmax, njmax: as `WarpDevice` and `WarpWorlds` have them.
      worlds: how many; `ON_GPU` or `ON_CPU` when None.

    Attributes:
      device, device_name, version: of the device.
      worlds: as given, or as chosen.
    """

    def __init__(
        self,
        device: str | None = None,
        worlds: int | None = None,
        nconmax: int | None = None,
        njmax: int | None = None,
    ) -> None:
        self._device = WarpDevice(device)
        self.device, self.device_name, self.version = self._device.alias, self._device.name, self._device.version
        self.worlds = worlds or (ON_GPU if self._device.is_gpu else ON_CPU)
        self.nconmax, self.njmax = nconmax, njmax

    def open(self, run: RolloutInputs) -> "WarpRoller":
        """Worlds that start as `run` does.

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not so many worlds.
        """
        starts = np.tile(run.start, (self.worlds, 1))
        return WarpRoller(WarpWorlds(self._device, run.model, starts, self.nconmax, self.njmax), run)


class WarpRoller:
    """Rolls worlds out and times them.

    Each plays the controls of the run a step ahead of the one before it, so that no two move alike; the first plays
    them as they are. The run has controls for that: of as many steps more as there are worlds. Without controls all
    worlds are alike. Wall times include handing controls over, from memory of the device's own.

    Attributes:
      copies: how many worlds.
    """

    def __init__(self, worlds: WarpWorlds, run: RolloutInputs) -> None:
        self.copies = worlds.count
        self._worlds, self._run = worlds, run
        with worlds.active():
            self._controls = None if run.controls is None else worlds.upload(run.controls)
        self._contacts = self._constraints = 0  # the most that were needed at once

    def first(self, clock: Clock) -> float:
        """Takes the first step, for which Warp compiles what it has not cached.

        Returns:
          Its wall time [s].

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not so many worlds.
        """
        before = clock()
        self._worlds.compile()
        return clock() - before

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        """As `Roller` has it: wall time of each block, of all worlds together [s]."""
        times = []
        with self._worlds.active():
            self._worlds.restart()
            for first, count in blocks_of(steps, block):
                before = clock()
                for step in range(first, first + count):
                    self._advance(step)
                self._worlds.wait()
                times.append(clock() - before)
        return np.array(times)

    def profile(self, steps: int) -> StepProfile:
        """Rolls `steps` steps out, looking at each. Not to be timed from outside.

        Raises:
          SimulationError: some worlds have become unstable.
        """
        contacts = constraints = iterations = 0.0
        self._contacts = self._constraints = 0
        with self._worlds.active():
            self._worlds.restart()
            for step in range(steps):
                self._advance(step)
                demand = self._worlds.demand()
                self._contacts = max(self._contacts, demand.contacts, demand.candidates)
                self._constraints = max(self._constraints, int(demand.constraints.max()))
                contacts += demand.contacts / self.copies
                constraints += float(demand.constraints.mean())
                iterations += float(demand.iterations.mean())
            self._check(steps)
        return StepProfile(contacts / steps, constraints / steps, iterations / steps, None, None, None, warned=False)

    def overflows(self) -> Sequence[str]:
        """What did not fit in the rollout that was profiled, and what to raise, a sentence each."""
        return self._worlds.overflows(self._contacts, self._constraints)

    def _advance(self, step: int) -> None:
        if self._controls is not None:
            # Rows `step` and on, one for each world, lie in a row.
            self._worlds.set_controls(self._controls, step * self._run.model.nu)
        self._worlds.step()

    def _check(self, steps: int) -> None:
        """Raises SimulationError if a world has become unstable."""
        bad = int(self._worlds.unstable().sum())
        if bad:
            timestep = self._run.model.opt.timestep
            raise SimulationError(
                steps,
                steps * timestep,
                f"the simulation became unstable in {bad} of {self.copies} worlds within {steps} steps, "
                f"{steps * timestep:.9g} s\na smaller {option('timestep')} than {timestep:g} s may cure it; "
                "mujoco_warp computes in single precision",
            )


@dataclass
class WarpStepTimer(StepTimer):
    """The steps of many worlds being timed, rollout by rollout. `step` is that of one world.

    Attributes:
      warp: how many worlds, and where.
    """

    warp: WarpOptions = field(kw_only=True)
    _worlds: WarpRoller = field(init=False)

    def threads(self, counts: Sequence[int]) -> list[ThreadScaling]:
        return []

    def _opened(self, most: int) -> float:
        self.run = self.make(most + self.warp.worlds)  # each world is a step ahead of the one before it
        self._roller = self._worlds = self.warp.open(self.run)
        self.first = self._worlds.first(self.clock)
        return self._longest(most)

    def _profiled(self) -> StepProfile:
        profile = self._worlds.profile(self.steps)
        self.overflows = self._worlds.overflows()
        return profile


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
    for name, value in of_warp.items():
        if isinstance(value, int) and value < 1:
            raise BadValueError(option(name), value, "a positive whole number")
    engine_option = option("engine")
    if engine == WARP:
        for name, asked in of_c.items():
            if asked:
                raise UsageError(
                    f"{option(name)} is for {engine_option} {C}; {engine_option} {WARP} times steps alone, "
                    f"of as many simulations at once as {option('worlds')} says"
                )
    else:
        for name, value in of_warp.items():
            if value is not None and (name, value) != ("worlds", 1):
                raise UsageError(
                    f"{option(name)} is for {engine_option} {WARP}; in {C}, {option('threads')} runs copies"
                )
