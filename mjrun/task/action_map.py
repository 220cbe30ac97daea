"""From the numbers that a policy answers to the controls of the actuators."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.errors import BadValueError, UsageError, concerning, counted, option, quoted
from mjrun.model.names import control_names, control_slices, identify, matching, names
from mjrun.options.kinds import Numbers
from mjrun.options.task import CONTROL, POSITION, TORQUE, VELOCITY
from mjrun.task.measurement import as_slice
from mjrun.task.terms import Action

SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
TRANSMISSIONS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


@dataclass(frozen=True)
class Driven:
    """What one number of the action drives.

    Attributes:
      name: of the actuator or the joint.
      target: `control`, `position`, `velocity` or `torque`.
      control: its place in `ctrl`.
      joint: its id; −1 where actuators are named.
    """

    name: str
    target: str
    control: int
    joint: int = -1

    def actuator(self, model: mujoco.MjModel) -> int:
        """The actuator that the control is one of."""
        return int(np.searchsorted(model.actuator_ctrladr, self.control, side="right")) - 1


class ActionMap:
    """What the action of a task drives, and how.

    Attributes:
      driven: by each of its numbers.
      widths: how many numbers each entry of the actions has.
      scale, offset: `(nact,)`, applied last.
      squashed: which numbers go through tanh first, `(nact,)` bool.
      low, high: `(nact,)`, limits before scale and offset; infinite where there are none.
      kp, kd: gains of position and velocity targets; zero for others.

    Raises:
      UnknownNameError: an actuator, joint or keyframe that the model does not have.
      UsageError: a joint without an actuator of its own, an actuator that is driven twice, or numbers that do not fit.
    """

    def __init__(self, actions: Sequence[Action], model: mujoco.MjModel) -> None:
        self.driven: list[Driven] = []
        self.widths: list[int] = []
        parts: list[np.ndarray] = []
        for index, action in enumerate(actions):
            with concerning("actions", index):
                driven = _driven(action, model)
                self._check_new(driven, action)
                self.driven += driven
                self.widths.append(len(driven))
                parts.append(_numbers(action, driven, model))
        self.squashed, self.low, self.high, self.scale, self.offset, self.kp, self.kd = (
            np.concatenate(parts, axis=1) if parts else np.zeros((7, 0))
        )
        self.squashed = self.squashed.astype(bool)
        self._is_squashed = bool(self.squashed.any())
        self._is_scaled = bool((self.scale != 1).any())
        self._is_clipped = bool(np.isfinite([self.low, self.high]).any())

    @property
    def names(self) -> list[str]:
        """Of the numbers of the action: actuators or joints."""
        return [each.name for each in self.driven]

    def targets(self, actions: np.ndarray) -> np.ndarray:
        """What the actions `(…, nact)` ask for: squashed, clipped, scaled and offset, in that order."""
        targets = np.where(self.squashed, np.tanh(actions), actions) if self._is_squashed else actions
        targets = targets.clip(self.low, self.high) if self._is_clipped else targets
        targets = targets * self.scale if self._is_scaled else targets
        return targets + self.offset

    def _check_new(self, driven: Sequence[Driven], action: Action) -> None:
        known = {each.control for each in self.driven}
        for each in driven:
            if each.control in known:
                what = "actuators" if action.joints is None else "joints"
                raise UsageError(f"the actuator of {quoted(each.name)} is driven twice", (what,))
            known.add(each.control)


class TargetTorques:
    """The controls that hold position and velocity targets, at every step of n worlds.

    Args:
      actions: what is driven.
      count: worlds.
    """

    def __init__(self, actions: ActionMap, model: mujoco.MjModel, count: int) -> None:
        self._places, self._held = _of(actions, POSITION, VELOCITY), _of(actions, POSITION)
        held = [actions.driven[i] for i in self._places]
        joints = np.array([each.joint for each in held], int)
        self._controls = np.array([each.control for each in held], int)
        self._qpos, self._qvel = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._kp, self._kd = actions.kp[self._places], actions.kd[self._places]
        is_position = np.isin(self._places, self._held)
        self._is_position = is_position

        self._direct = _of(actions, CONTROL, TORQUE)
        self._direct_controls = as_slice(np.array([actions.driven[i].control for i in self._direct], int))
        self._direct = as_slice(self._direct)
        self._driven = actions.driven
        self._has_strengths = any(driven.target != CONTROL for driven in actions.driven)
        self._strength = np.ones((count, len(actions.driven)))  # torque or force of a joint per control

    @property
    def is_needed(self) -> bool:
        """Whether controls change with every step."""
        return bool(len(self._places))

    def controls_alone(self, ctrl: np.ndarray) -> np.ndarray | None:
        """The part of the controls `(nu,)` of a single world that targets are put into as they are; None if none is."""
        is_direct = isinstance(self._direct, slice) and self._direct.stop == len(self._driven)
        is_alike = is_direct and isinstance(self._direct_controls, slice) and not self._has_strengths
        return ctrl[self._direct_controls] if is_alike else None

    def begin(self, world: int, model: mujoco.MjModel) -> None:
        """Takes note of the actuators of the model of a world."""
        if not self._has_strengths:
            return
        for index, driven in enumerate(self._driven):
            if driven.target != CONTROL:
                actuator = driven.actuator(model)
                self._strength[world, index] = model.actuator_gear[actuator, 0] * model.actuator_gainprm[actuator, 0]

    def apply(self, targets: np.ndarray, ctrl: np.ndarray, rows: slice | np.ndarray | int) -> None:
        """Puts what does not change during a control period into `ctrl` `(n, nu)`, in the worlds `rows`."""
        controls = targets / self._strength[rows] if self._has_strengths else targets
        _put(controls[..., self._direct], ctrl, rows, self._direct_controls)

    def hold(
        self, targets: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray, rows: slice | np.ndarray | int
    ) -> None:
        """Puts what holds the targets `(k, nact)` at this step into `ctrl`; `qpos` and `qvel` are of all worlds."""
        wanted, velocity = targets[..., self._places], qvel[rows][..., self._qvel]
        pull = np.where(self._is_position, self._kp * (wanted - qpos[rows][..., self._qpos]), 0.0)
        brake = self._kd * (np.where(self._is_position, 0.0, wanted) - velocity)
        controls = (pull + brake) / self._strength[rows][..., self._places]
        _put(controls, ctrl, rows, self._controls)


def _put(controls: np.ndarray, ctrl: np.ndarray, rows: slice | np.ndarray | int, columns: slice | np.ndarray) -> None:
    """Puts `controls` into some columns of `ctrl` `(n, nu)`, in the worlds `rows`."""
    if isinstance(rows, np.ndarray) and isinstance(columns, np.ndarray):
        ctrl[rows[:, None], columns] = controls
    else:
        ctrl[rows, columns] = controls


def _of(actions: ActionMap, *targets: str) -> np.ndarray:
    """The places of the numbers that have one of these targets."""
    return np.array([index for index, each in enumerate(actions.driven) if each.target in targets], int)


def _driven(action: Action, model: mujoco.MjModel) -> list[Driven]:
    if action.actuators is not None:
        known, driven = control_names(model), []
        for index, pattern in enumerate(action.actuators):
            with concerning("actuators", index):
                places = [i for part in control_slices(model, pattern) for i in range(part.start, part.stop)]
            driven += [Driven(known[place], CONTROL, place) for place in places]
        return _unique(driven)
    assert action.joints is not None
    assert action.target is not None
    driven = []
    for index, pattern in enumerate(action.joints):
        with concerning("joints", index):
            pairs = [(joint, _actuators(model, joint)) for joint in matching(model, "joint", pattern)]
            if len(pairs) > 1:  # `*` means those that can be driven
                pairs = [(joint, actuators) for joint, actuators in pairs if len(actuators) == 1]
            if not pairs:
                raise UsageError(f"no joint {quoted(pattern)} has an actuator of its own")
            made = [_driven_joint(model, joint, actuators, action.target) for joint, actuators in pairs]
        if action.target != CONTROL:
            for each in made:
                _require_motor(model, each)
        driven += made
    return _unique(driven)


def _unique(driven: Sequence[Driven]) -> list[Driven]:
    """Each once, where a wildcard names again what stands before it."""
    return list(dict.fromkeys(driven))


def _actuators(model: mujoco.MjModel, joint: int) -> list[int]:
    """The actuators of a joint."""
    is_of_joint = np.isin(model.actuator_trntype, TRANSMISSIONS) & (model.actuator_trnid[:, 0] == joint)
    return np.flatnonzero(is_of_joint).tolist()


def _driven_joint(model: mujoco.MjModel, joint: int, actuators: Sequence[int], target: str) -> Driven:
    name = names(model, "joint")[joint]
    if len(actuators) != 1:
        raise UsageError(f"joint {quoted(name)} has {counted(len(actuators), 'actuator')}, not one")
    (actuator,) = actuators
    if int(model.jnt_type[joint]) not in SCALAR:
        raise UsageError(f"joint {quoted(name)} is no hinge or slide")
    return Driven(name, target, int(model.actuator_ctrladr[actuator]), joint)


def _require_motor(model: mujoco.MjModel, driven: Driven) -> None:
    """Checks that the actuator of a joint turns a control into a torque, and nothing else."""
    actuator = driven.actuator(model)
    is_motor = (
        int(model.actuator_gaintype[actuator]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        and int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_NONE)
        and int(model.actuator_dyntype[actuator]) == int(mujoco.mjtDyn.mjDYN_NONE)
        and model.actuator_gainprm[actuator, 0] * model.actuator_gear[actuator, 0] != 0
    )
    if not is_motor:
        motor = quoted(names(model, "actuator")[actuator])
        raise UsageError(
            f"the actuator {motor} of joint {quoted(driven.name)} is no motor, whose control is a torque\n"
            f"a {option('target')} control is what its own control means",
            ("target",),
        )


def _numbers(action: Action, driven: Sequence[Driven], model: mujoco.MjModel) -> np.ndarray:
    """Squashed or not, low, high, scale, offset, kp, kd: `(7, nact)`."""
    count = len(driven)
    low, high = action.clip or ((-np.inf,), (np.inf,))
    return np.array(
        [
            np.full(count, action.squash == "tanh"),
            spread("clip", low, count),
            spread("clip", high, count),
            spread("scale", action.scale, count),
            _offset(action.offset, driven, model),
            spread("kp", action.kp or (0.0,), count),
            spread("kd", action.kd or (0.0,), count),
        ]
    )


def spread(name: str, numbers: Numbers, count: int) -> np.ndarray:
    """One number, or one for each of `count` components, of the option `name`, as `(count,)`.

    Raises:
      BadValueError: there are as many as do not fit.
    """
    if len(numbers) not in (1, count):
        text = ", ".join(f"{number:g}" for number in numbers)
        raise BadValueError(option(name), text, f"one number, or {count}, one for each component")
    return np.array(np.broadcast_to(numbers, count))


def _offset(offset: Numbers | str, driven: Sequence[Driven], model: mujoco.MjModel) -> np.ndarray:
    if not isinstance(offset, str):
        return spread("offset", offset, len(driven))
    with concerning("offset"):
        key = identify(model, "keyframe", offset)
    values = []
    for each in driven:
        if each.joint < 0:
            values.append(model.key_ctrl[key, each.control])
        elif each.target == VELOCITY:
            values.append(model.key_qvel[key, model.jnt_dofadr[each.joint]])
        elif each.target == TORQUE:
            raise UsageError(f"{option('offset')}: a keyframe holds no torques")
        else:
            values.append(model.key_qpos[key, model.jnt_qposadr[each.joint]])
    return np.array(values)
