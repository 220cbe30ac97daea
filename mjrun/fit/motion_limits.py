"""What a motion must stay within: ranges of joints and forces, and speeds."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjrun.errors import clean
from mjrun.model.column import Column
from mjrun.probe.fields import field_probe

SLACK = 0.01  # of a range, by which a motion stays away from its ends
FIELDS = ("qpos", "qvel", "actuator_force", "qfrc_actuator")
_SLIDING = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)

Floats = NDArray[np.float64]


class MotionLimits:
    """Limits of the hinges, slides and actuators of a model.

    Args:
      speed: of every hinge [rad/s] and slide [m/s], at most; None without a limit.

    Attributes:
      columns: what is limited: positions, velocities and forces.
      low, high: limits of each, infinite without one.
      positions: which of them are the positions of hinges and slides.
    """

    def __init__(self, model: mujoco.MjModel, speed: float | None) -> None:
        ranges = {field: np.tile([-np.inf, np.inf], (len(field_probe(model, field).columns), 1)) for field in FIELDS}
        limits = {field: np.zeros(len(values), bool) for field, values in ranges.items()}
        for joint in np.flatnonzero(np.isin(model.jnt_type, _SLIDING)):
            position, velocity = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            limits["qpos"][position] = limits["qvel"][velocity] = True
            if model.jnt_limited[joint]:
                ranges["qpos"][position] = model.jnt_range[joint]
            if speed is not None:
                ranges["qvel"][velocity] = -speed, speed
            if model.jnt_actfrclimited[joint]:
                limits["qfrc_actuator"][velocity] = True
                ranges["qfrc_actuator"][velocity] = model.jnt_actfrcrange[joint]
        limited = model.actuator_forcelimited.astype(bool)
        limits["actuator_force"] |= limited
        ranges["actuator_force"][limited] = model.actuator_forcerange[limited]

        self.columns: list[Column] = []
        for field in FIELDS:
            self.columns += [
                c for c, keep in zip(field_probe(model, field).columns, limits[field], strict=True) if keep
            ]
        self.low, self.high = np.concatenate([ranges[field][limits[field]] for field in FIELDS]).T
        self.positions = slice(0, int(limits["qpos"].sum()))

    def violation(self, rows: Floats) -> str | None:
        """What in rows of `columns`, `(n, columns)`, is beyond a limit, in words; None if all is within."""
        if not np.isfinite(rows).all():
            return "the simulation becomes unstable"
        slack = np.where(np.isfinite(self.high - self.low), SLACK * (self.high - self.low), 0.0)
        over = np.maximum(self.low + slack - rows, rows - (self.high - slack))
        if (over <= 0).all():
            return None
        row, index = np.unravel_index(np.argmax(over / np.where(slack > 0, slack, 1.0)), over.shape)
        column, value = self.columns[int(index)], rows[row, index]
        limits = f"{self.low[index]:g} … {self.high[index]:g} {column.unit}".rstrip()
        return f"{clean(column.name)} comes to {value:.4g}, where {limits} is its range"
