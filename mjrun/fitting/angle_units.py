"""Signs that a log has angles in degrees where the model has radians."""

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjrun.errors import clean, option
from mjrun.model.names import names

BEYOND = 8.0  # multiple of a joint's limit that no measurement in radians reaches
WITHIN = 1.1  # multiple of a joint's limit that a measurement in degrees reaches at most
DEGREES = 180 / np.pi  # in a radian
TOLERANCE = 0.2  # of the ratio of two rates
AGREEMENT = 0.9  # least correlation of two rates


def degree_remarks(
    model: mujoco.MjModel, times: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]]
) -> Iterator[str]:
    """Yields a remark on each hinge whose angles are probably degrees; uncertain cases yield none.

    Degrees are beyond the limits of a joint, and within them once converted; or they change 57 times as fast as the
    measured velocity says.

    Args:
      times: times of the rows [s], `(n,)`.
      signals: measured columns by name, `(n,)` each, NaN for missing values.
    """
    for joint, name in enumerate(names(model, "joint")):
        angles = signals.get(f"qpos/{name}")
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE or angles is None or not np.isfinite(angles).any():
            continue
        peak, limit = float(np.nanmax(np.abs(angles))), float(np.abs(model.jnt_range[joint]).max())
        column = f"qpos/{clean(name)}"
        if model.jnt_limited[joint] and peak > BEYOND * limit and peak / DEGREES <= WITHIN * limit:
            reason = f"{column} reaches {peak:.3g} rad, and the joint is limited to {limit:.3g} rad"
        elif (rates := signals.get(f"qvel/{name}")) is not None and _is_multiple(_rates(angles, times), rates):
            reason = f"{column} changes 57 times as fast as qvel/{clean(name)} says"
        else:
            continue
        yield f"{reason}: if it is in degrees, add {option('map')} '{column}={column}*pi/180'"


def _rates(angles: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.gradient(angles, times), np.float64)


def _is_multiple(changes: NDArray[np.float64], rates: NDArray[np.float64]) -> bool:
    """Returns whether changes of an angle are about `DEGREES` times its measured velocity."""
    known = np.isfinite(changes) & np.isfinite(rates)
    changes, rates = changes[known], rates[known]
    products, squares = float(changes @ rates), float(rates @ rates)
    total = float(np.sqrt(squares * (changes @ changes)))
    return total > 0 and products > AGREEMENT * total and abs(products / squares / DEGREES - 1) < TOLERANCE
