"""The observations of a task: the plan of the vector's numbers, in order, and their values at each control instant."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from math import pi
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option, quoted
from mjrun.model.names import matching
from mjrun.model.table_column import Column
from mjrun.options.number_kinds import Numbers
from mjrun.options.task import WORLD
from mjrun.probe.episode_columns import EPISODE_GROUPS, within_task
from mjrun.probe.fields import MATRIX, VECTOR, field_probe
from mjrun.probe.select import select
from mjrun.probe.task_expression import TaskExpression, TaskVocabulary, parse_task_value
from mjrun.task.action_map import spread
from mjrun.task.expressions import ACTION, COMMAND, ExpressionInputs
from mjrun.task.random_streams import CommandSignals, ObservationNoise
from mjrun.task.task import Observation

WAVES = ("sin", "cos")


@dataclass(frozen=True)
class ObservedNumber:
    """One number of the observation vector.

    Attributes:
      name: the name of the term and its component: `position/x`; with `@-2` for a value two control periods old.
      term: the name of the term.
      source: a column such as `xpos/car/x`, an expression, or a phase.
      unit: the SI unit of the source.
      offset, scale, low, high: the parameters of its processing: `clip((source − offset)·scale, low, high)`.
      delay: the delay in control periods, including history.
    """

    name: str
    term: str
    source: str
    unit: str
    offset: float
    scale: float
    low: float
    high: float
    delay: int


@dataclass(frozen=True)
class ObservedTerm:
    """A term with its columns.

    Attributes:
      place: the place of its numbers among those of all terms, before delays and histories.
      columns: its sources.
      expression: the expression of a term with a value.
    """

    term: Observation
    place: slice
    columns: tuple[str, ...]
    units: tuple[str, ...]
    expression: TaskExpression | None = None

    @property
    def is_measured(self) -> bool:
        return self.term.source in ("probe", "joints")


class ObservationPlan:
    """The plan of an observation: its terms with their columns.

    Args:
      terms: the terms of the task.
      model: the model in which their names are looked up.
      columns: the columns that expressions can read.
      action_names: the names of the numbers of an action.
      commands: the commands of the task.

    Attributes:
      terms: the terms with their columns.
      width: the number of values of all terms, before delays and histories.
      offset, scale, low, high: the parameters of each of these values.
      numbers: the numbers of the observation vector.

    Raises:
      UnknownNameError: a name is not in the model.
      UsageError: a wrong number of values, or a frame for a term without vectors.
    """

    def __init__(
        self,
        terms: Sequence[Observation],
        model: mujoco.MjModel,
        columns: TaskVocabulary,
        action_names: Sequence[str],
        commands: CommandSignals,
    ) -> None:
        self._model, self._columns = model, columns
        self._actions, self._command_names = action_names, commands.names
        self.command_slices = commands.slices
        self.terms: list[ObservedTerm] = []
        start = 0
        for index, term in enumerate(terms):
            with concerning("observations", index):
                columns_of, units, expression = self._source(term, f"observations[{index}].value")
                place = slice(start, start + len(columns_of))
                made = ObservedTerm(term, place, columns_of, units, expression)
                if term.frame != WORLD:
                    _check_vectors(made)
                self.terms.append(made)
                start = place.stop
        self.width = start
        self.offset = self._of_terms("offset", lambda term: term.offset)
        self.scale = self._of_terms("scale", lambda term: term.scale)
        self.low = self._of_terms("clip", lambda term: term.clip[0] if term.clip else (-np.inf,))
        self.high = self._of_terms("clip", lambda term: term.clip[1] if term.clip else (np.inf,))
        self.numbers = list(self._numbers())

    @property
    def measured(self) -> list[str]:
        """The columns of the model, in the order of the terms."""
        return [column for each in self.terms if each.is_measured for column in each.columns]

    @property
    def expressions(self) -> dict[str, TaskExpression]:
        """The expressions of terms with values, by name."""
        return {each.term.name: each.expression for each in self.terms if each.expression}

    @property
    def rotated_terms(self) -> list[tuple[ObservedTerm, int]]:
        """The terms that are rotated into the axes of a body, and its id."""
        bodies: list[tuple[ObservedTerm, int]] = []
        for index, each in enumerate(self.terms):
            if each.term.frame != WORLD:
                with concerning("observations", index, "frame"):
                    bodies.append((each, matching(self._model, "body", each.term.frame)[0]))
        return bodies

    def _source(self, term: Observation, label: str) -> tuple[tuple[str, ...], tuple[str, ...], TaskExpression | None]:
        """Returns the columns of a term, their units, and its expression if it has one."""
        if term.probe is not None:
            names, units = _probed(self._model, term.probe)
        elif term.joints is not None:
            names, units = _joint_columns(self._model, term.joints, term.of)
        elif term.action is not None:
            names, units = [f"{ACTION}{name}" for name in self._actions], [""] * len(self._actions)
        elif term.command is not None:
            names = [f"{COMMAND}{name}" for name in self._command_names[self.command_slices[term.command]]]
            units = [""] * len(names)
        elif term.phase is not None:
            names, units = [f"{wave}(2π t/{float(term.phase):g} s)" for wave in WAVES], ["", ""]
        else:
            assert term.value is not None
            with concerning("value"):
                return (term.value,), ("",), parse_task_value(term.value, self._columns, label)
        return tuple(names), tuple(units), None

    def _of_terms(self, name: str, numbers_of: Callable[[Observation], Numbers]) -> np.ndarray:
        """Returns the numbers of the option `name`, one for each value of all terms."""
        parts: list[np.ndarray] = []
        for index, each in enumerate(self.terms):
            with concerning("observations", index):
                parts.append(spread(name, numbers_of(each.term), len(each.columns)))
        return np.concatenate(parts)

    def _numbers(self) -> Iterator[ObservedNumber]:
        for each in self.terms:
            term = each.term
            parts = _component_names(each)
            for age in range(term.history - 1, -1, -1):
                for i, part in enumerate(parts):
                    name = "/".join(filter(None, (term.name, part))) + (f"@-{age}" if age else "")
                    at = each.place.start + i
                    yield ObservedNumber(
                        name=name,
                        term=term.name,
                        source=each.columns[i],
                        unit=each.units[i],
                        offset=float(self.offset[at]),
                        scale=float(self.scale[at]),
                        low=float(self.low[at]),
                        high=float(self.high[at]),
                        delay=age + term.delay,
                    )


def _check_vectors(each: ObservedTerm) -> None:
    """Checks that a term consists of vectors."""
    columns = each.columns
    if each.is_measured:
        parts = [column.rpartition("/")[2][-1:] for column in columns]
        fits = all("".join(parts[i : i + 3]) == "".join(VECTOR) for i in range(0, len(parts), 3))
        fits = fits and not any(column.rpartition("/")[2] in ("qx", "qy", "qz", *MATRIX) for column in columns)
    else:
        fits = len(columns) % 3 == 0
    if not fits or len(columns) % 3:
        message = f"{quoted(each.term.name)} does not consist of vectors of three components"
        raise UsageError(f"{option('frame')}: {message}", ("frame",))


def _probed(model: mujoco.MjModel, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Returns the columns that names, groups and wildcards select, and their units."""
    selected: list[Column] = []
    for index, name in enumerate(names):
        with concerning("probe", index):
            group, slash, _ = name.partition("/")
            if group.partition("[")[0] in EPISODE_GROUPS:
                raise within_task(name)
            is_wild = slash and "[" not in name and any(sign in name for sign in "*?")
            probes = select(model, [f"{group}[{name.removeprefix(f'{group}/')}]" if is_wild else name])
            columns = [column for probe in probes for column in probe.columns]
            if not columns:
                raise UsageError(f"{option('probe')}: {clean(name)} has no columns in this model")
        selected += columns
    return [column.name for column in selected], [column.unit for column in selected]


