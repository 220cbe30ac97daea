"""Steppers: physics moved to an exact step, with the first bad step found when a simulation fails."""

import copy
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, Protocol, TypeVar, runtime_checkable

import mujoco
import numpy as np

from mjrun.errors import ContactMemoryError, FailedStepError, MjrunError, SimulationError, UnstableError
from mjrun.model import state
from mjrun.model.names import names
from mjrun.model.state import Integrate, integrator_of, is_bounded, need_only_motion
from mjrun.physics.control import NEVER, ControlSources, PushForces
from mjrun.timeline import rational

T = TypeVar("T")

CHUNK = 50  # steps between two checks of the warning counters; a check per step costs about 10 %
READ_CHUNK = 256  # the same where Python reads every step, or a controller in Python sets its controls
SHORT = 20  # the fewest steps that are taken together in C; Python takes fewer, one by one, in less time
SHORTAGES = slice(int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL) + 1)
BAD = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]
FAILURES = [*range(SHORTAGES.start, SHORTAGES.stop), *BAD]
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)

# What is computed in the MjData of a step: nothing yet, positions and velocities, or all of the instant.
STATE, MOTION, INSTANT = int(mujoco.mjtStage.mjSTAGE_NONE), int(mujoco.mjtStage.mjSTAGE_VEL), 3


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


def derive(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    instant: mujoco.MjData,
    step: int,
    computed: int = STATE,
    shortages: np.ndarray | None = None,
) -> None:
    """Copies `data`, which is at `step`, to `instant`, and computes all derived fields there.

    Args:
      computed: the derived fields that are valid in `data`: `STATE` or `MOTION`.
      shortages: `shortages_of(instant)`, if the caller has it.

    Raises:
      FailedStepError: MuJoCo raised an error.
      ContactMemoryError: MuJoCo left out contacts or constraints for lack of memory.
    """
    mujoco.mj_copyData(instant, model, data)
    try:
        mujoco.mj_forwardSkip(model, instant, computed, False)
    except mujoco.FatalError as error:
        raise FailedStepError(step, data.time, str(error)) from None
    if any((shortages_of(instant) if shortages is None else shortages).tolist()):
        raise ContactMemoryError(step, data.time)


def shortages_of(data: mujoco.MjData) -> np.ndarray:
    """Returns a view of the numbers of warnings about contacts or constraints that are left out for lack of memory."""
    return data.warning.number[SHORTAGES]


def instant_of(model: mujoco.MjModel, start: np.ndarray) -> mujoco.MjData:
    """Returns a new MjData in the integration state `start` of step 0, with all derived fields computed.

    Raises:
      FailedStepError: MuJoCo raised an error.
    """
    return next(instants_of(model, [start]))


def instants_of(model: mujoco.MjModel, states: Iterable[np.ndarray]) -> Iterator[mujoco.MjData]:
    """Yields each of these integration states with all derived fields computed, in one MjData for all.

    Raises:
      FailedStepError: MuJoCo raised an error.
    """
    data, instant = mujoco.MjData(model), mujoco.MjData(model)
    for each in states:
        state.restore(model, data, each)
        derive(model, data, instant, 0)
        yield instant


