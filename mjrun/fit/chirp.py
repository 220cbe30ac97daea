"""Chirps: controls whose frequency sweeps, one for each actuator, which move a model in many ways in a short time."""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjrun.errors import UsageError, clean, option
from mjrun.model.names import control_names

FREQUENCIES = (0.1, 10.0)  # [Hz]
SWEEP = 3.0  # least ratio of the two frequencies of a chirp
WEAKEST = 0.3  # least amplitude of an actuator's chirp, as a share of what the range has room for
TAPER = 0.2  # share of the time in which chirps come and go

Floats = NDArray[np.float64]


def chirps(times: Floats, middle: Floats, reach: Floats, generator: np.random.Generator) -> Floats:
    """Controls at `times`, `(n, nu)`: about `middle`, by at most `reach`, and at `middle` in the beginning and the end.

    The frequency of each grows or falls exponentially between two that are drawn.
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
    """About what chirps go, and by how much at most, `(nu,)` each: about `controls`, if these leave room for it.

    The room is that of the control range, or for a servo of a joint's position without one, that of the joint.

    Raises:
      UsageError: nothing limits a control.
    """
    middle, reach = np.zeros(model.nu), np.zeros(model.nu)
    names = control_names(model)
    for index in range(model.nu):
        bounds = _range(model, index)
        if bounds is None:
            raise UsageError(
                f"{option('excite')}: nothing limits ctrl/{clean(str(names[index]))}, so how far may it go?\n"
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
