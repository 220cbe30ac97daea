"""Keyframes, and whether a simulation can start from them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.model.description.actuators import ACTUATOR
from mjrun.model.description.plain_values import JOINT, object_name
from mjrun.model.joint_components import BALL

SLACK = 1e-9  # of a range, for what decimals of an angle cannot say


@dataclass(frozen=True)
class Keyframe:
    """A keyframe.

    Attributes:
      id, name: of the keyframe.
      time: [s].
      finite: every number in it is.
      outside: what lies outside its range, by the names of columns: `qpos/knee`, `ctrl/motor`, `act/muscle`.
    """

    id: int
    name: str
    time: float
    finite: bool
    outside: tuple[str, ...]


def keyframes(model: mujoco.MjModel) -> Iterator[Keyframe]:
    """Every keyframe, in order of id."""
    for i in range(model.nkey):
        fields = (
            *(model.key_qpos, model.key_qvel, model.key_act, model.key_ctrl),
            *(model.key_mpos, model.key_mquat, model.key_plastic),
        )
        yield Keyframe(
            id=i,
            name=object_name(model, mujoco.mjtObj.mjOBJ_KEY, i) or "",
            time=float(model.key_time[i]),
            finite=bool(np.isfinite(model.key_time[i]) and all(np.isfinite(field[i]).all() for field in fields)),
            outside=(*_joints_outside(model, i), *_actuators_outside(model, i)),
        )


def _joints_outside(model: mujoco.MjModel, key: int) -> Iterator[str]:
    for joint in np.flatnonzero(model.jnt_limited):
        qpos = model.key_qpos[key, model.jnt_qposadr[joint] :]
        value = _turned(qpos[:4]) if int(model.jnt_type[joint]) == BALL else qpos[0]
        if _beyond(value, model.jnt_range[joint]):
            yield f"qpos/{object_name(model, JOINT, joint)}"


def _actuators_outside(model: mujoco.MjModel, key: int) -> Iterator[str]:
    for i in range(model.nactuator):
        for k in _block(model.actuator_ctrladr[i], model.actuator_ctrlnum[i]):
            if model.actuator_ctrllimited[k] and _beyond(model.key_ctrl[key, k], model.actuator_ctrlrange[k]):
                yield f"ctrl/{object_name(model, ACTUATOR, i)}"
                break
        for k in _block(model.actuator_actadr[i], model.actuator_actnum[i]):
            if model.actuator_actlimited[i] and _beyond(model.key_act[key, k], model.actuator_actrange[i]):
                yield f"act/{object_name(model, ACTUATOR, i)}"
                break


def _block(start: int, count: int) -> Sequence[int]:
    return range(start, start + count)


def _turned(quaternion: np.ndarray) -> float:
    """The angle of a rotation [rad], which is what the range of a ball joint limits."""
    return 2 * float(np.arctan2(np.linalg.norm(quaternion[1:]), abs(quaternion[0])))


def _beyond(value: float, limits: np.ndarray) -> bool:
    low, high = limits
    slack = SLACK * max(1.0, abs(low), abs(high))
    return bool(value < low - slack or value > high + slack)
