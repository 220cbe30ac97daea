"""The wall time of steps: how many are rolled out, how often, and what comes of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.bench.rollout_timing import BatchRoller, Clock, LoopRoller, Profile, Roller, Run, StoppedError, profile
from mjrun.bench.statistics import Stat, stat
from mjrun.model.mujoco_globals import without_timers
from mjrun.rendering.process_count import available_cores

MOST_STEPS = 10_000  # of one rollout; testspeed's own
LEAST_REPEATS, MOST_REPEATS = 7, 50  # 7 give a ratio of medians an interval of 95 %
BLOCK = 2e-3  # [s] of steps that are timed at once, beside which what the clock and a call take is nothing
WARM_UP, ROLLOUTS, THREADS, PROFILE = 0.1, 0.4, 0.3, 0.1  # shares of the budget
PROFILES = 3
NICE = (1, 2, 5)


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
      budget: wall time that may be spent, more or less [s].
      steps: of one rollout; as many as the budget allows, at most `MOST_STEPS`, when None.
      repeats: of the rollout; as many as the budget allows, within `LEAST_REPEATS` and `MOST_REPEATS`, when None.
    """

    budget: float
    steps: int | None = None
    repeats: int | None = None


@dataclass(frozen=True)
class Threads:
    """Independent copies of the simulation, a thread each.

    Attributes:
      threads: how many.
      step: wall time per step of all copies together [s].
      steps_per_second, realtime_factor: of all copies together.
      scaling: how many times as many steps a second as one thread takes.
    """

    threads: int
    step: Stat
    steps_per_second: float
    realtime_factor: float
    scaling: float


@dataclass
class Stepping:
    """The steps of one simulation being timed, rollout by rollout.

    Attributes:
      run: what is rolled out.
      steps: of a rollout; those that the budget allows, from `warm_up` on, and those that are taken, from `begin` on.
      block, repeats: steps that are timed at once, rollouts; known from `begin` on.
      profile: what a step consists of; known from `begin` on.
      rollouts: wall times per step of each block of each rollout so far [s].
      in_batch: whether it is stepped in C, which ends at MuJoCo's warnings.
      first: wall time of the first step, which compiles something [s]; None where nothing is.
      overflows: what an engine had no room for, a sentence each.
    """

    make: Callable[[int], Run]
    effort: Effort
    clock: Clock
    rollouts: list[np.ndarray] = field(default_factory=list, init=False)
    in_batch: bool = field(default=True, init=False)
    first: float | None = field(default=None, init=False)
    overflows: Sequence[str] = field(default=(), init=False)
    steps: int = field(default=0, init=False)
    block: int = field(default=1, init=False)
    repeats: int = field(default=0, init=False)
    run: Run = field(init=False)
    _roller: Roller = field(init=False)
    _cost: float = field(init=False)  # of a step [s], roughly
    profile: Profile = field(init=False)

    def warm_up(self) -> None:
        """Rolls out more and more steps, until it is known how many of them the budget allows.

        Raises:
          SimulationError: the simulation is unstable, or MuJoCo gave up.
        """
        most = self.effort.steps or MOST_STEPS
        self._cost = self._opened(most)
        share = ROLLOUTS * self.effort.budget
        self.steps = self.effort.steps or nice(share / (LEAST_REPEATS * self._cost), most)

    def begin(self, steps: int) -> None:
        """Chooses how often rollouts of `steps` steps are timed, and profiles one.

        Raises:
          SimulationError: the simulation is unstable, or MuJoCo gave up.
        """
        self.steps = steps
        fitting = int(ROLLOUTS * self.effort.budget / (self._cost * steps))
        self.repeats = self.effort.repeats or min(max(fitting, LEAST_REPEATS), MOST_REPEATS)
        self.block = nice(BLOCK / self._cost, steps)
        self.profile = self._profiled()
        if self.profile.warned and self.in_batch:
            self._leave_batch()

    def rollout(self) -> None:
        """Times one more rollout."""
        self.rollouts.append(self._rolled(self._roller, self.steps, self.block))

    @property
    def step(self) -> Stat:
        """Wall time per step of one copy [s]: of whole rollouts, and its spread over blocks of steps."""
        copies = self._roller.copies
        whole = [self._mean(blocks) / copies for blocks in self.rollouts]
        return stat(whole, (np.concatenate(self.rollouts) / copies).tolist())

    def threads(self, counts: Sequence[int]) -> list[Threads]:
        """The same on several threads; with none of them where MuJoCo's warnings end a batch."""
        return [self._threads(count) for count in counts] if self.in_batch else []

    def _opened(self, most: int) -> float:
        """Makes ready for rollouts of at most so many steps, and returns what a step costs, roughly [s]."""
        self.run = self.make(most)
        self._roller = BatchRoller(self.run)
        try:
            return self._longest(most)
        except StoppedError:
            self.run.check(self.steps)  # which says so, if it is unstable
            self._leave_batch()
            return self._longest(most)

    def _threads(self, count: int) -> Threads:
        one = self.step
        if count == 1:
            found = one
        else:
            roller, rounds = BatchRoller(self.run, count), max(1, count / available_cores())
            fitting = int(THREADS * self.effort.budget / (one.median * self.steps * rounds))
            repeats = self.effort.repeats or min(max(fitting, LEAST_REPEATS), MOST_REPEATS)
            self._rolled(roller, min(self.steps, 2 * self.block), self.block)  # wakes the threads up
            # Threads meet at the end of each block: fewer, longer ones.
            blocks = [self._rolled(roller, self.steps, 10 * self.block) for _ in range(repeats)]
            found = stat([self._mean(part, 10) / count for part in blocks], (np.concatenate(blocks) / count).tolist())
        speed = 1 / found.median
        timestep = self.run.model.opt.timestep
        return Threads(count, found, speed, speed * timestep, one.median / found.median)

    def _profiled(self) -> Profile:
        """The least disturbed of some profiles."""
        found, spent = [profile(self.run, self.steps)], 0.0
        while found[-1].phases and len(found) < PROFILES:
            spent += found[-1].phases.seconds * self.steps
            if spent > PROFILE * self.effort.budget:
                break
            found.append(profile(self.run, self.steps))
        return min(found, key=lambda one: one.phases.seconds if one.phases else 0.0)

    def _leave_batch(self) -> None:
        self.in_batch, self._roller = False, LoopRoller(self.run)

    def _longest(self, most: int) -> float:
        """Rolls out more and more steps, and returns what one took in the last and longest rollout [s]."""
        self.steps, cost, spent = 0, 0.0, 0.0
        while self.steps < most and spent < WARM_UP * self.effort.budget:
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


def nice(value: float, most: int) -> int:
    """The largest of 1, 2, 5, 10, 20, … up to `value`, at least 1; `most` if `value` is no less."""
    if value >= most:
        return most
    scale = 10 ** int(np.floor(np.log10(max(value, 1))))
    return max([1, *(digit * scale for digit in NICE if digit * scale <= value)])
