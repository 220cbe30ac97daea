"""Wall time of steps: the same rollout is repeated in C and timed block by block.

This loop is separate from `run_with_taps`, and reads nothing while it runs.
"""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch  # pyright: ignore[reportMissingTypeStubs]

from mjrun.dataclass import dataclass
from mjrun.model import state
from mjrun.physics.control import ControlArray, ControlSources
from mjrun.physics.stepper import BAD, PhysicsStepper
from mjrun.timeline import rational

Clock = Callable[[], float]  # wall time [s] since any instant
# Parts of MuJoCo's timers (`mjtTimer`, without the prefix).
PARTS = {
    "STEP": ("POSITION", "VELOCITY", "ACTUATION", "CONSTRAINT", "ADVANCE", "INVERSE"),
    "POSITION": ("POS_KINEMATICS", "POS_INERTIA", "POS_COLLISION", "POS_MAKE", "POS_PROJECT"),
    "POS_COLLISION": ("COL_BROAD", "COL_NARROW"),
}
OPTIONAL = ("inverse",)  # left out if they take no time
REST = "other"


@dataclass(frozen=True)
class RolloutInputs:
    """Inputs of a rollout, which give the same motion every time.

    Attributes:
      model: model without automatic resets.
      start: integration state `(nstate,)`.
      controls: controls of every step, `(steps, nu)`; None keeps those in `start`.
    """

    model: mujoco.MjModel
    start: np.ndarray
    controls: np.ndarray | None = None

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, controls: np.ndarray | None = None) -> "RolloutInputs":
        """Returns a run from the state in `data`, with a copy of `model`."""
        own_model = copy.copy(model)
        own_model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        return cls(own_model, state.save(model, data), controls)

    def data(self) -> mujoco.MjData:
        """Returns a new MjData at the start."""
        data = mujoco.MjData(self.model)
        state.restore(self.model, data, self.start)
        return data

    def check(self, steps: int) -> None:
        """Takes `steps` steps to find the first that fails.

        Raises:
          SimulationError: a step fails; names the step, its time and the joint.
        """
        self._stepper().advance(steps)

    def states(self, steps: Sequence[int]) -> list[np.ndarray]:
        """Returns the integration states at `steps`, in ascending order.

        Raises:
          SimulationError: a step fails.
        """
        stepper, states = self._stepper(), list[np.ndarray]()
        for step in steps:
            stepper.advance(step)
            states.append(stepper.state())
        return states

    def _stepper(self) -> PhysicsStepper:
        return PhysicsStepper(self.model, self.data(), self._control())

    def _control(self) -> ControlSources | None:
        if self.controls is None or not self.model.nu:
            return None
        timestep = rational(self.model.opt.timestep)
        return ControlSources(timestep, np.zeros(int(self.model.nu)), ControlArray(self.controls))


class WarnedRolloutError(Exception):
    """A warning of MuJoCo, which ends a rollout of `mujoco.batch`."""


class RolloutTimer(Protocol):
    """A timer of the rollouts of a run."""

    copies: int

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        """Rolls out `steps` steps from the start, and times every `block` of them; the last block may be shorter.

        The clock is read twice per block.

        Returns:
          The wall time of each block [s].
        """
        ...


class BatchRolloutTimer:
    """A timer of copies of a run, rolled out in C, each in a separate thread; within one percent of a C loop.

    Raises:
      WarnedRolloutError: raised by `seconds` when MuJoCo warns.
    """

    def __init__(self, run: RolloutInputs, copies: int = 1) -> None:
        self.copies = copies
        self._run = run
        # As in `testspeed`, every copy keeps its MjData; sleep needs that, too.
        self._batch = Batch(run.model, copies, copies, persistent=True)
        self._warned = self._batch.warning.copy()

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        self._batch.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        self._batch.state[:] = self._run.start
        times = list[float]()
        for first, count in blocks_of(steps, block):
            controls = self._controls(first, count)
            before = clock()
            self._batch.rollout(count, controls, record=())
            times.append(clock() - before)
        if (self._batch.warning != self._warned).any():
            raise WarnedRolloutError
        return np.array(times)

    def _controls(self, first: int, count: int) -> np.ndarray | None:
        """Returns the controls of a block for all copies in the layout of C, so that no conversion is timed."""
        if self._run.controls is None:
            return None
        part = self._run.controls[first : first + count]
        return np.ascontiguousarray(np.broadcast_to(part, (self.copies, *part.shape)))