class PhysicsStepper:
    """A stepper that takes the steps of `mj_step` from the state in `data`, on a copy of `model`.

    A step that is observed is divided: its instant is computed once, read, and integrated.

    Args:
      control: the source of controls; those in `data` when None. A controller is called on arrival at a step,
        whether or not the step is observed.
      pushes: added to the `xfrc_applied` of `data` or of a controller.
      in_place: whether to use `model` itself, whose flags it changes, not a copy, which takes as long as a load.

    Automatic resets are off: an unstable simulation raises UnstableError within `CHUNK` steps of its
    first bad step, and `step` is then the last good one.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        control: ControlSources | None = None,
        pushes: PushForces | None = None,
        *,
        in_place: bool = False,
    ) -> None:
        self.model = model if in_place else copy.copy(model)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.step = 0
        self._integrate = integrator_of(self.model)
        self._collides_again = int(self.model.opt.integrator) == RK4  # within a step, beyond its instant
        self._use(mujoco.MjData(self.model))
        self._computed = STATE
        # The state on arrival at a step, without its new inputs; and another, which is written meanwhile.
        self._saved_state, self._next_state = np.empty((2, state.size(self.model)))
        self._saved_step = -1
        self._inputs = np.empty(state.size(self.model, state.INPUTS))
        self._moving = state.moving(self.model)
        # A state does not include bodies that sleep, nor what contacts of flexes carry from step to step.
        self._needs_copy = bool(self.model.opt.enableflags & SLEEP) or self.model.nflex > 0
        state.restore(self.model, self._data, state.save(model, data))

        self.control = control or ControlSources(rational(model.opt.timestep), data.ctrl.copy())
        self._pushes = pushes or None
        self._unpushed = data.xfrc_applied.copy()
        self._sources = [source for source in (self.control.controller, self.control.inputs, pushes) if source]
        # What was set each time a controller acted, in a block that is repeated; an error of the controller comes last.
        self._repeated = deque[Any]()
        self._in_place = self._may_move_poses = False
        if self.control.controller:
            self.control.controller.reset(self.model, self._copied_instant())
            self._permit(self.control.controller.fields)
        self._arrive()
        self._start = self.state()
        self._initial: mujoco.MjData | None = None

    def advance(self, step: int) -> None:
        if step < self.step:
            raise ValueError(f"cannot go back from step {self.step} to step {step}")
        while self.step < step:
            count, alike = step - self.step, self.steps_alike()
            if count > alike < SHORT and self._calls_within and self._computed != INSTANT:
                count = min(count, self.steps_together())
                if not self.read_steps(count, _no_readers, []):
                    self._repeat_singly(count)
                continue
            count = min(count, CHUNK, alike)
            if count == 1 or (self._integrate and self._computed != STATE):
                self._take_one()
                continue
            # A copy of the MjData, not a state: it includes sleeping bodies, and is intact after an interrupted step.
            mujoco.mj_copyData(self._saved, self.model, self._data)
            if self._take(count):
                self.step += count
                self._arrive()
                continue
            self._go_on_from_copy()
            self._repeat_singly(count)

    def steps_alike(self) -> int:
        """Returns the number of steps before a controller is called or inputs other than controls change."""
        return min((source.next_change(self.step) for source in self._sources), default=NEVER) - self.step

    def steps_together(self) -> int:
        """Returns the maximum number of steps of `read_steps`: it may call a controller on the way."""
        return READ_CHUNK if self._calls_within else min(READ_CHUNK, self.steps_alike())

    @property
    def _calls_within(self) -> bool:
        """True if a controller is the only source of inputs, and a step is divided where it is called."""
        is_only = len(self._sources) == 1 and not self.control.varies
        return is_only and self.control.controller is not None and self._integrate is not None

    def _calls_after(self, step: int) -> Iterator[int]:
        """Returns the steps after `step` at which the controller is called."""
        return self.control.controller.calls_after(step) if self.control.controller else iter(())

    def _caller(self) -> Callable[[int], bool | None]:
        """Returns a function that calls the controller at a step, once positions and velocities are computed.

        The function returns True if the controller has set inputs with which they must be computed again.
        """
        controller, model, data, inputs = self.control.controller, self.model, self._data, self._inputs
        assert controller
        acting, computed = data if self._in_place else self._copy, MOTION if self._integrate else STATE
        act, shortages = controller.caller(model, acting, self._guarded), shortages_of(acting)
        if self._in_place and not (self._may_move_poses or self._pushes):
            return act

        def call(step: int) -> bool:
            if acting is not data:
                derive(model, data, acting, step, computed, shortages)
            poses = _poses(data) if self._may_move_poses else b""
            if self._pushes:
                acting.xfrc_applied[:] = self._unpushed

            act(step)
            if acting is not data:
                mujoco.mj_getState(model, acting, inputs, state.INPUTS)
                mujoco.mj_setState(model, data, inputs, state.INPUTS)
            return self._may_move_poses and poses != _poses(data)

        return call

    def _current_caller(self) -> Callable[[int], bool | None]:
        self._call = self._call or self._caller()
        return self._call

    def _copier(self) -> Callable[[], Any]:
        """Returns a function that copies what the controller has set, for `_put_back`."""
        copies = [getattr(self._data, name).tobytes for name in self._set]
        return copies[0] if len(copies) == 1 else lambda: b"".join([copy() for copy in copies])

    def _put_back(self, copied: Any) -> None:
        """Sets again what was copied."""
        start = 0
        for name in self._set:
            values = getattr(self._data, name)
            values[:] = np.frombuffer(copied, values.dtype, values.size, start).reshape(values.shape)
            start += values.nbytes

    def _repeats(self) -> bool:
        """Repeats what the controller set at this step in a block, or its error; returns False if it was not called."""
        if not self._repeated:
            return False
        result = self._repeated.popleft()
        if isinstance(result, MjrunError):
            raise result
        self._put_back(result)
        return True

    def read_steps(
        self, count: int, readers: Callable[[mujoco.MjData], Sequence[Callable[[], T]]], into: list[T]
    ) -> bool:
        """Takes `count` steps, at most `steps_together()`, and reads the instant before each.

        This is cheaper than `instant()` and `advance` for each, as it checks all steps together. Where one of them
        fails it returns False, with the stepper at the first instant again, and what was read is invalid. A controller
        is not called again at the steps that are then taken one by one: what it set is repeated.

        Args:
          readers: returns the functions that read an instant in an MjData, given this MjData.
          into: a list to which the results of these functions are added.

        Raises:
          ControllerError: the controller failed at the last step, on arrival; what was read is valid.
        """
        if self._integrate is None:
            return False
        model, data, integrate, computed = self.model, self._data, self._integrate, self._computed
        mujoco.mj_copyData(self._saved, model, data)
        controls = self.control.rows(self.step, count) if self.control.varies else None
        calls, call, copied = iter(()), None, None
        if self._calls_within:
            calls, call, copied = self._calls_after(self.step), self._current_caller(), self._copier()
        checks_fields = self.control.controller is not None and self.control.controller.may_change_fields
        before = copied() if copied else None
        due, is_stable, reads = next(calls, NEVER), False, readers(data)
        try:
            for step in range(self.step, self.step + count):
                if controls is not None:
                    data.ctrl[:] = controls[step - self.step]
                if step == due and call and copied:
                    if checks_fields and self._must_permit():
                        count = step - self.step
                        break
                    due = next(calls)
                    warnings = data.warning.number.copy() if self._may_move_poses else None
                    data.flg_energyvel = False  # no step resets it: a sensor would show the energy of the last one
                    mujoco.mj_step1(model, data)
                    try:
                        is_moved = call(step)
                    except (FailedStepError, ContactMemoryError):  # of the controller's copy
                        return False
                    except MjrunError as error:
                        self._repeated.append(error)
                        return False
                    self._repeated.append(copied())
                    computed = MOTION
                    if is_moved:
                        data.warning.number[:] = warnings
                        computed = STATE
                else:
                    mujoco.mj_checkPos(model, data)  # as mj_step does
                    mujoco.mj_checkVel(model, data)
                mujoco.mj_forwardSkip(model, data, computed, False)
                mujoco.mj_checkAcc(model, data)
                for read in reads:
                    into.append(read())
                integrate(model, data)
                computed = STATE
            is_stable = self._is_stable()
        except mujoco.FatalError:
            pass
        finally:
            if not is_stable:
                self._go_on_from_copy()
                if copied:
                    self._put_back(before)
        if is_stable:
            self._repeated.clear()
            self.step += count
            self._arrive()
        return is_stable

    def jump(self, step: int, to: np.ndarray) -> None:
        """Continues at `step` from the state `to` `(nstate,)`, computed elsewhere."""
        state.restore(self.model, self._data, to)
        self.step, self._saved_step = step, -1
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
        self._computed, self._saved_step = STATE, -1

    def state(self) -> np.ndarray:
        return state.save(self.model, self._data)

    def instant(self) -> mujoco.MjData:
        if self._integrate is None:
            return self._copied_instant()
        if self._computed != INSTANT:
            try:
                self._derive()
            except mujoco.FatalError as error:
                raise self._failure(str(error)) from None
        return self._data

    def initial(self) -> mujoco.MjData:
        self._initial = self._initial or instant_of(self.model, self._start)
        return self._initial

    @cached_property
    def _saved(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    @cached_property
    def _copy(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    def _use(self, data: mujoco.MjData) -> None:
        """Continues in another MjData; the view of its warnings stays valid."""
        self._data, self._warnings = data, data.warning.number
        self._call: Callable[[int], bool | None] | None = None  # the caller of the controller, on these data
        self._shortages = self._warnings[SHORTAGES]

    def _go_on_from_copy(self) -> None:
        """Continues from the copy that was saved before a step."""
        self._use(self._saved)
        self._saved = mujoco.MjData(self.model)

    def _copied_instant(self) -> mujoco.MjData:
        """Returns a copy of the instant, which the reader may change."""
        if self._computed != INSTANT:
            derive(self.model, self._data, self._copy, self.step, self._computed)
            if self._integrate is None:
                self._computed = INSTANT
        return self._copy

    def _derive(self) -> None:
        """Computes the rest of the instant in place."""
        computed = self._computed
        if computed == STATE:
            self._save()
        mujoco.mj_forwardSkip(self.model, self._data, computed, False)
        if computed == STATE and any(self._shortages.tolist()):
            raise self._shortage()
        self._computed = INSTANT

    def _derive_motion(self) -> None:
        """Computes positions and velocities in place."""
        self._save()
        self._data.flg_energyvel = False  # no step resets it: a sensor would show the energy of the last one
        try:
            mujoco.mj_step1(self.model, self._data)
        except mujoco.FatalError as error:
            raise self._failure(str(error)) from None
        if any(self._shortages.tolist()):
            raise self._shortage()
        self._computed = MOTION

    def _arrive(self) -> None:
        """Begins at a new state."""
        self._computed = STATE
        self._apply_inputs()

    def _apply_inputs(self) -> None:
        """Sets the inputs of this step."""
        control = self.control
        if control.inputs:
            state.restore(self.model, self._data, control.inputs.at(self.step), state.INPUTS)
            self._unpushed[:] = self._data.xfrc_applied
        if self._pushes:
            self._push()
        if control.controller and control.controller.is_due(self.step):
            self._call_controller()
        if control.varies:
            self._data.ctrl[:] = control.rows(self.step, 1)[0]

    def _push(self) -> None:
        assert self._pushes
        self._data.xfrc_applied[:] = self._unpushed + self._pushes.on_bodies(self._data, self.step)

    def _permit(self, fields: frozenset[str] | None) -> None:
        """Prepares calls of a controller that uses these fields; None if it may use others.

        It works on the data of the step if that is enough, and otherwise on a copy.
        """
        self._in_place = bool(self._integrate and fields is not None and need_only_motion(self.model, fields))
        used = (*state.MOTION, *state.INPUT_FIELDS) if fields is None else fields
        values = {name: getattr(self._data, name, None) for name in used}
        arrays = [name for name, value in values.items() if isinstance(value, np.ndarray) and value.size]
        self._guarded = [name for name in arrays if name not in state.INPUT_FIELDS]
        self._set = ["ctrl", *(name for name in arrays if name in state.INPUT_FIELDS and name != "ctrl")]
        self._may_move_poses = any(name in state.POSITION_INPUTS for name in arrays)
        self._call = None

    def _must_permit(self) -> bool:
        """Returns whether the controller may use other fields than before: a function it calls has been replaced."""
        controller = self.control.controller
        return controller is not None and self._in_place and controller.fields is None

    def _call_controller(self) -> None:
        """Calls the controller, which sets the inputs. It reads and writes `xfrc_applied` without the pushes."""
        if self._repeats():
            return
        if self._must_permit():
            self._permit(None)
        data, varies = self._data, self.control.varies  # otherwise, only a controller changes controls
        if varies:
            data.ctrl[:] = self.control.constant
        warnings = data.warning.number.copy() if self._may_move_poses else None
        if self._integrate:
            self._derive_motion()
        if self._current_caller()(self.step) and warnings is not None:
            data.warning.number[:] = warnings  # the positions are computed again
            self._computed = STATE
        if varies:
            self.control.constant[:] = data.ctrl
        if self._pushes:
            self._unpushed[:] = data.xfrc_applied
            self._push()

    def _repeat_singly(self, count: int) -> None:
        """Takes steps one by one that have failed together, until the step that fails."""
        for _ in range(count):
            self._take_one()

    def _take(self, count: int) -> bool:
        """Takes `count` steps whole; returns whether all are stable."""
        try:
            if self.control.varies:
                for ctrl in self.control.rows(self.step, count):
                    self._data.ctrl[:] = ctrl
                    mujoco.mj_step(self.model, self._data)
            else:
                mujoco.mj_step(self.model, self._data, nstep=count)
        except mujoco.FatalError:
            return False
        return self._is_stable()

    def _take_one(self) -> None:
        """Takes one step, divided at its instant.

        Raises:
          SimulationError: the step fails; the stepper is still before it.
        """
        try:
            is_stable = self._take_whole() if self._integrate is None else self._take_divided(self._integrate)
        except mujoco.FatalError as error:
            raise self._failure(str(error)) from None
        if not is_stable:
            raise self._instability()
        self.step += 1
        self._arrive()

    def _take_whole(self) -> bool:
        """Takes a step that cannot be divided; returns whether it is stable."""
        self._save()
        mujoco.mj_step(self.model, self._data)
        return self._is_stable()

    def _take_divided(self, integrate: Integrate) -> bool:
        """Takes a step, the instant of which may be computed; returns whether it is stable."""
        model, data = self.model, self._data
        if self._computed != INSTANT:
            self._derive()
        if not is_bounded(data.qacc):
            mujoco.mj_checkAcc(model, data)
            if data.warning[BAD[2]].number:
                return False
        integrate(model, data)
        mujoco.mj_getState(model, data, self._next_state, state.STATE)
        if self._collides_again and any(self._shortages.tolist()):
            return False
        if not (is_bounded(self._next_state[self._moving]) or self._is_stable()):
            return False
        self._saved_state, self._next_state = self._next_state, self._saved_state
        self._saved_step = self.step + 1
        return True

    def _is_stable(self) -> bool:
        """Returns whether the steps up to the present state are stable."""
        data = self._data  # MuJoCo checks positions and velocities only at the start of the next step
        return not self._warnings[FAILURES].any() and is_bounded(data.qpos) and is_bounded(data.qvel)

    def _save(self) -> None:
        """Saves the state before a step is taken."""
        if self._needs_copy:
            mujoco.mj_copyData(self._saved, self.model, self._data)
        elif self._saved_step != self.step:
            mujoco.mj_getState(self.model, self._data, self._saved_state, state.STATE)
            self._saved_step = self.step

    def _go_back(self) -> mujoco.MjData:
        """Returns to the saved state, under the present inputs; returns the data of the failed step."""
        failed, inputs = self._data, state.save(self.model, self._data, state.INPUTS)
        if self._needs_copy:
            self._go_on_from_copy()
        else:
            self._use(mujoco.MjData(self.model))  # that of an interrupted step is unusable
            state.restore(self.model, self._data, self._saved_state)
        state.restore(self.model, self._data, inputs, state.INPUTS)
        self._computed = STATE
        return failed

    def _failure(self, reason: str) -> FailedStepError:
        """Returns to the state before a step that MuJoCo could not take, and describes the error."""
        self._go_back()
        return FailedStepError(self.step, self._data.time, reason)

    def _shortage(self) -> ContactMemoryError:
        """Returns to the state before a step without some of its contacts, and describes the error."""
        self._go_back()
        return ContactMemoryError(self.step, self._data.time)

    def _instability(self) -> SimulationError:
        """Returns to the last good state, and describes what is wrong after it."""
        if any(self._shortages.tolist()):
            return self._shortage()
        failed = self._go_back()
        return UnstableError(self.step, self._data.time, *self._culprit(failed), self.model.opt.timestep)

    def _culprit(self, failed: mujoco.MjData) -> tuple[str, str]:
        """Returns the first quantity that is not bounded, at this step or in `failed` after it, and its joint."""
        candidates = (
            ("the position", self._data.qpos),
            ("the velocity", self._data.qvel),
            ("the acceleration", failed.qacc),
            ("the velocity", failed.qvel),
            ("the position", failed.qpos),
        )
        quantity, values = next(each for each in candidates if not is_bounded(each[1]))
        index = int((~(abs(values) <= mujoco.mjMAXVAL)).argmax())
        return quantity, self._joint(index, of_qpos=quantity == "the position")

    def _joint(self, index: int, of_qpos: bool) -> str:
        starts = self.model.jnt_qposadr if of_qpos else self.model.jnt_dofadr
        joint = int(np.searchsorted(starts, index, side="right")) - 1
        body = names(self.model, "body")[int(self.model.jnt_bodyid[joint])]
        name = names(self.model, "joint")[joint]
        return f"joint '{name}'" + (f" of body '{body}'" if name == f"joint:{joint}" else "")


def _no_readers(data: mujoco.MjData) -> Sequence[Callable[[], object]]:
    """Reads nothing from a step."""
    return ()


def _poses(data: mujoco.MjData) -> bytes:
    """Returns the inputs that a step uses from its beginning on."""
    return b"".join([getattr(data, name).tobytes() for name in state.POSITION_INPUTS])
