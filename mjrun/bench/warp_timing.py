"""Wall time of steps of many Warp worlds at once, and the options of engines."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mjrun.bench.block_timing import Clock, RolloutInputs, StepProfile, blocks_of
from mjrun.bench.step_timing import StepTimer, ThreadScaling, TimingBudget
from mjrun.errors import BadValueError, SimulationError, UnknownNameError, UsageError, option
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_engine import WarpWorlds

C, WARP = ENGINES = ("c", "warp")
ON_GPU, ON_CPU = 4096, 8  # default number of worlds
LEFT_OUT = "warp reports no phases and no arena; each world plays the noise of the one before it, a step ahead"


class WarpOptions:
    """Number of worlds to time, and their device.

    Args:
      device, nconmax, njmax: see `WarpDevice` and `WarpWorlds`.
      worlds: number of worlds; None is `ON_GPU` or `ON_CPU`.

    Attributes:
      device, device_name, version: alias, name and version of the device.
      worlds: number of worlds.
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
        """Opens worlds that start like `run`.

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not this number of worlds.
        """
        starts = np.tile(run.start, (self.worlds, 1))
        return WarpRoller(WarpWorlds(self._device, run.model, starts, self.nconmax, self.njmax), run)


class WarpRoller:
    """A timer of the rollouts of worlds.

    Each world plays the controls of the run a step ahead of the one before it, so that no two move alike; the first
    plays them unchanged. The run therefore has controls for additional steps, one for each world. Without controls, all
    worlds are alike. Wall times include the transfer of controls within the memory of the device.

    Attributes:
      copies: number of worlds.
    """

    def __init__(self, worlds: WarpWorlds, run: RolloutInputs) -> None:
        self.copies = worlds.count
        self._worlds, self._run = worlds, run
        with worlds.active():
            self._controls = None if run.controls is None else worlds.upload(run.controls)
        self._contacts = self._constraints = 0  # largest demand

    def first(self, clock: Clock) -> float:
        """Takes the first step, for which Warp compiles what it has not cached.

        Returns:
          Its wall time [s].

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not this number of worlds.
        """
        before = clock()
        self._worlds.compile()
        return clock() - before

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        """Times each block of all worlds together [s]; see `Roller`."""
        times = list[float]()
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
        """Rolls out `steps` steps, and inspects each; too slow to be timed itself.

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
        """Returns sentences on the memory that the profiled rollout lacked, and the options to raise."""
        return self._worlds.overflows(self._contacts, self._constraints)

    def _advance(self, step: int) -> None:
        if self._controls is not None:
            # The rows from `step` on, one for each world, are adjacent.
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
                f"{steps * timestep:.9g} s\na smaller {option('timestep')} than {timestep:g} s may help; "
                "mujoco_warp computes in single precision",
            )


class WarpStepTimer(StepTimer):
    """A timer of the steps of many worlds, rollout by rollout; `step` is that of one world."""

    _worlds: WarpRoller

    def __init__(
        self, make: Callable[[int], RolloutInputs], budget: TimingBudget, clock: Clock, warp: WarpOptions
    ) -> None:
        super().__init__(make, budget, clock)
        self._warp = warp

    def threads(self, counts: Sequence[int]) -> list[ThreadScaling]:
        return []

    def _opened(self, most: int) -> float:
        self.run = self.make(most + self._warp.worlds)  # each world is a step ahead of the one before it
        self._roller = self._worlds = self._warp.open(self.run)
        self.first = self._worlds.first(self.clock)
        return self._longest(most)

    def _profiled(self) -> StepProfile:
        profile = self._worlds.profile(self.steps)
        self.overflows = self._worlds.overflows()
        return profile


def check_engine(engine: str, of_c: Mapping[str, bool], of_warp: Mapping[str, int | str | None]) -> None:
    """Refuses options that the engine does not support.

    Args:
      of_c: options that only MuJoCo itself supports, and whether they are used.
      of_warp: options of mujoco_warp, and their values.

    Raises:
      UsageError: names the option.
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
                    f"{option(name)} requires {engine_option} {C}; {engine_option} {WARP} times only steps, "
                    f"of {option('worlds')} simulations at once"
                )
    else:
        for name, value in of_warp.items():
            if value is not None and (name, value) != ("worlds", 1):
                raise UsageError(
                    f"{option(name)} requires {engine_option} {WARP}; in {C}, {option('threads')} runs copies"
                )