class PythonLoopRolloutTimer:
    """A timer that steps in Python, as a warning ends a rollout in C; with new controls, a step takes 1 µs longer."""

    copies = 1

    def __init__(self, run: RolloutInputs) -> None:
        self._run, self._data = run, run.data()

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        model, data, controls = self._run.model, self._data, self._run.controls
        mujoco.mj_resetData(model, data)
        state.restore(model, data, self._run.start)
        times = list[float]()
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
    """Returns the first step and the number of steps of each block."""
    return ((first, min(block, steps - first)) for first in range(0, steps, block))


@dataclass(frozen=True)
class StepPhase:
    """A phase of a step, as timed by MuJoCo, and its parts.

    Attributes:
      name: `step`, `position`, `collision`, …; `other` is the time that no timer of its level counts.
      seconds: wall time per step, while the timers run.
      share: share of the whole step.
      parts: phases that it consists of.
    """

    name: str
    seconds: float
    share: float
    parts: Sequence["StepPhase"] = ()


def phases(data: mujoco.MjData) -> StepPhase | None:
    """Returns the phases of the steps that `data` has taken with timers, or None.

    RK4 computes derivatives four times per step, and MuJoCo does not time its advance: it is included in `other`.
    """
    whole = data.timer[int(mujoco.mjtTimer.mjTIMER_STEP)]
    if not whole.number or whole.duration <= 0:
        return None
    seconds = {
        name.removeprefix("mjTIMER_"): data.timer[int(i)].duration / whole.number
        for name, i in mujoco.mjtTimer.__members__.items()
        if "NTIMER" not in name
    }
    return _phase("STEP", seconds, seconds["STEP"])


def _phase(timer: str, seconds: Mapping[str, float], step: float) -> StepPhase:
    parts = [_phase(part, seconds, step) for part in PARTS.get(timer, ())]
    parts = [part for part in parts if part.seconds or part.name not in OPTIONAL]

    rest = seconds[timer] - sum(part.seconds for part in parts)
    if parts and rest > 0:
        parts.append(StepPhase(REST, rest, rest / step))
    name = timer.rpartition("_")[2].lower()  # collision, of POS_COLLISION
    return StepPhase(name, seconds[timer], seconds[timer] / step, tuple(parts))


@dataclass(frozen=True)
class StepProfile:
    """The averages over the steps of a rollout: contacts, iterations, memory, and the time of each phase.

    Attributes:
      contacts, constraints: number of contacts and constraints (`ncon`, `nefc`).
      iterations: iterations of the constraint solver, averaged over islands as in `testspeed`.
      arena, arena_size: largest use of the arena, and its size [bytes]; None if there is no arena.
      phases: phases as timed by MuJoCo; None if unavailable.
      warned: whether MuJoCo warned.
    """

    contacts: float
    constraints: float
    iterations: float
    arena: int | None
    arena_size: int | None
    phases: StepPhase | None
    warned: bool


def profile(run: RolloutInputs, steps: int) -> StepProfile:
    """Rolls out `steps` steps with MuJoCo's timers, and inspects each; too slow to be timed itself.

    Raises:
      SimulationError: the run is unstable, or MuJoCo could not complete a step.
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
    is_good = all((abs(vector) < mujoco.mjMAXVAL).all() for vector in (data.qpos, data.qvel))
    if any(data.warning[kind].number for kind in BAD) or not is_good:
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
