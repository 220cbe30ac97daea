"""When events happen in a simulation, and what it looks like then: a recording of every step."""

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.camera.script import Event
from mjrun.errors import UsageError, quoted
from mjrun.job.trace_rows import Table
from mjrun.probe.event import Onsets, condition
from mjrun.sim.observe import Tap
from mjrun.sim.replay import ReplayStepper
from mjrun.sim.state_buffer import StateBuffer
from mjrun.sim.stepper import Stepper
from mjrun.timeline import Timeline


class EventDetector:
    """Looks out for events at every step, and records all of them.

    Args:
      texts: conditions such as `speed(box) > 0.02`.
    """

    def __init__(self, model: mujoco.MjModel, timeline: Timeline, texts: Collection[str]) -> None:
        self._watched = [(condition(text, model), Onsets()) for text in sorted(texts)]
        self._tables = [Table(model, watched.columns, timeline) for watched, _ in self._watched]
        self._timeline = timeline
        self._states = StateBuffer(model)

    def taps(self, until: int) -> list[Tap]:
        """What to look at while the simulation runs."""
        every = range(until + 1)
        return [
            Tap(every, lambda stepper: stepper.state(), self._states.append),
            Tap(every, self._look, lambda _: None),
        ]

    @property
    def found(self) -> Mapping[str, Sequence[int]]:
        """The steps at which each condition begins to hold."""
        return {watched.text: onsets.indices for watched, onsets in self._watched}

    def replay(self, model: mujoco.MjModel) -> ReplayStepper:
        """Goes through the recorded steps once more."""
        return ReplayStepper(model, self._states)

    def close(self) -> None:
        """Frees the recording."""
        self._states.close()

    def _look(self, stepper: Stepper) -> None:
        for (watched, onsets), table in zip(self._watched, self._tables, strict=True):
            row = np.concatenate([[float(self._timeline.time(stepper.step))], table.read(stepper).values])
            onsets.feed(watched.holds(row[None]))


def conditions(events: Collection[Event], model: mujoco.MjModel) -> list[str]:
    """The conditions of `events`, each once, seen to be such as can be measured.

    Raises:
      UsageError: one of them is not.
    """
    found = []
    for event in events:
        try:
            found.append(condition(event.when, model).text)
        except UsageError as error:
            error.add_note(f"in {quoted(event.when)}")
            raise
    return list(dict.fromkeys(found))


def time_of(
    event: Event, steps: Sequence[int], timeline: Timeline, where: str, after: Fraction = Fraction(-1)
) -> Fraction:
    """When `event` happens [s], of those times that are later than `after`.

    Args:
      steps: where its condition begins to hold.
      where: what asks, for errors: `camera.yaml: shots[0]`.

    Raises:
      UsageError: it does not happen, or not often enough, and nothing is said for that case.
    """
    times = [timeline.time(step) for step in steps if timeline.time(step) > after]
    if len(times) >= event.nth:
        return times[event.nth - 1] + event.offset
    if event.otherwise is not None:
        return timeline.duration if event.otherwise == "end" else Fraction(event.otherwise)
    since = f" after {float(after):g} s" if after >= 0 else ""
    often = "never happens" if not times else f"happens {len(times)} times only, not {event.nth},"
    raise UsageError(
        f"{where}: {quoted(event.when)} {often} in the {float(timeline.duration):g} s of the simulation{since}\n"
        "`else: end`, or a time, says what counts then"
    )