def _joint_columns(model: mujoco.MjModel, patterns: Sequence[str], of: str) -> tuple[list[str], list[str]]:
    """Returns the columns of joints in the order of their names in the task, and their units."""
    columns = field_probe(model, of).columns
    joints: list[int] = []
    for index, pattern in enumerate(patterns):
        with concerning("joints", index):
            joints += [joint for joint in matching(model, "joint", pattern) if joint not in joints]
    chosen = [column for joint in joints for column in columns if column.id == joint]
    if not chosen:
        raise UnknownNameError("joint", ", ".join(patterns), [])
    return [column.name for column in chosen], [column.unit for column in chosen]


def _component_names(each: ObservedTerm) -> Sequence[str]:
    """Returns the names of the numbers of a term: those of its columns without their common beginning."""
    if each.term.phase is not None:
        return WAVES
    if each.term.value is not None:
        return ("",)
    if each.term.action is not None:
        return [column.removeprefix(ACTION) for column in each.columns]
    pieces = [name.split("/") for name in each.columns]
    shared = 0
    while all(len(piece) > shared and piece[: shared + 1] == pieces[0][: shared + 1] for piece in pieces):
        shared += 1
    return ["/".join(piece[shared:]) for piece in pieces]


class BatchObservations:
    """The observations of n worlds, from one control instant to the next.

    Args:
      plan: the plan of the observation.
      count: the number of worlds.
      rotations: the rotations of all bodies, a view `(n, nbody, 9)`; None if no term has a frame.

    Attributes:
      rotations: the same; views of another MjData may take their place.
      width: the number of values of all terms, before delays and histories.
      has_inputs: whether an action, a command or a phase is observed.
      measured_places: the places of measured numbers among the values of all terms, in the order of their columns.
      places_of_values: the places of expressions among them.
    """

    def __init__(self, plan: ObservationPlan, count: int, control_dt: Fraction, rotations: np.ndarray | None) -> None:
        self._plan, self.rotations = plan, rotations
        self.width = plan.width
        self._measured = _runs([each for each in plan.terms if each.is_measured])
        self._inputs = [each for each in plan.terms if not each.is_measured and not each.expression]
        self._values = [each for each in plan.terms if each.expression]
        self.has_inputs = bool(self._inputs)
        self.measured_places = [i for _, place in self._measured for i in range(place.start, place.stop)]
        self.places_of_values = [each.place.start for each in self._values]
        self._dt = control_dt
        self._frames = plan.rotated_terms
        noise = [each.term.noise for each in plan.terms for _ in each.columns]
        self._noise = ObservationNoise(noise, count) if any(noise) else None
        self._shifted, self._scaled = bool(plan.offset.any()), bool((plan.scale != 1).any())
        self._clipped = bool(np.isfinite(plan.low).any() or np.isfinite(plan.high).any())
        self._is_changed = bool(self._frames or self._noise or self._shifted or self._scaled or self._clipped)
        self._is_measured = not (self._inputs or self._values) and len(self._measured) == 1  # all of it in order
        self._remembered = [each for each in plan.terms if each.term.delay or each.term.history > 1]
        self._memory = [
            np.zeros((count, each.term.delay + each.term.history, len(each.columns))) for each in self._remembered
        ]

    def begin(self, world: int, seed: int) -> None:
        """Begins the noise of an episode in a world."""
        if self._noise:
            self._noise.begin(world, seed)

    @property
    def memory(self) -> list[np.ndarray]:
        """The delayed terms and the noise of each world `(count, …)`."""
        return [*self._memory, *(self._noise.memory if self._noise else ())]

    @property
    def noise(self) -> "list[np.random.Generator | None]":
        """The generator of the noise of each world; empty without noise."""
        return self._noise.streams if self._noise else []

    def observe(
        self,
        measured: np.ndarray,
        inputs: ExpressionInputs,
        values: Mapping[str, Any],
        rows: np.ndarray | int,
        first: bool,
    ) -> np.ndarray:
        """Returns the observations `(k, nobs)` of the worlds `rows` `(k,)`; of a single one `(nobs,)`.

        Args:
          measured: the columns of the model that terms observe, in their order, `(k, …)`.
          inputs: the last actions and the commands of this instant.
          values: the values of expressions `(k,)`, by the name of the term.
          first: whether an episode begins here.
        """
        if self._is_measured:
            return self.finish(measured.copy(), rows, first)
        current = np.empty((*measured.shape[:-1], self.width))
        for source, place in self._measured:
            current[..., place] = measured[..., source]
        self.add_inputs(current, inputs)
        for each in self._values:
            current[..., each.place.start] = values[each.term.name]
        return self.finish(current, rows, first)

    def add_inputs(self, now: np.ndarray, inputs: ExpressionInputs) -> None:
        """Writes actions, commands and phases into the values of all terms `(k, width)`; of a single world `(width,)`.

        Args:
          inputs: as for `observe`.
        """
        for each in self._inputs:
            now[..., each.place] = self._input(each.term, inputs)

    def finish(self, now: np.ndarray, rows: np.ndarray | int, first: bool) -> np.ndarray:
        """Returns the observations from the values of all terms `(k, width)`, which it may change."""
        if self._is_changed:
            self._change(now, rows)
        if not self._remembered:
            return now
        parts, done = [], 0
        for each, memory in zip(self._remembered, self._memory, strict=True):
            parts.append(now[..., done : each.place.start])
            parts.append(self._recalled(each, memory, now[..., each.place], rows, first))
            done = each.place.stop
        return np.concatenate([*parts, now[..., done:]], axis=-1)

    def _input(self, term: Observation, inputs: ExpressionInputs) -> np.ndarray:
        """Returns the action, command or phase of a term: `(k, width)`, or `(width,)` of a single world."""
        if term.action is not None:
            return inputs.actions
        if term.command is not None:
            return inputs.commands[..., self._plan.command_slices[term.command]]
        assert term.phase is not None
        angles = 2 * pi * (inputs.instants * float(self._dt / term.phase))
        return np.stack([np.sin(angles), np.cos(angles)], axis=-1)

    def _change(self, now: np.ndarray, rows: np.ndarray | int) -> None:
        """Rotates all terms, adds noise, shifts, scales and clips them, in place."""
        plan = self._plan
        for each, body in self._frames:
            assert self.rotations is not None
            _turn(now[..., each.place], self.rotations[rows, body])
        if self._noise:
            now[..., self._noise.columns] += self._noise.next(rows)
        if self._shifted:
            now -= plan.offset
        if self._scaled:
            now *= plan.scale
        if self._clipped:
            now.clip(plan.low, plan.high, out=now)

    def _recalled(
        self, each: ObservedTerm, memory: np.ndarray, now: np.ndarray, rows: np.ndarray | int, first: bool
    ) -> np.ndarray:
        """Returns the history of a term, the oldest first: `(k, history·width)`; it begins with equal values."""
        if first:
            memory[rows] = now[..., None, :]
        else:
            memory[rows, :-1] = memory[rows, 1:]
            memory[rows, -1] = now
        return memory[rows, : each.term.history].reshape(*now.shape[:-1], -1)


def _runs(terms: Sequence[ObservedTerm]) -> list[tuple[slice, slice]]:
    """Returns the source and target of each run of the columns of `terms`, as few runs as possible."""
    runs: list[tuple[slice, slice]] = []
    source = 0
    for each in terms:
        width = len(each.columns)
        if runs and runs[-1][1].stop == each.place.start:
            before = runs.pop()
            runs.append((slice(before[0].start, source + width), slice(before[1].start, each.place.stop)))
        else:
            runs.append((slice(source, source + width), each.place))
        source += width
    return runs


def _turn(vectors: np.ndarray, rotations: np.ndarray) -> None:
    """Rotates vectors `(k, 3·m)` in world axes into the axes `(k, 9)` of a body, in place."""
    axes = rotations.reshape(*vectors.shape[:-1], 3, 3)  # its columns, in the world
    for start in range(0, vectors.shape[-1], 3):
        x, y, z = (vectors[..., start + i].copy() for i in range(3))
        for i in range(3):
            vectors[..., start + i] = axes[..., 0, i] * x + axes[..., 1, i] * y + axes[..., 2, i] * z
