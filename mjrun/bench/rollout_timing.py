"""The wall time of steps: the same rollout again and again, in C, timed block by block.

This is the one loop beside `observe`: nothing is looked at while it runs.
"""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch

from mjrun.model import state
from mjrun.physics.control import ControlArray, ControlSignal
from mjrun.physics.stepper import BAD, PhysicsStepper
from mjrun.timeline import rational

Clock = Callable[[], float]  # wall time [s], from anywhere on
# A phase, its timer (`mjtTimer`, without the prefix), and what it consists of.
PhaseTimer = tuple[str, str, Sequence["PhaseTimer"]]
COLLISION: PhaseTimer = ("collision", "POS_COLLISION", [("broad", "COL_BROAD", ()), ("narrow", "COL_NARROW", ())])
POSITION: PhaseTimer = (
    "position",
    "POSITION",
    [
        ("kinematics", "POS_KINEMATICS", ()),
        ("inertia", "POS_INERTIA", ()),
        COLLISION,
        ("make", "POS_MAKE", ()),
        ("project", "POS_PROJECT", ()),
    ],
)
STEP: PhaseTimer = (
    "step",
    "STEP",
    [
        POSITION,
        ("velocity", "VELOCITY", ()),
        ("actuation", "ACTUATION", ()),
        ("constraint", "CONSTRAINT", ()),
        ("advance", "ADVANCE", ()),
        ("inverse", "INVERSE", ()),
    ],
)
OPTIONAL = ("inverse",)  # left out where they take no time
REST = "other"


@dataclass(frozen=True)
class RolloutInputs:
    """What is rolled out: always the same motion.

    Attributes:
      model: its automatic resets are off.
      start: integration state `(nstate,)`.
      controls: of every step, `(steps, nu)`; those in `start` throughout when None.
    """

    model: mujoco.MjModel
    start: np.ndarray
    controls: np.ndarray | None = None

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, controls: np.ndarray | None = None) -> "RolloutInputs":
        """The run from the state in `data`, on a copy of `model`."""
        own_model = copy.copy(model)
        own_model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        return cls(own_model, state.save(model, data), controls)

    def data(self) -> mujoco.MjData:
        """A new MjData at the start."""
        data = mujoco.MjData(self.model)
        state.restore(self.model, data, self.start)
        return data

    def check(self, steps: int) -> None:
        """Takes `steps` steps, to find the first that fails.

        Raises:
          SimulationError: names that step, its time, and the joint.
        """
        self._stepper().advance(steps)

    def states(self, steps: Sequence[int]) -> list[np.ndarray]:
        """The integration states at `steps`, which ascend.

        Raises:
          SimulationError: a step on the way fails.
        """
        stepper, states = self._stepper(), []
        for step in steps:
            stepper.advance(step)
            states.append(stepper.state())
        return states

    def _stepper(self) -> PhysicsStepper:
        return PhysicsStepper(self.model, self.data(), self._control())

    def _control(self) -> ControlSignal | None:
        if self.controls is None or not self.model.nu:
            return None
        timestep = rational(self.model.opt.timestep)
        return ControlSignal(timestep, np.zeros(self.model.nu), ControlArray(self.controls))


class StoppedError(Exception):
    """MuJoCo warned, which ends a rollout of `mujoco.batch`."""


class Roller(Protocol):
    """Rolls a run out and times it."""

    copies: int

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        """Rolls `steps` steps out from the start, and times every `block` of them, the last as long as it is.

        The clock is asked twice a block.

        Returns:
          The wall time of each block [s].
        """
        ...


class BatchRoller:
    """Rolls copies of a run out, each in a thread of its own, in C: within a percent of a loop in C.

    Raises:
      StoppedError: from `seconds`, when MuJoCo warns.
    """

    def __init__(self, run: RolloutInputs, copies: int = 1) -> None:
        self.copies = copies
        self._run = run
        # As `testspeed` has it, every copy keeps its MjData; sleep needs that too.
        self._batch = Batch(run.model, copies, copies, persistent=True)
        self._warned = self._batch.warning.copy()

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        self._batch.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        self._batch.state[:] = self._run.start
        times = []
        for first, count in blocks_of(steps, block):
            controls = self._controls(first, count)
            before = clock()
            self._batch.rollout(count, controls, record=())
            times.append(clock() - before)
        if (self._batch.warning != self._warned).any():
            raise StoppedError
        return np.array(times)

    def _controls(self, first: int, count: int) -> np.ndarray | None:
        """Those of a block for all copies, laid out as C takes them, so that converting them is not timed."""
        if self._run.controls is None:
            return None
        part = self._run.controls[first : first + count]
        return np.ascontiguousarray(np.broadcast_to(part, (self.copies, *part.shape)))


