"""Wall time of steps: the same rollout is repeated in C and timed block by block.

This loop is separate from `run_with_taps`, and reads nothing while it runs.

A fixed workload is timed alternately with the measurement. Anything that slows down the whole machine, such as another
process, a lower clock frequency or a busy host, slows down both; the quotient of their wall times stays the same. This
is duet benchmarking: Bulej, Horký, Tůma, Farquet & Prokopec, Duet Benchmarking: Improving Measurement Accuracy in the
Cloud, ICPE 2020.
"""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch  # pyright: ignore[reportMissingTypeStubs]

from mjrun.bench.statistics import SampleStatistics, summarized
from mjrun.dataclass import dataclass
from mjrun.model import state
from mjrun.model.mujoco_globals import without_timers
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
VERSION = 1  # to be increased when the model or the steps change
STEPS = 100  # in a repetition
SHARE = 0.25  # of the wall time of the measurement
MOST_REPETITIONS = 10_000

# A three-legged figure that drops onto the floor: 12 degrees of freedom, several contacts, Newton's method.
MJCF = """
<mujoco model="reference workload">
  <option timestep=".002" integrator="implicitfast" solver="Newton" cone="pyramidal" jacobian="dense"
    iterations="100" tolerance="1e-8"/>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 .52" euler="5 10 0">
      <freejoint/>
      <geom type="ellipsoid" size=".2 .2 .1" mass="2"/>
      <replicate count="3" euler="0 0 120">
        <body pos=".2 0 0">
          <joint axis="0 1 0" range="-60 60" damping=".5" armature=".01"/>
          <geom type="capsule" fromto="0 0 0 .2 0 -.2" size=".04" mass=".5"/>
          <body pos=".2 0 -.2">
            <joint axis="0 1 0" range="-60 60" damping=".5" armature=".01"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".04" mass=".3"/>
          </body>
        </body>
      </replicate>
    </body>
  </worldbody>
</mujoco>
"""


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
        if self.controls is None or not self.model.nu:
            return PhysicsStepper(self.model, self.data())
        timestep, idle = rational(self.model.opt.timestep), np.zeros(int(self.model.nu))
        return PhysicsStepper(self.model, self.data(), ControlSources(timestep, idle, ControlArray(self.controls)))


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


@dataclass(frozen=True)
class ReferenceWorkloadInfo:
    """Facts about the workload that represents the speed of the machine.

    Attributes:
      version: version of the workload; only equal versions are compared.
      steps: steps of its model in a repetition.
    """

    version: int = VERSION
    steps: int = STEPS


class ReferenceWorkloadTimer:
    """A timer of the fixed workload, on one thread or several.

    Args:
      copies: number of copies of its model, one thread each.

    Attributes:
      samples: wall time per step of one copy [s], in chronological order.
    """

    def __init__(self, clock: Clock, copies: int = 1) -> None:
        model = mujoco.MjModel.from_xml_string(MJCF)
        self._roller = BatchRolloutTimer(RolloutInputs.of(model, mujoco.MjData(model)), copies)
        self._clock = clock
        self._repetitions = 1
        self.samples: list[float] = []

    def fit(self, seconds: float) -> None:
        """Makes each sample take about `SHARE` of `seconds`, the wall time of the measurement between two samples.

        A scheduler assigns the processor in slices of milliseconds: only work of similar length is disturbed as much.
        """
        cost = min(self._repetition() for _ in range(2))  # the first starts the threads
        self._repetitions = min(max(1, round(SHARE * seconds / cost)), MOST_REPETITIONS)

    def time(self) -> None:
        """Takes another sample."""
        spent = sum(self._repetition() for _ in range(self._repetitions))
        self.samples.append(spent / (self._repetitions * STEPS * self._roller.copies))

    @property
    def step(self) -> SampleStatistics:
        """Wall time per step of one copy [s]."""
        return summarized(self.samples)

    def _repetition(self) -> float:
        """Times one repetition of the motion [s]."""
        with without_timers():
            return float(self._roller.seconds(STEPS, STEPS, self._clock)[0])
