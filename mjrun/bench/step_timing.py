"""Wall time of steps in C and on Warp, from rollouts that are repeated as often as the budget allows."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mjrun.bench import block_timing
from mjrun.bench.block_timing import (
    BatchRolloutTimer,
    Clock,
    ReferenceWorkloadTimer,
    RolloutInputs,
    RolloutTimer,
    StepProfile,
    blocks_of,
)
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, SimulationError, UnknownNameError, UsageError, option
from mjrun.model.mujoco_globals import without_timers
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_engine import WarpWorlds
from mjrun.platform.cores import available_cores

MOST_STEPS = 10_000  # in a rollout, as in testspeed
LEAST_REPEATS, MOST_REPEATS = 7, 50  # 7 give a ratio of medians an interval of 95 %
BLOCK = 2e-3  # [s] of steps that are timed at once, far more than the clock and a call take
WARM_UP, ROLLOUTS, THREADS, PROFILE = 0.1, 0.4, 0.3, 0.1  # shares of the budget
PROFILES = 3
ROUND = (1, 2, 5)  # leading digits of round numbers
C, WARP = ENGINES = ("c", "warp")
ON_GPU, ON_CPU = 4096, 8  # default number of worlds
LEFT_OUT = "warp reports no phases and no arena; each world plays the noise of the one before it, a step ahead"


@dataclass(frozen=True)
class TimingBudget:
    """Budget of wall time and steps for the timing of one simulation.

    Attributes:
      seconds: approximate wall time [s].
      steps: steps in a rollout; None allows as many as fit the budget, at most `MOST_STEPS`.
      repeats: number of rollouts; None allows as many as fit the budget, within `LEAST_REPEATS` and `MOST_REPEATS`.
    """

    seconds: float
    steps: int | None = None
    repeats: int | None = None


@dataclass(frozen=True)
class ThreadTiming:
    """Timing of a number of threads, each of which steps a separate copy of the simulation.

    Attributes:
      threads: number of copies.
      step: wall time per step, counting the steps of all copies [s].
      reference_workload: the same for the reference workload on as many threads, alternating with the rollouts.
      steps_per_second, realtime_factor: rates of all copies together.
      scaling: steps per second, relative to one thread.
    """

    threads: int
    step: SampleStatistics
    reference_workload: SampleStatistics | None
    steps_per_second: float
    realtime_factor: float
    scaling: float


class StepTimer:
    """A timer of the steps of one simulation, rollout by rollout: call `warm_up`, `begin`, then `rollout` repeatedly.

    Args:
      make: function that returns the run with the controls of a number of steps.
      clock: wall time [s].
      workload: reference workload that is timed after each rollout.

    Attributes:
      run: run that is rolled out.
      steps: steps in a rollout: as many as the budget allows after `warm_up`, and the chosen number after `begin`.
      block, repeats: steps that are timed at once, and number of rollouts; set by `begin`.
      profile: average contents of a step; set by `begin`.
      rollouts: wall times per step of each block of each rollout so far [s].
      in_batch: whether it is stepped in C, where MuJoCo's warnings end a rollout.
      first: wall time of the first step, which compiles something [s]; None if nothing is compiled.
      overflows: sentences on the memory that an engine lacked.
    """

    run: RolloutInputs
    profile: StepProfile
    _roller: RolloutTimer
    _cost: float  # approximate wall time of a step [s]

    def __init__(
        self,
        make: Callable[[int], RolloutInputs],
        budget: TimingBudget,
        clock: Clock,
        workload: ReferenceWorkloadTimer | None = None,
    ) -> None:
        self.make, self.budget, self.clock, self.workload = make, budget, clock, workload
        self.rollouts = list[np.ndarray]()
        self.in_batch = True
        self.first: float | None = None
        self.overflows: Sequence[str] = ()
        self.steps, self.block, self.repeats = 0, 1, 0

    def warm_up(self) -> None:
        """Rolls out more and more steps to find how many the budget allows.

        Raises:
          SimulationError: the simulation is unstable, or MuJoCo could not complete a step.
        """
        most = self.budget.steps or MOST_STEPS
        self._cost = self._opened(most)
        share = ROLLOUTS * self.budget.seconds
        self.steps = self.budget.steps or rounded_down(share / (LEAST_REPEATS * self._cost), most)

    def begin(self, steps: int) -> None:
        """Chooses the number of rollouts of `steps` steps, and profiles one.

        Raises:
          SimulationError: the simulation is unstable, or MuJoCo could not complete a step.
        """
        self.steps = steps
        rollout = self._cost * steps
        self.repeats = self._affordable(ROLLOUTS, rollout)
        self.block = rounded_down(BLOCK / self._cost, steps)

        self.profile = self._profiled()
        if self.profile.warned and self.in_batch:
            self._leave_batch()

        if self.workload:
            self.workload.fit(rollout)

    def rollout(self) -> None:
        """Times one more rollout, and then the reference workload."""
        self.rollouts.append(self._rolled(self._roller, self.steps, self.block))
        if self.workload:
            self.workload.time()

    @property
    def step(self) -> SampleStatistics:
        """Wall time per step of one copy [s], over whole rollouts; percentiles are over blocks of steps."""
        copies = self._roller.copies
        whole = [self._mean(blocks) / copies for blocks in self.rollouts]
        return summarized(whole, (np.concatenate(self.rollouts) / copies).tolist())

    @property
    def reference_workload(self) -> SampleStatistics | None:
        """Wall time per step of the reference workload [s], one sample per rollout."""
        return self.workload and self.workload.step

    def threads(self, counts: Sequence[int]) -> list[ThreadTiming]:
        """Times the simulation on several threads, unless MuJoCo's warnings end a rollout."""
        return [self._threads(count) for count in counts] if self.in_batch else []

    def _opened(self, most: int) -> float:
        """Prepares rollouts of at most `most` steps, and returns the approximate wall time of a step [s]."""
        self.run = self.make(most)
        self._roller = BatchRolloutTimer(self.run)
        try:
            return self._longest(most)
        except block_timing.WarnedRolloutError:
            self.run.check(self.steps)  # raises if the simulation is unstable
            self._leave_batch()
            return self._longest(most)

    def _threads(self, count: int) -> ThreadTiming:
        one = self.step
        step, reference = (one, self.reference_workload) if count == 1 else self._timed_threads(count)
        speed = 1 / step.median
        timestep = self.run.model.opt.timestep
        return ThreadTiming(count, step, reference, speed, speed * timestep, one.median / step.median)

    def _timed_threads(self, count: int) -> tuple[SampleStatistics, SampleStatistics]:
        """Times `count` copies, and the reference workload on as many threads, per step."""
        roller, workload = BatchRolloutTimer(self.run, count), ReferenceWorkloadTimer(self.clock, count)
        rollout = self.step.median * self.steps * max(1, count / available_cores())
        workload.fit(rollout)
        self._rolled(roller, min(self.steps, 2 * self.block), self.block)  # wakes the threads up

        rollouts = list[np.ndarray]()
        for _ in range(self._affordable(THREADS, rollout)):
            # Threads meet at the end of each block: fewer, longer ones.
            rollouts.append(self._rolled(roller, self.steps, 10 * self.block))
            workload.time()

        whole = [self._mean(blocks, 10) / count for blocks in rollouts]
        return summarized(whole, (np.concatenate(rollouts) / count).tolist()), workload.step

    def _affordable(self, share: float, rollout: float) -> int:
        """Returns the number of rollouts, of `rollout` seconds each, that a share of the budget allows."""
        fitting = int(share * self.budget.seconds / rollout)
        return self.budget.repeats or min(max(fitting, LEAST_REPEATS), MOST_REPEATS)

    def _profiled(self) -> StepProfile:
        """Returns the least disturbed of several profiles."""
        profiles, spent = [block_timing.profile(self.run, self.steps)], 0.0
        while (phases := profiles[-1].phases) and len(profiles) < PROFILES:
            spent += phases.seconds * self.steps
            if spent > PROFILE * self.budget.seconds:
                break
            profiles.append(block_timing.profile(self.run, self.steps))
        return min(profiles, key=lambda one: one.phases.seconds if one.phases else 0.0)

    def _leave_batch(self) -> None:
        self.in_batch, self._roller = False, block_timing.PythonLoopRolloutTimer(self.run)

    def _longest(self, most: int) -> float:
        """Rolls out more and more steps, and returns the wall time of a step in the last and longest rollout [s]."""
        self.steps, cost, spent = 0, 0.0, 0.0
        while self.steps < most and spent < WARM_UP * self.budget.seconds:
            self.steps = min(max(1, 2 * self.steps), most)
            cost = float(self._rolled(self._roller, self.steps, self.steps)[0])
            spent += cost * self.steps
        return cost

    def _rolled(self, roller: RolloutTimer, steps: int, block: int) -> np.ndarray:
        """Times every block, per step [s]."""
        with without_timers():
            spent = roller.seconds(steps, block, self.clock)
        return spent / self._sizes(steps, block)

    def _mean(self, per_step: np.ndarray, blocks: int = 1) -> float:
        """Returns the wall time per step of a rollout [s]."""
        return float((per_step * self._sizes(self.steps, blocks * self.block)).sum() / self.steps)

    def _sizes(self, steps: int, block: int) -> np.ndarray:
        return np.array([min(block, steps - first) for first in range(0, steps, block)])


def rounded_down(value: float, most: int) -> int:
    """Rounds down to 1, 2, 5, 10, 20, … but at least to 1; returns `most` for larger values."""
    if value >= most:
        return most
    scale = 10 ** int(np.floor(np.log10(max(value, 1))))
    return max([1, *(digit * scale for digit in ROUND if digit * scale <= value)])


class WarpSettings:
    """Settings of a timing on Warp: the device, the number of worlds, and the sizes of their arrays.

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

    def open(self, run: RolloutInputs) -> "WarpRolloutTimer":
        """Opens worlds that start like `run`.

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not this number of worlds.
        """
        starts = np.tile(run.start, (self.worlds, 1))
        return WarpRolloutTimer(WarpWorlds(self._device, run.model, starts, self.nconmax, self.njmax), run)


class WarpRolloutTimer:
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
        """Times each block of all worlds together [s]; see `RolloutTimer`."""
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

    _worlds: WarpRolloutTimer

    def __init__(
        self, make: Callable[[int], RolloutInputs], budget: TimingBudget, clock: Clock, warp: WarpSettings
    ) -> None:
        super().__init__(make, budget, clock)
        self._warp = warp

    def threads(self, counts: Sequence[int]) -> list[ThreadTiming]:
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
