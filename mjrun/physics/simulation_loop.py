"""The simulation loop, which takes each step once and serves any number of taps."""

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, takewhile
from operator import itemgetter

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model import state
from mjrun.physics.recorded_states import SpooledRows
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


class StateBuffer(SpooledRows):
    """A buffer of integration states `(nstate,)` of one model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        super().__init__(state.size(model))
        self.model = model

    def record(self, stepper: Stepper) -> None:
        """Adds the state of the stepper at the end."""
        self.append(stepper.state())

    @property
    def steps(self) -> np.ndarray:
        """The steps of the states `(n,)`, of a recording of every step."""
        return np.arange(self._count)

    def state(self, index: int) -> np.ndarray:
        """Returns state number `index` as a new array."""
        return self[index].copy()
