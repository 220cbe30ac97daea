"""Marks on the time line of a simulation: where conditions begin to hold, and where assertions fail."""

from collections.abc import Mapping, Sequence

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import concerning, option
from mjrun.outputs.trace_rows import ProbeSampler, RowBuffer, SampledRows
from mjrun.physics.simulation_loop import AnyTap, Tap
from mjrun.probe.assertion import parse_all
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.row_expression import Condition, RisingEdgeDetector, named_condition, parse_condition
from mjrun.probe.verdict import Verdict
from mjrun.probe.vocabularies import AvailableProbes, TraceVocabulary
from mjrun.timeline import Timeline

MOST = 200  # marks of one condition


@dataclass(frozen=True)
class Mark:
    """A mark.

    Attributes:
      time: simulated time [s]; None for an assertion that holds, or that no instant decides alone.
      kind: `event`, or `pass` or `fail` for an assertion.
      text: the condition by its label, or the assertion.
    """

    time: float | None
    kind: str
    text: str


class MarkDetector:
    """A detector that evaluates conditions and assertions at every step.

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
        others = episode.names if episode else ()
        available = AvailableProbes(model, others)
        self._events: list[tuple[str, Condition, RisingEdgeDetector]] = []
        read: list[str] = []
        for index, text in enumerate(events):
            with concerning("mark_event", index):
                label, condition = named_condition(text)
                parsed = parse_condition(condition, available, option("mark_event"))
                self._events.append((label, parsed, RisingEdgeDetector()))
                read += parsed.columns
        for assertion in parse_all(assertions, available):
            read += assertion.columns
        names = [name for name in dict.fromkeys(read) if name != "time"]
        self._table, self._timeline = ProbeSampler(model, names, timeline, episode), timeline
        columns = TraceVocabulary(self._table.names, model, others)
        self._checkers = [assertion.checker() for assertion in parse_all(assertions, columns)]
        self.enable_flags: int = self._table.model.opt.enableflags
        self._rows = 0

    def tap(self, until: int) -> AnyTap:
        """Returns the tap that evaluates every step up to `until`."""
        steps = range(until + 1)
        self._buffer = RowBuffer(self._table, steps, self._evaluate)
        return Tap(steps, self._table.read, self._buffer.add)

    def finish(self) -> tuple[list[Mark], list[Verdict]]:
        """Returns the marks in the order of time, and the verdicts of the assertions."""
        self._buffer.flush()
        marks: list[Mark] = []
        for label, _, onsets in self._events:
            times = (float(self._timeline.time(step)) for step in onsets.indices[:MOST])
            marks += [Mark(time, "event", label) for time in times]
        verdicts = [checker.verdict() for checker in self._checkers]
        for checker, verdict in zip(self._checkers, verdicts, strict=True):
            marks.append(Mark(checker.first_failure, "pass" if verdict.passed else "fail", verdict.text))
        return sorted(marks, key=lambda mark: float("inf") if mark.time is None else mark.time), verdicts

    def _evaluate(self, rows: SampledRows) -> None:
        values: Mapping[str, object] = dict(zip(self._table.names, rows.values.T, strict=True))
        for _, condition, onsets in self._events:
            onsets.feed(condition.holds(values))
        for checker in self._checkers:
            checker.feed(rows.values, self._rows)
        self._rows += len(rows.values)
