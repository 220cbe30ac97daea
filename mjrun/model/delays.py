"""Delays of actuators and sensors: MuJoCo reads them from a buffer of samples, which has to be long enough.

A buffer that is too short makes the delay shorter, without a word; one that is missing is an error. So that whoever
overrides a delay gets it, the buffer grows with it.
"""

import math
from collections.abc import Iterable

import mujoco

from mjrun.model.override import Override, elements_at
from mjrun.timeline import rational

DELAYED = ("actuator", "sensor")


def lengthen_buffers(spec: mujoco.MjSpec, overrides: Iterable[Override]) -> None:
    """Makes the buffers of all elements whose delay is overridden as long as their delay needs, if they are shorter.

    Args:
      overrides: that were applied to `spec`.
    """
    timestep = spec.option.timestep
    if not timestep > 0:  # which the compiler refuses
        return
    for override in overrides:
        kind, _, rest = override.target.partition("/")
        if kind not in DELAYED or not rest.endswith(".delay"):
            continue
        for element in elements_at(spec, override)[0]:
            element.nsample = max(element.nsample, math.ceil(rational(element.delay) / rational(timestep)))
