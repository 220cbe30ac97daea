"""The simulation loop: it takes each step once, and serves any number of taps."""

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, takewhile
from operator import itemgetter

from mjrun.dataclass import dataclass
from mjrun.physics.stepper import Stepper


@dataclass(frozen=True)
class Tap:
    """A cadence, and what is recorded at its steps.

    Attributes:
      steps: the steps, in non-decreasing order; at a repeated step it records twice.
      record: reads from the stepper, without changing it, and stores or writes the values; videos and images store
        states, with `StateBuffer.record`.
    """

    steps: Sequence[int]
    record: Callable[[Stepper], object]


def run_with_taps(stepper: Stepper, taps: Sequence[Tap], until: int) -> None:
    """Moves `stepper` to step `until`, and serves every tap on the way.

    Taps of the same step read the same instant; none reads a step beyond `until`. Observation does not change the
    motion: it is bit for bit that of a run without taps.

    Raises:
      SimulationError: a step fails; everything recorded before is valid.
    """
    looks = takewhile(lambda look: look[0] <= until, heapq.merge(*map(_schedule, taps), key=itemgetter(0)))
    for step, due in groupby(looks, key=itemgetter(0)):
        stepper.advance(step)
        for _, tap in due:
            tap.record(stepper)
    stepper.advance(until)


def _schedule(tap: Tap) -> Iterator[tuple[int, Tap]]:
    return ((step, tap) for step in tap.steps)
