"""Which step belongs to a moment of wall time."""

import math
from fractions import Fraction

LATE = 0.1  # the share of wall time given up from which on a simulation is too slow
WATCHED = 3.0  # [s] of wall time before that is said


class Pace:
    """Keeps the steps of a simulation in time with the wall clock, as far as they can be.

    Args:
      timestep: of the simulation [s].
      speed: simulated seconds per second of wall time.

    Attributes:
      speed: as given; after a change, `start` begins anew with it.
    """

    def __init__(self, timestep: Fraction, speed: float) -> None:
        self.speed = speed
        self._timestep = float(timestep)
        self.start(0, 0.0)

    def start(self, step: int, now: float) -> None:
        """From here on, the step `step` belongs to the wall time `now` [s]."""
        self._first, self._begin = step, now
        self._lost = 0.0  # [s] of wall time

    def due(self, now: float) -> int:
        """The step that should be reached at `now` [s]."""
        return self._first + math.floor((now - self._begin - self._lost) * self.speed / self._timestep)

    def give_up(self, step: int, now: float) -> None:
        """Goes on from `step` at `now` [s], which is too early for it; what is missing is never caught up with."""
        self._lost = now - self._begin - (step - self._first) * self._timestep / self.speed

    def is_too_slow(self, now: float) -> bool:
        """Whether the simulation cannot keep up: a good share of the wall time until `now` [s] was given up."""
        ran = now - self._begin
        return ran > WATCHED and self._lost > LATE * ran

    def achieved(self, step: int, now: float) -> float:
        """Simulated seconds per second of wall time since the start, when `step` is reached at `now` [s]."""
        ran = now - self._begin
        return (step - self._first) * self._timestep / ran if ran > 0 else self.speed
