"""The wall time of steps: rollouts of one simulation, repeated as often as the budget allows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.bench.reference_workload import ReferenceWorkload
from mjrun.bench.rollout_timing import (
    BatchRoller,
    Clock,
    LoopRoller,
    Roller,
    RolloutInputs,
    StepProfile,
    StoppedError,
    profile,
)
from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.model.mujoco_globals import without_timers
from mjrun.platform.cores import available_cores

MOST_STEPS = 10_000  # of one rollout; testspeed's own
LEAST_REPEATS, MOST_REPEATS = 7, 50  # 7 give a ratio of medians an interval of 95 %
BLOCK = 2e-3  # [s] of steps that are timed at once, beside which what the clock and a call take is nothing
WARM_UP, ROLLOUTS, THREADS, PROFILE = 0.1, 0.4, 0.3, 0.1  # shares of the budget
PROFILES = 3
ROUND = (1, 2, 5)  # leading digits of round numbers


@dataclass(frozen=True)
class TimingBudget:
    """How much wall time, and how many steps, the timing of one simulation may take.

    Attributes:
      seconds: wall time that may be spent, more or less.
      steps: of one rollout; as many as the budget allows, at most `MOST_STEPS`, when None.
      repeats: of the rollout; as many as the budget allows, within `LEAST_REPEATS` and `MOST_REPEATS`, when None.
    """

    seconds: float
    steps: int | None = None
    repeats: int | None = None


@dataclass(frozen=True)
class ThreadScaling:
    """Independent copies of the simulation, a thread each.

    Attributes:
      threads: number of copies.
      step: wall time per step, counting the steps of all copies [s].
      reference_workload: the same of the reference workload on as many threads, in turn with the rollouts.
      steps_per_second, realtime_factor: of all copies together.
      scaling: steps per second, relative to one thread.
    """

    threads: int
    step: SampleStatistics
    reference_workload: SampleStatistics | None
    steps_per_second: float
    realtime_factor: float
    scaling: float


@dataclass
class StepTimer:
    """Times the steps of one simulation, rollout by rollout: `warm_up`, `begin`, then `rollout` again and again.

    Args:
      make: the run with the controls of so many steps.
      clock: wall time [s].
      workload: timed after each rollout; None without.

    Attributes:
      run: what is rolled out.
      steps: of a rollout; those that the budget allows, from `warm_up` on, and those that are taken, from `begin` on.
      block, repeats: steps that are timed at once, and rollouts; known from `begin` on.
      profile: what a step consists of; known from `begin` on.
      rollouts: wall times per step of each block of each rollout so far [s].
      in_batch: whether it is stepped in C, where MuJoCo's warnings end a rollout.
      first: wall time of the first step, which compiles something [s]; None where nothing is compiled.
      overflows: what an engine had no room for, a sentence each.
    """

    make: Callable[[int], RolloutInputs]
    budget: TimingBudget
    clock: Clock
    workload: ReferenceWorkload | None = None
    rollouts: list[np.ndarray] = field(default_factory=list, init=False)
    in_batch: bool = field(default=True, init=False)
    first: float | None = field(default=None, init=False)
    overflows: Sequence[str] = field(default=(), init=False)
    steps: int = field(default=0, init=False)
    block: int = field(default=1, init=False)
    repeats: int = field(default=0, init=False)
    run: RolloutInputs = field(init=False)
    _roller: Roller = field(init=False)
    _cost: float = field(init=False)  # of a step [s], roughly
    profile: StepProfile = field(init=False)

    def warm_up(self) -> None:
        """Rolls out more and more steps, until it is known how many of them the budget allows.

        Raises:
          SimulationError: the simulation is unstable, or MuJoCo gave up.
        """
        most = self.budget.steps or MOST_STEPS
        self._cost = self._opened(most)
        share = ROLLOUTS * self.budget.seconds
        self.steps = self.budget.steps or rounded_down(share / (LEAST_REPEATS * self._cost), most)

    def begin(self, steps: int) -> None:
        """Chooses how often rollouts of `steps` steps are timed, and profiles one.

        Raises:
          SimulationError: the simulation is unstable, or MuJoCo gave up.
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
        """Wall time per step of one copy [s]: of whole rollouts, with percentiles over blocks of steps."""
        copies = self._roller.copies
        whole = [self._mean(blocks) / copies for blocks in self.rollouts]
        return summarized(whole, (np.concatenate(self.rollouts) / copies).tolist())

    @property
    def reference_workload(self) -> SampleStatistics | None:
        """Wall time per step of the reference workload [s], a sample for each rollout."""
        return self.workload and self.workload.step

    def threads(self, counts: Sequence[int]) -> list[ThreadScaling]:
        """The same on several threads; none of them where MuJoCo's warnings end a rollout."""
        return [self._threads(count) for count in counts] if self.in_batch else []

    def _opened(self, most: int) -> float:
        """Prepares rollouts of at most so many steps, and returns what a step costs, roughly [s]."""
        self.run = self.make(most)
        self._roller = BatchRoller(self.run)
        try:
            return self._longest(most)
        except StoppedError:
            self.run.check(self.steps)  # raises if the simulation is unstable
            self._leave_batch()
            return self._longest(most)

    def _threads(self, count: int) -> ThreadScaling:
        one = self.step
        step, reference = (one, self.reference_workload) if count == 1 else self._timed_threads(count)
        speed = 1 / step.median
        timestep = self.run.model.opt.timestep
        return ThreadScaling(count, step, reference, speed, speed * timestep, one.median / step.median)

    def _timed_threads(self, count: int) -> tuple[SampleStatistics, SampleStatistics]:
        """Wall time per step of so many copies, and of the reference workload on as many threads."""
        roller, workload = BatchRoller(self.run, count), ReferenceWorkload(self.clock, count)
        rollout = self.step.median * self.steps * max(1, count / available_cores())
        workload.fit(rollout)
        self._rolled(roller, min(self.steps, 2 * self.block), self.block)  # wakes the threads up

        rollouts = []
        for _ in range(self._affordable(THREADS, rollout)):
            # Threads meet at the end of each block: fewer, longer ones.
            rollouts.append(self._rolled(roller, self.steps, 10 * self.block))
            workload.time()

        whole = [self._mean(blocks, 10) / count for blocks in rollouts]
        return summarized(whole, (np.concatenate(rollouts) / count).tolist()), workload.step

    def _affordable(self, share: float, rollout: float) -> int:
        """Number of rollouts, each of which takes so long [s], that a share of the budget allows."""
        fitting = int(share * self.budget.seconds / rollout)
        return self.budget.repeats or min(max(fitting, LEAST_REPEATS), MOST_REPEATS)

    def _profiled(self) -> StepProfile:
        """The least disturbed of some profiles."""
        profiles, spent = [profile(self.run, self.steps)], 0.0
        while (phases := profiles[-1].phases) and len(profiles) < PROFILES:
            spent += phases.seconds * self.steps
            if spent > PROFILE * self.budget.seconds:
                break
            profiles.append(profile(self.run, self.steps))
        return min(profiles, key=lambda one: one.phases.seconds if one.phases else 0.0)

    def _leave_batch(self) -> None:
        self.in_batch, self._roller = False, LoopRoller(self.run)

    def _longest(self, most: int) -> float:
        """Rolls out more and more steps, and returns what one took in the last and longest rollout [s]."""
        self.steps, cost, spent = 0, 0.0, 0.0
        while self.steps < most and spent < WARM_UP * self.budget.seconds:
            self.steps = min(max(1, 2 * self.steps), most)
            cost = float(self._rolled(self._roller, self.steps, self.steps)[0])
            spent += cost * self.steps
        return cost

    def _rolled(self, roller: Roller, steps: int, block: int) -> np.ndarray:
        """Wall time per step of every block [s]."""
        with without_timers():
            spent = roller.seconds(steps, block, self.clock)
        return spent / self._sizes(steps, block)

    def _mean(self, per_step: np.ndarray, blocks: int = 1) -> float:
        """Wall time per step of a rollout [s]."""
        return float((per_step * self._sizes(self.steps, blocks * self.block)).sum() / self.steps)

    def _sizes(self, steps: int, block: int) -> np.ndarray:
        return np.array([min(block, steps - first) for first in range(0, steps, block)])


def rounded_down(value: float, most: int) -> int:
    """The largest of 1, 2, 5, 10, 20, … up to `value`, at least 1; `most` if `value` is no less."""
    if value >= most:
        return most
    scale = 10 ** int(np.floor(np.log10(max(value, 1))))
    return max([1, *(digit * scale for digit in ROUND if digit * scale <= value)])
