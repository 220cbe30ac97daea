"""Steppers: physics moved to an exact step, with the first bad step found when a simulation fails."""

import copy
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np

from mjrun.errors import FailedStepError, SimulationError, UnstableError
from mjrun.model import state
from mjrun.model.names import names
from mjrun.physics.control import NEVER, ControlSources, PeriodicController
from mjrun.physics.push_forces import PushForces
from mjrun.timeline import rational

CHUNK = 50  # steps between two checks of the warning counters; a check per step costs about 10 %
SHORTAGES = (int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL))
BAD = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]
QUANTITIES = dict(zip(BAD, ("the position", "the velocity", "the acceleration"), strict=True))


class Stepper(Protocol):
    """A model and its state, moved to a step."""

    model: mujoco.MjModel
    step: int

    def advance(self, step: int) -> None:
        """Moves forward to `step`, which must not be before the current step."""
        ...

    def state(self) -> np.ndarray:
        """Returns the integration state at `self.step` as a new array `(nstate,)`, enough to continue bit for bit."""
        ...

    def instant(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to `self.step`; it must not be kept or changed."""
        ...

    def initial(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to step 0, at any current step; it must not be changed."""
        ...


@runtime_checkable
class EditableStepper(Stepper, Protocol):
    """A stepper whose state can be changed from outside."""

    def edit(self, values: np.ndarray, spec: int) -> None:
        """Changes parts of the state at this step.

        Args:
          values: the parts `(size,)` that `spec` names by `mjtState` bits.
        """
        ...


def derive(model: mujoco.MjModel, data: mujoco.MjData, instant: mujoco.MjData, step: int) -> None:
    """Copies `data`, which is at `step`, to `instant`, and computes all derived fields there.

    Raises:
      FailedStepError: MuJoCo raised an error.
    """
    mujoco.mj_copyData(instant, model, data)
    try:
        mujoco.mj_forward(model, instant)
    except mujoco.FatalError as error:
        raise FailedStepError(step, data.time, str(error)) from None


def instant_of(model: mujoco.MjModel, start: np.ndarray) -> mujoco.MjData:
    """Returns a new MjData in the integration state `start` of step 0, with all derived fields computed.

    Raises:
      FailedStepError: MuJoCo raised an error.
    """
    data, instant = mujoco.MjData(model), mujoco.MjData(model)
    state.restore(model, data, start)
    derive(model, data, instant, 0)
    return instant


class PhysicsStepper:
    """A stepper that takes steps by `mj_step` from the state in `data`, on a copy of `model`.

    Args:
      control: the source of controls; those in `data` when None. A controller is called on arrival at a step,
        whether or not the step is observed.
      pushes: added to the `xfrc_applied` of `data` or of a controller.

    Automatic resets are off: an unstable simulation raises UnstableError within `CHUNK` steps of its
    first bad step, and `step` is then the last good one.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        control: ControlSources | None = None,
        pushes: PushForces | None = None,
    ) -> None:
        self.model = copy.copy(model)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.step = 0
        self._data = mujoco.MjData(self.model)
        self._saved = mujoco.MjData(self.model)
        self._instant = mujoco.MjData(self.model)
        self._instant_step = -1
        state.restore(self.model, self._data, state.save(model, data))
        self.control = control or ControlSources(rational(model.opt.timestep), data.ctrl.copy())
        self._pushes = pushes
        self._unpushed = data.xfrc_applied.copy()
        if self.control.controller:
            self.control.controller.reset(self.model, self.instant())
        self._arrive()
        self._start = self.state()
        self._initial: mujoco.MjData | None = None

    def advance(self, step: int) -> None:
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        while self.step < step:
            count = min(CHUNK, step - self.step, self.steps_alike())
            # A copy of the MjData, not a state: it includes sleeping bodies, and is intact after an interrupted step.
            mujoco.mj_copyData(self._saved, self.model, self._data)
            if self._take(count) is not None:
                raise self._first_failure(count)
            self.step += count
            self._arrive()

    @property
    def lacks_memory(self) -> bool:
        """True where MuJoCo left out contacts or constraints for lack of memory; it warns and continues."""
        return any(self._data.warning[kind].number for kind in SHORTAGES)

    def steps_alike(self) -> int:
        """Returns the number of steps before a controller is called or inputs other than controls change."""
        sources = (self.control.controller, self.control.inputs, self._pushes)
        return min((source.next_change(self.step) for source in sources if source), default=NEVER) - self.step

    def jump(self, step: int, to: np.ndarray) -> None:
        """Continues at `step` from the state `to` `(nstate,)`, computed elsewhere."""
        state.restore(self.model, self._data, to)
        self.step = step
        self._arrive()

    def edit(self, values: np.ndarray, spec: int) -> None:
        """Changes parts of the state at this step; a changed control holds until another source drives the actuator.

        Args:
          values: the parts `(size,)` that `spec` names by `mjtState` bits.
        """
        before = self._data.ctrl.copy()
        state.restore(self.model, self._data, values, spec)
        changed = self._data.ctrl != before
        self.control.constant[changed] = self._data.ctrl[changed]
        self._instant_step = -1

    def state(self) -> np.ndarray:
        return state.save(self.model, self._data)

    def instant(self) -> mujoco.MjData:
        # Derived fields of `_data` are one step behind its state. They are computed on a second MjData, so that
        # observation cannot change the motion.
        if self._instant_step != self.step:
            derive(self.model, self._data, self._instant, self.step)
            self._instant_step = self.step
        return self._instant

    def initial(self) -> mujoco.MjData:
        self._initial = self._initial or instant_of(self.model, self._start)
        return self._initial

    def _arrive(self) -> None:
        """Puts the inputs of this step in force."""
        control = self.control
        if control.inputs:
            state.restore(self.model, self._data, control.inputs.at(self.step), state.INPUTS)
            self._unpushed[:] = self._data.xfrc_applied
            self._instant_step = -1
        if self._pushes:
            self._push()
        if control.controller and control.controller.is_due(self.step):
            self._call_controller(control.controller)
        if control.varies:
            self._data.ctrl[:] = control.rows(self.step, 1)[0]
            self._instant_step = -1

    def _push(self) -> None:
        assert self._pushes
        self._data.xfrc_applied[:] = self._unpushed + self._pushes.on_bodies(self._data, self.step)
        self._instant_step = -1

    def _call_controller(self, controller: PeriodicController) -> None:
        """Calls the controller, which sets the inputs. It reads and writes `xfrc_applied` without the pushes."""
        self._data.ctrl[:] = self.control.constant
        self._instant_step = -1
        data = self.instant()  # a copy, so that a controller can change inputs alone
        if self._pushes:
            data.xfrc_applied[:] = self._unpushed
        seen = state.save(self.model, data, state.INPUTS)
        controller.act(self.model, data, self.step)
        inputs = state.save(self.model, data, state.INPUTS)
        state.restore(self.model, self._data, inputs, state.INPUTS)
        self.control.constant[:] = self._data.ctrl
        if not np.array_equal(seen, inputs):
            self._instant_step = -1
        if self._pushes:
            self._unpushed[:] = self._data.xfrc_applied
            self._push()

    def _take(self, count: int) -> str | None:
        """Takes `count` steps; returns None if all are stable, else the error message of MuJoCo, if any."""
        try:
            if self.control.varies:
                for ctrl in self.control.rows(self.step, count):
                    self._data.ctrl[:] = ctrl
                    mujoco.mj_step(self.model, self._data)
            else:
                mujoco.mj_step(self.model, self._data, nstep=count)
        except mujoco.FatalError as error:
            return str(error)
        # MuJoCo checks positions and velocities only at the start of the next step.
        limit = mujoco.mjMAXVAL
        good = (
            not any(self._data.warning[kind].number for kind in BAD)
            and (abs(self._data.qpos) <= limit).all()
            and (abs(self._data.qvel) <= limit).all()
        )
        return None if good else ""

    def _first_failure(self, count: int) -> SimulationError:
        """Returns to the start of the chunk of `count` steps, and finds the step that fails."""
        self._data, self._saved = self._saved, mujoco.MjData(self.model)
        reason: str | None = None
        for _ in range(count):
            mujoco.mj_copyData(self._saved, self.model, self._data)
            reason = self._take(1)
            if reason is not None:
                break
            self.step += 1
        failed, self._data, self._saved = self._data, self._saved, mujoco.MjData(self.model)
        if reason:
            return FailedStepError(self.step, self._data.time, reason)
        return UnstableError(self.step, self._data.time, *self._culprit(failed), self.model.opt.timestep)

    def _culprit(self, failed: mujoco.MjData) -> tuple[str, str]:
        """Returns the quantity that failed in `failed`, and its joint."""
        for kind in BAD:
            if failed.warning[kind].number:
                index = failed.warning[kind].lastinfo
                return QUANTITIES[kind], self._joint(index, of_qpos=kind == BAD[0])
        beyond = ~(abs(failed.qvel) <= mujoco.mjMAXVAL)
        if beyond.any():
            return QUANTITIES[BAD[1]], self._joint(int(beyond.argmax()), of_qpos=False)
        beyond = ~(abs(failed.qpos) <= mujoco.mjMAXVAL)
        return QUANTITIES[BAD[0]], self._joint(int(beyond.argmax()), of_qpos=True)

    def _joint(self, index: int, of_qpos: bool) -> str:
        starts = self.model.jnt_qposadr if of_qpos else self.model.jnt_dofadr
        joint = int(np.searchsorted(starts, index, side="right")) - 1
        body = names(self.model, "body")[int(self.model.jnt_bodyid[joint])]
        name = names(self.model, "joint")[joint]
        return f"joint '{name}'" + (f" of body '{body}'" if name == f"joint:{joint}" else "")
