"""Descriptions of keyframes, with the numbers that prevent a simulation from starting there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.model.description.declaration import ModelObject, computed, of_field
from mjrun.model.names import BALL, names

SLACK = 1e-9  # relative to a range, for the rounding of angles written in decimals


def _joints_outside(model: mujoco.MjModel, key: int) -> Iterator[str]:
    joints = names(model, "joint")
    for joint in np.flatnonzero(model.jnt_limited):
        qpos = model.key_qpos[key, model.jnt_qposadr[joint] :]
        value = _turned(qpos[:4]) if int(model.jnt_type[joint]) == BALL else qpos[0]
        if _beyond(value, model.jnt_range[joint]):
            yield f"qpos/{joints[joint]}"


def _actuators_outside(model: mujoco.MjModel, key: int) -> Iterator[str]:
    for i, name in enumerate(names(model, "actuator")):
        controls = _block(model.actuator_ctrladr[i], model.actuator_ctrlnum[i])
        if any(
            model.actuator_ctrllimited[k] and _beyond(model.key_ctrl[key, k], model.actuator_ctrlrange[k])
            for k in controls
        ):
            yield f"ctrl/{name}"
        activations = _block(model.actuator_actadr[i], model.actuator_actnum[i] if model.actuator_actlimited[i] else 0)
        if any(_beyond(model.key_act[key, k], model.actuator_actrange[i]) for k in activations):
            yield f"act/{name}"


def _block(start: int, count: int) -> Sequence[int]:
    return range(start, start + count)


def _turned(quaternion: np.ndarray) -> float:
    """Returns the angle of a rotation [rad], which the range of a ball joint limits."""
    return 2 * float(np.arctan2(np.linalg.norm(quaternion[1:]), abs(quaternion[0])))


def _beyond(value: float, limits: np.ndarray) -> bool:
    low, high = limits
    slack = SLACK * max(1.0, abs(low), abs(high))
    return bool(value < low - slack or value > high + slack)


def _is_finite(model: mujoco.MjModel, key: int) -> bool:
    fields = (
        *(model.key_time, model.key_qpos, model.key_qvel, model.key_act, model.key_ctrl),
        *(model.key_mpos, model.key_mquat, model.key_plastic),
    )
    return all(bool(np.isfinite(field[key]).all()) for field in fields)


def _outside(model: mujoco.MjModel, key: int) -> tuple[str, ...]:
    return (*_joints_outside(model, key), *_actuators_outside(model, key))


@dataclass(frozen=True)
class Keyframe(ModelObject):
    """A keyframe.

    Attributes:
      time: the time [s].
      finite: true if every number in it is finite.
      outside: the columns whose values are outside their range: `qpos/knee`, `ctrl/motor`, `act/muscle`.
    """

    KIND = "keyframe"

    time: float = of_field("key_time", usual=-1)
    finite: bool = computed(_is_finite)
    outside: tuple[str, ...] = computed(_outside)
