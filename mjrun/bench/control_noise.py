"""The control noise of MuJoCo's `testspeed`: smoothed pseudo-random noise on every control.

It keeps a model from settling, where warm starts make steps unrealistically cheap, and is the same on every machine.
"""

import math

import mujoco
import numpy as np

STD, RATE = 0.01, 0.1  # as in testspeed


def halton(index: np.ndarray, base: int) -> np.ndarray:
    """Returns the elements `index` `(n,)` of the Halton sequence of a base, in [0, 1), bit for bit as `mju_Halton`.

    They are the digits of the index, mirrored at the point: Halton 1960, Numerische Mathematik 2, 84-90.
    """
    rest, weight, elements = np.array(index), 1 / base, np.zeros(len(index))
    while rest.any():
        rest, digit = np.divmod(rest, base)
        elements += weight * digit
        weight /= base
    return elements


def controls(
    model: mujoco.MjModel, steps: int, std: float = STD, rate: float = RATE, center: np.ndarray | None = None
) -> np.ndarray:
    """Returns the controls of every step, `(steps, nu)`, as in MuJoCo 4.0's `sample/testspeed.cc`.

    Each control returns to its centre exponentially, is pushed by an element of a Halton sequence, and stays in its
    range: an Ornstein-Uhlenbeck process, except that its noise is uniform instead of Gaussian.

    Args:
      std: scale of the noise in half ranges of the actuator, or in its units if it has no range.
      rate: time constant of the return [s]; 0 returns immediately.
      center: centre of each control `(nu,)`; None is the middle of its range, or 0 without one.
    """
    limited, (low, high) = model.actuator_ctrllimited.astype(bool), model.actuator_ctrlrange.T
    middle = np.where(limited, 0.5 * (high + low), 0.0) if center is None else np.asarray(center, float)
    keep = math.exp(-model.opt.timestep / rate) if rate else 0.0
    scale = std * math.sqrt(1 - keep * keep) * np.where(limited, 0.5 * (high - low), 1.0)
    pushes = [2 * halton(np.arange(steps), actuator + 2) - 1 for actuator in range(model.nu)]
    low, high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
    noise = scale * np.column_stack(pushes) if model.nu else np.empty((steps, 0))
    last = middle
    for row in noise:
        row += keep * last + (1 - keep) * middle
        np.clip(row, low, high, out=row)
        last = row
    return noise
