"""How numbers go over time: easings of ramps, shapes of blends, and the trembling of a hand."""

import math
from collections.abc import Callable

import numpy as np

from mjrun.camera.script import Blend, Ramp, Shake

# From 0 to 1 as u does, never back.
EASINGS: dict[str, Callable[[float], float]] = {
    "linear": lambda u: u,
    "cosine": lambda u: 0.5 - math.cos(math.pi * u) / 2,
    "smooth": lambda u: u * u * (3 - 2 * u),
    "smoother": lambda u: u**3 * (u * (6 * u - 15) + 10),  # K. Perlin, "Improving Noise", 2002
    "in": lambda u: u * u,
    "out": lambda u: u * (2 - u),
}
# From 0 to 1 around 0, in widths of the blend: all but the sigmoid from -1/2 to 1/2.
BLENDS: dict[str, Callable[[float], float]] = {
    "cosine": lambda x: EASINGS["cosine"](min(max(x + 0.5, 0.0), 1.0)),
    "linear": lambda x: min(max(x + 0.5, 0.0), 1.0),
    "smooth": lambda x: EASINGS["smooth"](min(max(x + 0.5, 0.0), 1.0)),
    "sigmoid": lambda x: 1 / (1 + math.exp(-min(max(x, -60.0), 60.0))),
}

NOTHING = 1e-12  # a weight that cannot be seen
SAME = 1e-9  # [s], times that differ by a rounding
_SINES = 16


def ramped(ramp: Ramp, u: float) -> float:
    """The value of `ramp` at `u` of its shot, from 0 to 1."""
    return ramp.start + (ramp.end - ramp.start) * EASINGS[ramp.ease](u)


def weight(blend: Blend | None, since: float) -> float:
    """How far a shot has taken over from the one before, `since` it began [s]; 0 and 1 where one cannot be seen."""
    if blend is None:
        return float(since >= -SAME)
    value = BLENDS[blend.shape](since / blend.width)
    return 0.0 if value < NOTHING else 1.0 if value > 1 - NOTHING else value


class Tremor:
    """Smooth noise on two angles: sums of sines with random phases, between half and one and a half of a frequency.

    Over a long time the standard deviation is `shake.angle`, without being estimated: frequencies differ, so
    the variances of the sines add up.
    """

    def __init__(self, shake: Shake) -> None:
        random = np.random.default_rng(shake.seed).random((2, 2, _SINES))
        self._amplitude = shake.angle * math.sqrt(2 / _SINES)
        self._frequencies = shake.frequency * (0.5 + (np.arange(_SINES) + random[0]) / _SINES)
        self._phases = random[1]

    def at(self, film: float) -> np.ndarray:
        """Pan and tilt `(2,)` [deg] at a time of the film [s]."""
        turns = self._frequencies * film + self._phases
        return self._amplitude * np.sin(2 * math.pi * turns).sum(axis=1)
