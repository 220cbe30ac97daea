"""The mapping of a policy's actions to the controls of actuators."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UsageError, concerning, counted, option, quoted
from mjrun.model.names import SCALAR_JOINTS, actuators_of, control_names, control_slices, identify, matching, names
from mjrun.options.number_kinds import Numbers
from mjrun.options.task import CONTROL, POSITION, TORQUE, VELOCITY
from mjrun.task.batch_columns import as_slice
from mjrun.task.task import Action


@dataclass(frozen=True)
class DrivenActuator:
    """The actuator that a number of the action drives.

    Attributes:
      name: the name of the actuator or the joint.
      target: `control`, `position`, `velocity` or `torque`.
      control: its place in `ctrl`.
      joint: its id; −1 if the task names the actuator.
    """

    name: str
    target: str
    control: int
    joint: int = -1

    def actuator(self, model: mujoco.MjModel) -> int:
        """Returns the actuator of the control."""
        return int(np.searchsorted(model.actuator_ctrladr, self.control, side="right")) - 1

    def strength(self, model: mujoco.MjModel) -> float:
        """Returns the force or torque on the joint per unit of the control."""
        actuator = self.actuator(model)
        return float(self.gear(model) * model.actuator_gainprm[actuator, 0])

    def gear(self, model: mujoco.MjModel) -> float:
        """Returns the gear of the actuator, of which another one may have several."""
        return float(model.actuator_gear[model.actuator_outadr[self.actuator(model)], 0])


class ActionMap:
    """A map from the numbers of an action to the actuators that they drive, with the processing of these numbers.

    Attributes:
      driven: the actuator of each number.
      widths: the number of values of each entry of the actions.
      scale, offset: `(nact,)`, applied last.
      squashed: the numbers that pass through tanh first, `(nact,)` bool.
      low, high: `(nact,)`, limits before scale and offset; infinite without a clip.
      kp, kd: gains of position and velocity targets; zero for others.
      delays: delay of each number `(nact,)` [control periods].

    Raises:
      UnknownNameError: an actuator, joint or keyframe is not in the model.
      UsageError: a joint without a dedicated actuator, an actuator that is driven twice, or a wrong number of values.
    """

    def __init__(self, actions: Sequence[Action], model: mujoco.MjModel) -> None:
        self.driven: list[DrivenActuator] = []
        self.widths: list[int] = []
        parts: list[np.ndarray] = []
        for index, action in enumerate(actions):
            with concerning("actions", index):
                driven = _driven(action, model)
                for each in driven:
                    if any(each.control == other.control for other in self.driven):
                        what = "actuators" if action.joints is None else "joints"
                        raise UsageError(f"the actuator of {quoted(each.name)} is driven twice", (what,))
                    self.driven.append(each)
                self.widths.append(len(driven))
                parts.append(_numbers(action, driven, model))
        self.squashed, self.low, self.high, self.scale, self.offset, self.kp, self.kd = (
            np.concatenate(parts, axis=1) if parts else np.zeros((7, 0))
        )
        self.delays = np.repeat(np.array([action.delay for action in actions], int), self.widths)
        self.squashed = self.squashed.astype(bool)
        self._is_squashed, self._is_all_squashed = bool(self.squashed.any()), bool(self.squashed.all())
        self._is_scaled = bool((self.scale != 1).any())
        self._is_clipped = bool(np.isfinite([self.low, self.high]).any())

    @property
    def names(self) -> list[str]:
        """The names of the numbers of the action: actuators or joints."""
        return [each.name for each in self.driven]

    def targets(self, actions: np.ndarray) -> np.ndarray:
        """Returns the targets of the actions `(…, nact)`: squashed, clipped, scaled and offset, in that order."""
        targets = np.tanh(actions) if self._is_squashed else actions
        targets = (
            targets if self._is_all_squashed or not self._is_squashed else np.where(self.squashed, targets, actions)
        )
        targets = targets.clip(self.low, self.high) if self._is_clipped else targets
        targets = targets * self.scale if self._is_scaled else targets
        return targets + self.offset


class TargetTorques:
    """The torques that hold position and velocity targets, as controls at every step of n worlds.

    Args:
      actions: the actions with their targets.
      count: the number of worlds.
    """

    def __init__(self, actions: ActionMap, model: mujoco.MjModel, count: int) -> None:
        is_held = np.array([each.target in (POSITION, VELOCITY) for each in actions.driven], bool)
        held = [each for each in actions.driven if each.target in (POSITION, VELOCITY)]
        controls = np.array([each.control for each in actions.driven], int)
        self._held, self._held_controls = np.flatnonzero(is_held), controls[is_held]
        self._is_position = np.array([each.target == POSITION for each in held], bool)
        joints = np.array([each.joint for each in held], int)
        self._qpos, self._qvel = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._kp, self._kd = actions.kp[is_held], actions.kd[is_held]

        self._direct, self._direct_controls = as_slice(np.flatnonzero(~is_held)), as_slice(controls[~is_held])
        self._driven = actions.driven
        self._has_strengths = any(driven.target != CONTROL for driven in actions.driven)
        self._strength = np.ones((count, len(actions.driven)))  # torque or force of a joint per control

    @property
    def is_needed(self) -> bool:
        """True where controls change with every step."""
        return bool(len(self._held))

    @property
    def direct_controls(self) -> slice | np.ndarray | None:
        """The places of the targets among the controls, unchanged and in their order; None if some differ."""
        return None if self.is_needed or self._has_strengths else self._direct_controls

    def begin(self, world: int, model: mujoco.MjModel) -> None:
        """Reads the strengths of the actuators from the model of a world."""
        if not self._has_strengths:
            return
        for index, driven in enumerate(self._driven):
            if driven.target != CONTROL:
                self._strength[world, index] = driven.strength(model)

    def apply(self, targets: np.ndarray, ctrl: np.ndarray, rows: slice | np.ndarray | int) -> None:
        """Writes the controls that hold for the whole control period into `ctrl` `(n, nu)`, in the worlds `rows`."""
        controls = targets / self._strength[rows] if self._has_strengths else targets
        _put(controls[..., self._direct], ctrl, rows, self._direct_controls)

    def hold(
        self, targets: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray, rows: slice | np.ndarray | int
    ) -> None:
        """Writes the controls that hold the targets `(k, nact)` at this step; `qpos` and `qvel` are of all worlds."""
        wanted, velocity = targets[..., self._held], qvel[rows][..., self._qvel]
        pull = np.where(self._is_position, self._kp * (wanted - qpos[rows][..., self._qpos]), 0.0)
        brake = self._kd * (np.where(self._is_position, 0.0, wanted) - velocity)
        controls = (pull + brake) / self._strength[rows][..., self._held]
        _put(controls, ctrl, rows, self._held_controls)


def _put(controls: np.ndarray, ctrl: np.ndarray, rows: slice | np.ndarray | int, columns: slice | np.ndarray) -> None:
    """Writes `controls` into some columns of `ctrl` `(n, nu)`, in the worlds `rows`."""
    if isinstance(rows, np.ndarray) and isinstance(columns, np.ndarray):
        ctrl[rows[:, None], columns] = controls
    else:
        ctrl[rows, columns] = controls


def _driven(action: Action, model: mujoco.MjModel) -> list[DrivenActuator]:
    """Returns the actuators of an action, each once, though several patterns may match it."""
    driven: list[DrivenActuator] = []
    for index, pattern in enumerate(action.actuators or ()):
        with concerning("actuators", index):
            places = [place for part in control_slices(model, pattern) for place in range(part.start, part.stop)]
        driven += [DrivenActuator(control_names(model)[place], CONTROL, place) for place in places]

    target = action.target or CONTROL
    for index, pattern in enumerate(action.joints or ()):
        with concerning("joints", index):
            pairs = [(joint, actuators_of(model, joint)) for joint in matching(model, "joint", pattern)]
            if len(pairs) > 1:  # a wildcard selects the joints that can be driven
                pairs = [(joint, actuators) for joint, actuators in pairs if len(actuators) == 1]
            if not pairs:
                raise UsageError(f"no joint {quoted(pattern)} has a dedicated actuator")
            joints = [_driven_joint(model, joint, actuators, target) for joint, actuators in pairs]
        if target != CONTROL:
            for each in joints:
                _require_motor(model, each)
        driven += joints
    return list(dict.fromkeys(driven))


def _driven_joint(model: mujoco.MjModel, joint: int, actuators: Sequence[int], target: str) -> DrivenActuator:
    name = names(model, "joint")[joint]
    if len(actuators) != 1:
        raise UsageError(f"joint {quoted(name)} has {counted(len(actuators), 'actuator')}, not one")
    (actuator,) = actuators
    if int(model.jnt_type[joint]) not in SCALAR_JOINTS:
        raise UsageError(f"joint {quoted(name)} is neither a hinge nor a slide")
    return DrivenActuator(name, target, int(model.actuator_ctrladr[actuator]), joint)


def _require_motor(model: mujoco.MjModel, driven: DrivenActuator) -> None:
    """Checks that the actuator of a joint is a motor: its torque is proportional to its control."""
    actuator = driven.actuator(model)
    is_motor = (
        int(model.actuator_gaintype[actuator]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        and int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_NONE)
        and int(model.actuator_dyntype[actuator]) == int(mujoco.mjtDyn.mjDYN_NONE)
        and driven.strength(model) != 0
    )
    if not is_motor:
        motor = quoted(names(model, "actuator")[actuator])
        raise UsageError(
            f"the actuator {motor} of joint {quoted(driven.name)} is not a motor, whose control is a torque\n"
            f"{option('target')} control passes values to the actuator unchanged",
            ("target",),
        )


def _numbers(action: Action, driven: Sequence[DrivenActuator], model: mujoco.MjModel) -> np.ndarray:
    """Returns squashed (0 or 1), low, high, scale, offset, kp and kd `(7, nact)`."""
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
    """Returns the numbers of the option `name`, one for all or one for each of `count` components, as `(count,)`.

    Raises:
      BadValueError: their number is neither 1 nor `count`.
    """
    if len(numbers) not in (1, count):
        text = ", ".join(f"{number:g}" for number in numbers)
        raise BadValueError(option(name), text, f"one number, or {count}, one for each component")
    return np.array(np.broadcast_to(numbers, count))


def _offset(offset: Numbers | str, driven: Sequence[DrivenActuator], model: mujoco.MjModel) -> np.ndarray:
    if not isinstance(offset, str):
        return spread("offset", offset, len(driven))
    with concerning("offset"):
        key = identify(model, "keyframe", offset)
    values: list[float] = []
    for each in driven:
        if each.joint < 0:
            values.append(model.key_ctrl[key, each.control])
        elif each.target == VELOCITY:
            values.append(model.key_qvel[key, model.jnt_dofadr[each.joint]])
        elif each.target == TORQUE:
            raise UsageError(f"{option('offset')}: a keyframe does not store torques")
        else:
            values.append(model.key_qpos[key, model.jnt_qposadr[each.joint]])
    return np.array(values)
