"""Detection of the instants at which events happen, with a recording to replay the simulation afterwards."""

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.errors import OptionPath, UsageError, concerning, quoted
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.recorded_states import ReplayStepper, StateBuffer
from mjrun.physics.simulation_loop import AnyTap, Tap
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.row_expression import RisingEdgeDetector, parse_condition
from mjrun.probe.vocabularies import AvailableProbes
from mjrun.task.episode import ControlInstants
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.camera.script import Event


class EventDetector:
    """A detector that evaluates conditions at every step and records the state of every step. To be closed.

    Args:
      texts: conditions such as `speed(box) > 0.02`.
    """

    def __init__(
        self, model: mujoco.MjModel, timeline: Timeline, texts: Collection[str], episode: EpisodeColumns | None = None
    ) -> None:
        available = _vocabulary(model, episode)
        watched = [parse_condition(text, available, "when") for text in sorted(texts)]
        self._conditions = [(each, RisingEdgeDetector()) for each in watched]
        self._tables = [ProbeSampler(model, each.columns, timeline, episode) for each in watched]
        self._timeline = timeline
        self._states, self._instants = StateBuffer(model), ControlInstants()

    def taps(self, until: int) -> list[AnyTap]:
        """Returns the taps that observe the simulation up to step `until`."""
        every = range(until + 1)
        return [
            Tap(every, lambda stepper: stepper.state(), self._states.append),
            Tap(every, self._rows, self._evaluate),
            Tap(every, self._instants.take, lambda _: None),
        ]

    @property
    def event_steps(self) -> Mapping[str, Sequence[int]]:
        """The steps at which each condition begins to hold."""
        return {watched.text: onsets.indices for watched, onsets in self._conditions}

    def replay(self, model: mujoco.MjModel) -> ReplayStepper:
        """Returns a stepper that replays the recorded steps."""
        return self._instants.replay(model, self._states)

    def close(self) -> None:
        """Frees the recording."""
        self._states.close()

    def _rows(self, stepper: Stepper) -> list[dict[str, np.ndarray]]:
        """Returns the columns of each condition by name, `(1,)` each."""
        time = float(self._timeline.time(stepper.step))
        rows: list[dict[str, np.ndarray]] = []
        for table in self._tables:
            values = np.array([time, *table.values(stepper)])[:, None]
            rows.append({column.name: value for column, value in zip(table.columns, values, strict=True)})
        return rows

    def _evaluate(self, rows: Sequence[Mapping[str, np.ndarray]]) -> None:
        for (watched, onsets), row in zip(self._conditions, rows, strict=True):
            onsets.feed(watched.holds(row))


def conditions(
    events: Mapping[OptionPath, "Event"], model: mujoco.MjModel, episode: EpisodeColumns | None = None
) -> list[str]:
    """Returns the conditions of `events` without duplicates.

    Args:
      events: keyed by the option path of each condition.

    Raises:
      UsageError: a condition reads a value that cannot be measured in this simulation.
    """
    available = _vocabulary(model, episode)
    texts: list[str] = []
    for path, event in events.items():
        try:
            with concerning(*path):
                texts.append(parse_condition(event.when, available, "when").text)
        except UsageError as error:
            error.add_note(f"in {quoted(event.when)}")
            raise
    return list(dict.fromkeys(texts))


def _vocabulary(model: mujoco.MjModel, episode: EpisodeColumns | None) -> AvailableProbes:
    return AvailableProbes(model, episode.names if episode else ())


def time_of(
    event: "Event", steps: Sequence[int], timeline: Timeline, where: str, after: Fraction = Fraction(-1)
) -> Fraction:
    """Returns the time of `event` [s], counting only occurrences later than `after`.

    Args:
      steps: the steps at which its condition becomes true.
      where: the location shown in messages, as in `camera.yaml: shots[0]`.

    Raises:
      UsageError: the event happens too rarely or never, and has no `else`.
    """
    times = [timeline.time(step) for step in steps if timeline.time(step) > after]
    if len(times) >= event.nth:
        return times[event.nth - 1] + event.offset
    if event.otherwise is not None:
        return timeline.duration if event.otherwise == "end" else Fraction(event.otherwise)
    since = f" after {float(after):g} s" if after >= 0 else ""
    often = "never happens" if not times else f"happens only {len(times)} times, not {event.nth},"
    raise UsageError(
        f"{where}: {quoted(event.when)} {often} in the {float(timeline.duration):g} s of the simulation{since}\n"
        "add `else: end` or a time to cover this case"
    )
