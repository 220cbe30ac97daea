"""The shake of a hand-held camera."""

import math

import numpy as np

from mjrun.options.number_kinds import Integer, Real
from mjrun.options.option import Options, option, options

SINES = 16  # terms in the sum that is the noise on an angle


@options
class Shake(Options):
    """The shake of a hand-held camera: smooth noise on the direction of view."""

    angle: float = option(converter=Real(), default=0.3, kw_only=False, help="Standard deviation of each angle [deg].")
    frequency: float = option(
        converter=Real(above=0), default=2.0, kw_only=False, help="Frequency of the shake [Hz], in video time."
    )
    seed: int = option(converter=Integer(), default=0, kw_only=False, help="Seed of the shake.")


class ShakeNoise:
    """Smooth noise on two angles: sums of sines with random phases, of 0.5 to 1.5 times the frequency.

    Over a long time the standard deviation is exactly `shake.angle`: since frequencies differ, the variances of the
    sines add up.
    """

    def __init__(self, shake: Shake) -> None:
        random = np.random.default_rng(shake.seed).random((2, 2, SINES))
        self._amplitude = shake.angle * math.sqrt(2 / SINES)
        self._frequencies = shake.frequency * (0.5 + (np.arange(SINES) + random[0]) / SINES)
        self._phases = random[1]

    def at(self, video_time: float) -> np.ndarray:
        """Returns pan and tilt `(2,)` [deg] at a time of the video [s]."""
        turns = self._frequencies * video_time + self._phases
        return self._amplitude * np.sin(2 * math.pi * turns).sum(axis=1)
