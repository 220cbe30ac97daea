"""Chirps for the actuators of a model, and the limits within which controls and motions stay."""

import math

import mujoco
import numpy as np

from mjrun.errors import UsageError, clean, option
from mjrun.fitting.rotations_and_noise import Floats
from mjrun.model.names import SCALAR_JOINTS, control_names
from mjrun.model.table_column import Column
from mjrun.probe.fields import field_probe

FREQUENCIES = (0.1, 10.0)  # [Hz]
SWEEP = 3.0  # least ratio of the two frequencies of a chirp
WEAKEST = 0.3  # least amplitude of a chirp, as a share of its range
TAPER = 0.2  # share of the time in which chirps swell and fade


def chirps(times: Floats, middle: Floats, reach: Floats, generator: np.random.Generator) -> Floats:
    """Draws a chirp for each actuator: controls at `times`, `(n, nu)`, within `middle` ± `reach`.

    They begin and end at `middle`. Frequencies grow or fall exponentially between two random ones.
    """
    from scipy.signal import windows

    envelope = windows.tukey(len(times), TAPER)[:, None]
    waves = np.column_stack([_wave(times - times[0], generator) for _ in middle])
    amplitudes = generator.uniform(WEAKEST, 1.0, len(middle)) * reach
    return np.asarray(middle + envelope * amplitudes * waves, np.float64)


def _wave(times: Floats, generator: np.random.Generator) -> Floats:
    least, most = np.log(FREQUENCIES)
    low = generator.uniform(least, most - math.log(SWEEP))
    high = generator.uniform(low + math.log(SWEEP), most)
    first, last = np.exp([low, high] if generator.random() < 0.5 else [high, low])
    rate = math.log(last / first) / times[-1]
    return np.sin(2 * math.pi * first * np.expm1(rate * times) / rate)


def control_room(model: mujoco.MjModel, controls: Floats) -> tuple[Floats, Floats]:
    """Returns the centre of each control's chirp and the largest amplitude, `(nu,)` each.

    Chirps are centred on `controls` where these are within the control range, otherwise on its middle. A position servo
    without a control range has the range of its joint.

    Raises:
      UsageError: a control has no limits.
    """
    middle, reach = np.zeros(model.nu), np.zeros(model.nu)
    names = control_names(model)
    for index in range(model.nu):
        bounds = _range(model, index)
        if bounds is None:
            raise UsageError(
                f"{option('excite')}: ctrl/{clean(str(names[index]))} has no limits\n"
                f"give it a range: {option('set')} actuator/{clean(str(names[index]))}.ctrlrange=-1,1"
            )
        low, high = bounds
        center = float(controls[index]) if low < controls[index] < high else (low + high) / 2
        middle[index], reach[index] = center, min(center - low, high - center)
    return middle, reach


def _range(model: mujoco.MjModel, index: int) -> tuple[float, float] | None:
    if model.actuator_ctrllimited[index]:
        low, high = model.actuator_ctrlrange[index].tolist()
        return low, high
    joint = int(model.actuator_trnid[index, 0])
    is_of_joint = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT
    is_servo = model.actuator_biasprm[index, 1] == -model.actuator_gainprm[index, 0] != 0
    if not (is_of_joint and is_servo and model.jnt_limited[joint]):
        return None
    low, high = sorted((model.jnt_range[joint] * model.actuator_gear[index, 0]).tolist())
    return low, high


SLACK = 0.01  # margin at both ends of a range, as a share of it
FIELDS = ("qpos", "qvel", "actuator_force", "qfrc_actuator")


class MotionLimits:
    """Limits of the hinges, slides and actuators of a model.

    Args:
      speed: maximum speed of every hinge [rad/s] and slide [m/s]; None if unlimited.

    Attributes:
      columns: limited positions, velocities and forces.
      low, high: limits of each column, infinite without one.
      positions: slice of `columns` with the positions of hinges and slides.
    """

    def __init__(self, model: mujoco.MjModel, speed: float | None) -> None:
        ranges = {field: np.tile([-np.inf, np.inf], (len(field_probe(model, field).columns), 1)) for field in FIELDS}
        limits = {field: np.zeros(len(values), bool) for field, values in ranges.items()}
        for joint in np.flatnonzero(np.isin(model.jnt_type, SCALAR_JOINTS)):
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
        """Describes the worst violation of a limit in rows of `columns`, `(n, columns)`, or None."""
        if not np.isfinite(rows).all():
            return "the simulation becomes unstable"
        slack = np.where(np.isfinite(self.high - self.low), SLACK * (self.high - self.low), 0.0)
        over = np.maximum(self.low + slack - rows, rows - (self.high - slack))
        if (over <= 0).all():
            return None
        row, index = np.unravel_index(np.argmax(over / np.where(slack > 0, slack, 1.0)), over.shape)
        column, value = self.columns[int(index)], rows[row, index]
        limits = f"{self.low[index]:g} … {self.high[index]:g} {column.unit}".rstrip()
        return f"{clean(column.name)} reaches {value:.4g}, beyond its range {limits}"
