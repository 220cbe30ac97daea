"""Numbers that change over time: ramps with their easings, blends from shot to shot, and the shake of a camera."""

import math
from collections.abc import Callable

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.options.kinds import Choice
from mjrun.options.number_kinds import Integer, Real
from mjrun.options.option import Options, option, options

# Rise monotonically from 0 to 1 as u does.
EASINGS: dict[str, Callable[[float], float]] = {
    "linear": lambda u: u,
    "cosine": lambda u: 0.5 - math.cos(math.pi * u) / 2,
    "smooth": lambda u: u * u * (3 - 2 * u),
    "smoother": lambda u: u**3 * (u * (6 * u - 15) + 10),  # K. Perlin, "Improving Noise", 2002
    "in": lambda u: u * u,
    "out": lambda u: u * (2 - u),
}
# Rise from 0 to 1 around 0, in widths of the blend: all but the sigmoid from -1/2 to 1/2.
BLENDS: dict[str, Callable[[float], float]] = {
    "cosine": lambda x: EASINGS["cosine"](min(max(x + 0.5, 0.0), 1.0)),
    "linear": lambda x: min(max(x + 0.5, 0.0), 1.0),
    "smooth": lambda x: EASINGS["smooth"](min(max(x + 0.5, 0.0), 1.0)),
    "sigmoid": lambda x: 1 / (1 + math.exp(-min(max(x, -60.0), 60.0))),
}

NEGLIGIBLE = 1e-12  # a weight without visible effect
SAME_TIME = 1e-9  # [s], difference of times caused by rounding
SINES = 16  # terms in the sum that is the noise on an angle


@dataclass(frozen=True)
class EasedNumber:
    """A number that changes from `start` to `end` over a shot, by one of `EASINGS`."""

    start: float
    end: float
    ease: str = "linear"

    @classmethod
    def still(cls, value: float) -> "EasedNumber":
        """Returns a ramp that does not change."""
        return cls(value, value)

    def at(self, phase: float) -> float:
        """Returns the value at `phase` of the shot, from 0 to 1."""
        return self.start + (self.end - self.start) * EASINGS[self.ease](phase)


@options
class Blend(Options):
    """The transition from one shot to the next."""

    shape: str = option(
        converter=Choice((*BLENDS,)), default="cosine", kw_only=False, help="The shape of the transition."
    )
    width: float = option(
        converter=Real(above=0),
        default=0.5,
        kw_only=False,
        help="Duration of the transition [s]; for a sigmoid, the time from 1/2 to 1/(1+e).",
    )


def blend_weight(blend: Blend | None, since: float) -> float:
    """Returns the weight of a shot, `since` it began [s], from 0 to 1; without a blend, a step."""
    if blend is None:
        return float(since >= -SAME_TIME)
    value = BLENDS[blend.shape](since / blend.width)
    return 0.0 if value < NEGLIGIBLE else 1.0 if value > 1 - NEGLIGIBLE else value


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
