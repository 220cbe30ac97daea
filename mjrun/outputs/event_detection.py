"""Conditions in time: events that outputs wait for, marks on a time line, and the end of a simulation."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import OptionPath, SimulationError, UsageError, concerning, option, quoted
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.outputs.trace_rows import ProbeSampler, RowBuffer, SampledRows
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.simulation_loop import StateBuffer, Tap
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.row_expression import Condition, RisingEdgeDetector, named_condition, parse_condition
from mjrun.probe.vocabularies import ModelVocabulary, TraceVocabulary
from mjrun.simulation.simulation import Simulation
from mjrun.task.episode import ControlInstants
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.camera.script import ConditionEvent
    from mjrun.probe.verdict import Verdict

MOST = 200  # marks of one condition


class ConditionDetector:
    """A detector of the steps at which conditions begin to hold, which evaluates them at every step.

    Args:
      read: columns that are measured in addition to those of the conditions.

    Attributes:
      table: measures the columns.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        timeline: Timeline,
        conditions: Sequence[Condition],
        episode: EpisodeColumns | None = None,
        read: Sequence[str] = (),
    ) -> None:
        self._conditions = [(condition, RisingEdgeDetector()) for condition in conditions]
        columns = [name for condition in conditions for name in condition.columns]
        names = [name for name in dict.fromkeys([*columns, *read]) if name != "time"]
        self.table = ProbeSampler(model, names, timeline, episode)

    def tap(self, until: int) -> Tap:
        """Returns the tap that evaluates every step up to `until`."""
        steps = range(until + 1)
        self._buffer = RowBuffer(self.table, steps, self.evaluate)
        return Tap(steps, self._buffer.record)

    def onsets(self) -> list[Sequence[int]]:
        """Returns the steps at which each condition begins to hold."""
        self._buffer.flush()
        return [onsets.indices for _, onsets in self._conditions]

    def evaluate(self, rows: SampledRows) -> None:
        """Evaluates the next steps."""
        values: Mapping[str, object] = dict(zip(self.table.names, rows.values.T, strict=True))
        for condition, onsets in self._conditions:
            onsets.feed(condition.holds(values))


class EventDetector(ConditionDetector):
    """A detector that also records the state of every step. To be closed.

    Args:
      texts: conditions such as `speed(box) > 0.02`.
    """

    def __init__(
        self, model: mujoco.MjModel, timeline: Timeline, texts: Collection[str], episode: EpisodeColumns | None = None
    ) -> None:
        available = _vocabulary(model, episode)
        self._watched = [parse_condition(text, available, "when") for text in sorted(texts)]
        super().__init__(model, timeline, self._watched, episode)
        self._states, self._instants = StateBuffer(model), ControlInstants()

    def taps(self, until: int) -> list[Tap]:
        """Returns the taps that observe the simulation up to step `until`."""
        every = range(until + 1)
        return [self.tap(until), Tap(every, self._instants.record), Tap(every, self._states.record)]

    @property
    def last_step(self) -> int:
        """The last recorded step; −1 before the first."""
        return len(self._states) - 1

    @property
    def event_steps(self) -> Mapping[str, Sequence[int]]:
        """The steps at which each condition begins to hold."""
        return {watched.text: steps for watched, steps in zip(self._watched, self.onsets(), strict=True)}

    def replay(self, model: mujoco.MjModel) -> ReplayStepper:
        """Returns a stepper that replays the recorded steps."""
        return self._instants.replay(model, self._states)

    def close(self) -> None:
        """Frees the recording."""
        self._states.close()


