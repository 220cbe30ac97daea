"""The one simulation loop: steps once, and lets any number of taps look on."""

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, takewhile
from operator import itemgetter
from typing import Generic, Protocol, TypeVar

from mjrun.physics.stepper import Stepper

T = TypeVar("T")


@dataclass(frozen=True)
class Tap(Generic[T]):
    """A cadence, a read and a write.

    Args:
      steps: when to look, in non-decreasing order; a step that occurs twice is written twice.
      read: what to take from the stepper; it must not change it.
      write: where to put it.
    """

    steps: Sequence[int]
    read: Callable[[Stepper], T]
    write: Callable[[T], object]

    def take(self, stepper: Stepper) -> None:
        """Reads from the stepper, and writes."""
        self.write(self.read(stepper))


class AnyTap(Protocol):
    """A tap, whatever it takes."""

    @property
    def steps(self) -> Sequence[int]: ...

    def take(self, stepper: Stepper) -> None: ...


def observe(stepper: Stepper, taps: Sequence[AnyTap], until: int) -> None:
    """Moves `stepper` to step `until`, and serves every tap on the way.

    Taps that share a step see the same instant; none sees a step beyond `until`. Observing does not
    change the motion: it is bit for bit that of a run without taps.

    Raises:
      SimulationError: as soon as a step fails; what was written before is good.
    """
    looks = takewhile(lambda look: look[0] <= until, heapq.merge(*map(_schedule, taps), key=itemgetter(0)))
    for step, due in groupby(looks, key=itemgetter(0)):
        stepper.advance(step)
        for _, tap in due:
            tap.take(stepper)
    stepper.advance(until)


def _schedule(tap: AnyTap) -> Iterator[tuple[int, AnyTap]]:
    return ((step, tap) for step in tap.steps)
