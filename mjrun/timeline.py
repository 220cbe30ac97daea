"""Exact time: the step of each frame and row of a run.

Times are rationals, never sums of floats. A float represents the decimal number it prints as, so a timestep of 0.002
is exactly 1/500.
"""

import math
import re
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

from mjrun.dataclass import dataclass

LENGTHS = 64  # remembered lengths of runs
EXACT = 2**53  # below it every integer is a float
_VAST = re.compile(r"[eE][+-]?\d(_?\d){3}")
FLOAT_ROUNDING = Fraction(1, 2**50)  # relative; more than a product and a quotient of floats are off


def rational(value: float | str | Fraction) -> Fraction:
    """Returns `value` as an exact number: `0.002` is 1/500, `"30000/1001"` is NTSC's frame rate.

    Raises:
      ValueError: the value is not a finite number.
    """
    if isinstance(value, Fraction):
        return value
    try:
        return _rational(value.strip() if isinstance(value, str) else repr(float(value)))
    except (ValueError, ZeroDivisionError, OverflowError):
        raise ValueError(f"not a finite number: {value!r}") from None


@lru_cache(1024)
def _rational(text: str) -> Fraction:
    if _VAST.search(text):  # Fraction would write out every zero
        raise ValueError(text)
    return Fraction(text)


def seconds(steps: Any, timestep: Fraction) -> Any:
    """Returns the times [s] of `steps`, an ordered integer array `(n,)`: exact, then rounded once."""
    above, below = timestep.numerator, timestep.denominator
    if len(steps) and max(1, abs(int(steps[0])), abs(int(steps[-1]))) * above < EXACT and below < EXACT:
        return steps * above / below
    return [step * above / below for step in steps.tolist()]


def nearest(value: Fraction) -> int:
    """Rounds `value` to the nearest integer, halves up, so that even spacing stays even."""
    return math.floor(value + Fraction(1, 2))


def unrounded(quotient: Fraction) -> Fraction:
    """Returns the integer that a quotient of times differs from by the rounding of floats alone, or the quotient.

    `3 * 0.1` is a little more than 0.3, and yet means three times 0.1.
    """
    whole = nearest(quotient)
    return Fraction(whole) if abs(quotient - whole) <= quotient * FLOAT_ROUNDING else quotient


def nanoseconds(time: Fraction) -> int:
    """Returns `time` [s] in nanoseconds, rounded once."""
    return nearest(time * 10**9)


@dataclass(frozen=True)
class Timeline:
    """A run of `steps` steps of `timestep` [s], which lasts `duration` [s].

    `duration` is the requested duration; `steps` is that duration in whole steps.
    """

    timestep: Fraction
    duration: Fraction
    steps: int

    @classmethod
    @lru_cache(LENGTHS)
    def lasting(cls, timestep: Fraction, duration: Fraction) -> "Timeline":
        """Returns the run of `duration` [s]: `round(duration / timestep)` steps."""
        return cls(timestep, duration, nearest(duration / timestep))

    @classmethod
    @lru_cache(LENGTHS)
    def of_steps(cls, timestep: Fraction, steps: int) -> "Timeline":
        """Returns the run of exactly `steps` steps."""
        return cls(timestep, steps * timestep, steps)

    def time(self, step: int) -> Fraction:
        """Returns the simulated time [s] at `step`."""
        return step * self.timestep

    def frame_steps(self, fps: Fraction, speed: Fraction = Fraction(1)) -> list[int]:
        """Returns the step of each frame of a video.

        Frame k shows time k·speed/fps; the frames are the k with k·speed/fps < duration, so the video
        lasts duration/speed. A run without steps has one frame.
        """
        return self.paced(fps, [(self.duration, speed)])[0]

    def paced(self, fps: Fraction, pieces: Sequence[tuple[Fraction, Fraction]]) -> list[list[int]]:
        """Returns the steps of the frames of a video whose speed changes, piece by piece.

        Args:
          pieces: the simulated time [s] at which each piece ends, in order, and its speed.
        """
        steps_of_parts: list[list[int]] = []
        first, start, shown = 0, Fraction(0), Fraction(0)  # frame, simulated time and time of the video [s]
        for end, speed in pieces:
            until = shown + (end - start) / speed
            last = math.ceil(until * fps)
            steps_of_parts.append(self._every(speed / fps, range(first, last), start - shown * speed))
            first, start, shown = last, end, until
        if not any(steps_of_parts):  # since its end condition holds in the initial state
            steps_of_parts[0] = [0]
        return steps_of_parts

    def rows(self, every: int = 1, rate: Fraction | None = None) -> Sequence[int]:
        """Returns the step of each row of a trace: 0, s, 2s, … ≤ `steps`, the last step included.

        s is `every` steps, or the time between rows at `rate` [Hz].
        """
        period = self.timestep * every if rate is None else 1 / rate
        spacing = period / self.timestep
        if spacing <= 1:  # a rate above that of the steps gives a row at every step
            return range(self.steps + 1)
        if spacing.denominator == 1 and self.steps % spacing.numerator == 0:
            return range(0, self.steps + 1, spacing.numerator)
        count = math.floor(self.steps * self.timestep / period) + 1
        rows = self._every(period, range(count))
        return rows if rows[-1] == self.steps else [*rows, self.steps]

    def _every(self, period: Fraction, numbers: range, offset: Fraction = Fraction(0)) -> list[int]:
        """Returns the steps nearest to `offset` + k·`period` [s] for the `numbers` k."""
        # floor((offset + k·period)/timestep + 1/2) in integers: a Fraction per frame is 20 times slower.
        ratio, shift = period / self.timestep, offset / self.timestep
        below = math.lcm(ratio.denominator, shift.denominator)
        a, c = int(ratio * below), int(shift * below)
        return [min((2 * (c + k * a) + below) // (2 * below), self.steps) for k in numbers]