def conditions(
    events: Mapping[OptionPath, "ConditionEvent"], model: mujoco.MjModel, episode: EpisodeColumns | None = None
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


def _vocabulary(model: mujoco.MjModel, episode: EpisodeColumns | None) -> ModelVocabulary:
    return ModelVocabulary(model, episode.names if episode else ())


def time_of(
    event: "ConditionEvent", steps: Sequence[int], timeline: Timeline, where: str, after: Fraction = Fraction(-1)
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


@dataclass(frozen=True)
class TimelineMark:
    """A mark on the time line of a simulation.

    Attributes:
      time: simulated time [s]; None for an assertion that holds, or that no instant decides alone.
      kind: `event`, or `pass` or `fail` for an assertion.
      text: the condition by its label, or the assertion.
    """

    time: float | None
    kind: str
    text: str


class EventAndAssertionDetector(ConditionDetector):
    """A detector that also evaluates assertions at every step.

    Args:
      events: conditions, `contact/ncon > 0` or `landed=contact/ncon > 0`.
      assertions: conditions that must hold at every step.

    Attributes:
      enable_flags: MuJoCo enable flags that the measured values require.

    Raises:
      UnknownNameError, UsageError: a condition reads a value that cannot be measured, or is malformed.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        timeline: Timeline,
        events: Sequence[str],
        assertions: Sequence[str],
        episode: EpisodeColumns | None = None,
    ) -> None:
        from mjrun.probe.assertion import parse_all  # which few events need

        available = _vocabulary(model, episode)
        self._labels, conditions, read = list[str](), list[Condition](), list[str]()
        for index, text in enumerate(events):
            with concerning("mark_event", index):
                label, condition = named_condition(text)
                self._labels.append(label)
                conditions.append(parse_condition(condition, available, option("mark_event")))
        for assertion in parse_all(assertions, available):
            read += assertion.columns
        super().__init__(model, timeline, conditions, episode, read)
        columns = TraceVocabulary(self.table.names, model, episode.names if episode else ())
        self._checkers = [assertion.checker() for assertion in parse_all(assertions, columns)]
        self.enable_flags: int = self.table.model.opt.enableflags
        self._timeline, self._rows = timeline, 0

    def finish(self) -> "tuple[list[TimelineMark], list[Verdict]]":
        """Returns the marks in the order of time, and the verdicts of the assertions."""
        marks: list[TimelineMark] = []
        for label, steps in zip(self._labels, self.onsets(), strict=True):
            marks += [TimelineMark(float(self._timeline.time(step)), "event", label) for step in steps[:MOST]]
        verdicts = [checker.verdict() for checker in self._checkers]
        for checker, verdict in zip(self._checkers, verdicts, strict=True):
            marks.append(TimelineMark(checker.first_failure, "pass" if verdict.passed else "fail", verdict.text))
        return sorted(marks, key=lambda mark: float("inf") if mark.time is None else mark.time), verdicts

    def evaluate(self, rows: SampledRows) -> None:
        super().evaluate(rows)
        for checker in self._checkers:
            checker.feed(rows.values, self._rows)
        self._rows += len(rows.values)


class EndCondition:
    """A condition that ends simulations at the first row on which it holds.

    Attributes:
      columns: columns that it reads, except the time.
    """

    def __init__(self, condition: Condition) -> None:
        self._condition = condition
        self.columns = [name for name in condition.columns if name != "time"]

    @classmethod
    def of(cls, simulation: Simulation, model: mujoco.MjModel) -> "EndCondition | None":
        """Returns the condition of a simulation in the names of `model`; None if it has none.

        Raises:
          UsageError: the condition is malformed, or contains an unknown name.
        """
        if simulation.until is None:
            return None
        available = _vocabulary(model, simulation.episode.columns if simulation.episode else None)
        with concerning("until"):
            return cls(parse_condition(simulation.until, available, option("until")))

    def counts(self, names: Sequence[str], tables: np.ndarray, valid: np.ndarray) -> np.ndarray:
        """Returns the number of rows `(n,)` of each table up to the first on which it holds; 0 if it holds on none.

        Args:
          names: names of the columns.
          tables: rows `(n, rows, columns)`.
          valid: number of valid rows of each table, `(n,)`.
        """
        count, rows = len(tables), int(tables.shape[1])
        columns = dict(zip(names, np.ascontiguousarray(tables.reshape(count * rows, -1).T), strict=True))
        is_valid = np.arange(rows) < valid.reshape(count, 1)
        holds = is_valid & np.broadcast_to(self._condition.holds(columns), count * rows).reshape(count, rows)
        return np.where(holds.any(axis=1), holds.argmax(axis=1) + 1, 0)


def final_timeline(simulation: Simulation, model: mujoco.MjModel) -> Timeline:
    """Returns the timeline of a simulation with its real end; with a condition, the simulation runs up to there.

    Raises:
      UsageError: the condition is malformed, or contains an unknown name.
    """
    timeline, condition = simulation.timeline(model), EndCondition.of(simulation, model)
    if condition is None:
        return timeline
    episode = simulation.episode.columns if simulation.episode else None
    sampler, done = ProbeSampler(model, condition.columns, timeline, episode), 0
    with collected_warnings(), suppress(SimulationError):  # which the outputs report if they precede the end
        stepper = simulation.with_controller_copies.stepper(sampler.model)
        for block in sampler.blocks(stepper, range(timeline.steps + 1)):
            table = block().values
            if count := int(condition.counts(sampler.names, table[None], np.array([len(table)]))[0]):
                return Timeline.of_steps(timeline.timestep, done + count - 1)
            done += len(table)
    return timeline