class LoopRoller:
    """Rolls a run out that makes MuJoCo warn. With controls that change, a step costs about a microsecond more."""

    copies = 1

    def __init__(self, run: RolloutInputs) -> None:
        self._run, self._data = run, run.data()

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        model, data, controls = self._run.model, self._data, self._run.controls
        mujoco.mj_resetData(model, data)
        state.restore(model, data, self._run.start)
        times = []
        for first, count in blocks_of(steps, block):
            before = clock()
            if controls is None:
                mujoco.mj_step(model, data, nstep=count)
            else:
                for row in controls[first : first + count]:
                    data.ctrl[:] = row
                    mujoco.mj_step(model, data)
            times.append(clock() - before)
        return np.array(times)


def blocks_of(steps: int, block: int) -> Iterator[tuple[int, int]]:
    """First step and number of steps of each block."""
    return ((first, min(block, steps - first)) for first in range(0, steps, block))


@dataclass(frozen=True)
class Phase:
    """One of the phases of a step, as MuJoCo times them, and its parts.

    Attributes:
      name: `step`, `position`, `collision`, …; `other` is what no timer of that level counts.
      seconds: wall time per step, while the timers run.
      share: of the whole step.
      parts: of which it consists.
    """

    name: str
    seconds: float
    share: float
    parts: Sequence["Phase"] = ()


def phases(data: mujoco.MjData) -> Phase | None:
    """The phases of the steps that `data` has taken with timers on; None without any.

    RK4 derives four times a step and its advance is not timed by MuJoCo: it is under `other`.
    """
    whole = data.timer[int(mujoco.mjtTimer.mjTIMER_STEP)]
    if not whole.number or whole.duration <= 0:
        return None
    seconds = {
        name.removeprefix("mjTIMER_"): data.timer[int(i)].duration / whole.number
        for name, i in mujoco.mjtTimer.__members__.items()
        if "NTIMER" not in name
    }
    return _phase(STEP, seconds, seconds["STEP"])


def _phase(timer: PhaseTimer, seconds: Mapping[str, float], step: float) -> Phase:
    name, key, inner = timer
    parts = [_phase(part, seconds, step) for part in inner]
    parts = [part for part in parts if part.seconds or part.name not in OPTIONAL]

    rest = seconds[key] - sum(part.seconds for part in parts)
    if parts and rest > 0:
        parts.append(Phase(REST, rest, rest / step))
    return Phase(name, seconds[key], seconds[key] / step, tuple(parts))


@dataclass(frozen=True)
class StepProfile:
    """What a step consists of, on average over a rollout.

    Attributes:
      contacts, constraints: number of them (`ncon`, `nefc`).
      iterations: of the constraint solver, averaged over islands, as `testspeed` has it.
      arena, arena_size: most of the arena that was ever in use, and its size [bytes]; None where there is none.
      phases: MuJoCo's own, measured with its timers on; None where they cannot be had.
      warned: whether MuJoCo warned of anything.
    """

    contacts: float
    constraints: float
    iterations: float
    arena: int | None
    arena_size: int | None
    phases: Phase | None
    warned: bool


def profile(run: RolloutInputs, steps: int) -> StepProfile:
    """Rolls `steps` steps out with MuJoCo's timers on, looking at each. Not to be timed from outside.

    Raises:
      SimulationError: the run is unstable, or MuJoCo gave up.
    """
    data = run.data()
    contacts = constraints = 0
    iterations = 0.0
    for step in range(steps):
        if run.controls is not None:
            data.ctrl[:] = run.controls[step]
        try:
            mujoco.mj_step(run.model, data)
        except mujoco.FatalError:
            run.check(steps)
            raise
        contacts += data.ncon
        constraints += data.nefc
        islands = min(max(data.nisland, 1), mujoco.mjNISLAND)
        iterations += data.solver_niter[0] if islands == 1 else data.solver_niter[:islands].mean()
    if any(data.warning[kind].number for kind in BAD) or not _is_good(data):
        run.check(steps)
    return StepProfile(
        contacts=contacts / steps,
        constraints=constraints / steps,
        iterations=float(iterations) / steps,
        arena=int(data.maxuse_arena),
        arena_size=int(data.narena),
        phases=phases(data),
        warned=any(warning.number for warning in data.warning),
    )


def _is_good(data: mujoco.MjData) -> bool:
    return all((abs(vector) < mujoco.mjMAXVAL).all() for vector in (data.qpos, data.qvel))
