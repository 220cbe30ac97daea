"""Numbers that change over time: ramps with their easings, and blends from one shot to the next."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from mjrun.options.kinds import Choice
from mjrun.options.number_kinds import Real
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
