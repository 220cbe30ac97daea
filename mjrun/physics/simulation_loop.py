"""The simulation loop: it takes each step once, and serves any number of taps."""

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, takewhile
from operator import itemgetter
from typing import Any, Generic, TypeVar

from mjrun.dataclass import dataclass
from mjrun.physics.stepper import Stepper

T = TypeVar("T")


@dataclass(frozen=True)
class Tap(Generic[T]):
    """A cadence, a read and a write.

    Args:
      steps: the steps at which it reads, in non-decreasing order; at a repeated step it writes twice.
      read: reads from the stepper, without changing it.
      write: receives the result.
    """

    steps: Sequence[int]
    read: Callable[[Stepper], T]
    write: Callable[[T], object]

    def take(self, stepper: Stepper) -> None:
        """Reads from the stepper, and writes."""
        self.write(self.read(stepper))


AnyTap = Tap[Any]


def run_with_taps(stepper: Stepper, taps: Sequence[AnyTap], until: int) -> None:
    """Moves `stepper` to step `until`, and serves every tap on the way.

    Taps of the same step read the same instant; none reads a step beyond `until`. Observation does not change the
    motion: it is bit for bit that of a run without taps.

    Raises:
      SimulationError: a step fails; everything written before is valid.
    """
    looks = takewhile(lambda look: look[0] <= until, heapq.merge(*map(_schedule, taps), key=itemgetter(0)))
    for step, due in groupby(looks, key=itemgetter(0)):
        stepper.advance(step)
        for _, tap in due:
            tap.take(stepper)
    stepper.advance(until)


def _schedule(tap: AnyTap) -> Iterator[tuple[int, AnyTap]]:
    return ((step, tap) for step in tap.steps)
