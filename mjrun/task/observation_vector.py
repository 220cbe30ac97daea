"""The observations of a task: which numbers in which order, and what is done to them on their way to the policy."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import pi
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option, quoted
from mjrun.model.names import matching
from mjrun.options.kinds import Numbers
from mjrun.options.task import WORLD
from mjrun.probe.episode import EPISODE_GROUPS, within_task
from mjrun.probe.fields import MATRIX, VECTOR, field_probe
from mjrun.probe.select import select
from mjrun.probe.task_expression import TaskColumns, TaskExpression, parse_task_value
from mjrun.task.action_map import spread
from mjrun.task.command_signals import CommandSignals
from mjrun.task.expressions import ACTION, COMMAND, Inputs
from mjrun.task.random_streams import ObservationNoise
from mjrun.task.terms import Observation

WAVES = ("sin", "cos")


@dataclass(frozen=True)
class ObservedNumber:
    """One number of the observation vector.

    Attributes:
      name: the term's, and what it is within the term: `position/x`; `@-2` where it is two control periods old, by the
        history of the term.
      term: the name of the term.
      source: the column it is taken from, `xpos/car/x`; or the expression, or the phase.
      unit: of the source, SI.
      offset, scale, low, high: what is done to it: `clip((source − offset)·scale, low, high)`.
      delay: by how many control periods, history included.
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
class _Term:
    """A term whose columns are known.

    Attributes:
      place: of its numbers among those of all terms, as they are measured.
      columns: they are taken from.
      expression: of a term that has a value instead.
    """

    term: Observation
    place: slice
    columns: tuple[str, ...]
    units: tuple[str, ...]
    expression: TaskExpression | None = None


class ObservationPlan:
    """What is observed, in order.

    Args:
      terms: of the task.
      model: with the names that they use.
      columns: that expressions can read.
      action_names: of the numbers of an action.
      commands: of the task.

    Attributes:
      terms: with what is known of them.
      width: numbers of all terms, before delays and histories.
      offset, scale, low, high: of each of these numbers.
      numbers: of the observation vector.

    Raises:
      UnknownNameError: a name is not in the model.
      UsageError: numbers that do not fit, or a frame for what has no vectors.
    """

    def __init__(
        self,
        terms: Sequence[Observation],
        model: mujoco.MjModel,
        columns: TaskColumns,
        action_names: Sequence[str],
        commands: CommandSignals,
    ) -> None:
        self._model, self._columns = model, columns
        self._actions, self._command_names = action_names, commands.names
        self.command_slices = commands.slices
        self.terms: list[_Term] = []
        start = 0
        for index, term in enumerate(terms):
            with concerning("observations", index):
                columns_of, units, expression = self._source(term, f"observations[{index}].value")
                place = slice(start, start + len(columns_of))
                made = _Term(term, place, columns_of, units, expression)
                if term.frame != WORLD:
                    _check_vectors(made)
                self.terms.append(made)
                start = place.stop
        self.width = start  # before delays and histories
        self.offset, self.scale = self._spread("offset"), self._spread("scale")
        self.low, self.high = self._limits()
        self.numbers = list(self._numbers())

    @property
    def measured(self) -> list[str]:
        """The columns of the model, in the order of the terms."""
        return [column for each in self.terms if each.term.source in ("probe", "joints") for column in each.columns]

    @property
    def expressions(self) -> dict[str, TaskExpression]:
        """Of the terms that have values, by name."""
        return {each.term.name: each.expression for each in self.terms if each.expression}

    @property
    def frames(self) -> list[tuple[_Term, int]]:
        """The terms that are turned into the axes of a body, and its id."""
        bodies = []
        for index, each in enumerate(self.terms):
            if each.term.frame != WORLD:
                with concerning("observations", index, "frame"):
                    bodies.append((each, matching(self._model, "body", each.term.frame)[0]))
        return bodies

    def _source(self, term: Observation, label: str) -> tuple[tuple[str, ...], tuple[str, ...], TaskExpression | None]:
        """The columns that a term is taken from, their units, and its expression if it has one."""
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

    def _spread(self, name: str) -> np.ndarray:
        return self._of_terms(name, [vars(each.term)[name] for each in self.terms])

    def _limits(self) -> tuple[np.ndarray, np.ndarray]:
        clips = [each.term.clip or ((-np.inf,), (np.inf,)) for each in self.terms]
        low, high = ([clip[side] for clip in clips] for side in (0, 1))
        return self._of_terms("clip", low), self._of_terms("clip", high)

    def _of_terms(self, name: str, values: Sequence[Numbers]) -> np.ndarray:
        """The numbers of all terms, one for each number that is measured."""
        parts = []
        for index, (each, numbers) in enumerate(zip(self.terms, values, strict=True)):
            with concerning("observations", index):
                parts.append(spread(name, numbers, len(each.columns)))
        return np.concatenate(parts)

    def _numbers(self) -> Iterator[ObservedNumber]:
        for each in self.terms:
            term = each.term
            parts = _names_within(each)
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


class ObservationVector:
    """The observations of n worlds, from one control instant to the next.

    Args:
      plan: of them.
      count: worlds.
      rotations: of all bodies, a view `(n, nbody, 9)`; needed where there are frames.
    """

    def __init__(self, plan: ObservationPlan, count: int, control_dt: Fraction, rotations: np.ndarray | None) -> None:
        self._plan, self._rotations = plan, rotations
        self._measured = _runs([each for each in plan.terms if each.term.source in ("probe", "joints")])
        self._inputs = [each for each in plan.terms if each.term.source in ("action", "command", "phase")]
        self._values = [each for each in plan.terms if each.expression]
        self._dt = control_dt
        self._frames = plan.frames
        noise = [each.term.noise for each in plan.terms for _ in each.columns]
        self._noise = ObservationNoise(noise, count) if any(noise) else None
        self._shifted, self._scaled = bool(plan.offset.any()), bool((plan.scale != 1).any())
        self._clipped = bool(np.isfinite(plan.low).any() or np.isfinite(plan.high).any())
        self._is_changed = bool(self._frames or self._noise or self._shifted or self._scaled or self._clipped)
        self._is_measured = not (self._inputs or self._values) and len(self._measured) == 1  # all of it, in one run
        self._remembered = [each for each in plan.terms if each.term.delay or each.term.history > 1]
        self._memory = [
            np.zeros((count, each.term.delay + each.term.history, len(each.columns))) for each in self._remembered
        ]

    def begin_episode(self, world: int, seed: int) -> None:
        """Begins the noise of an episode in a world."""
        if self._noise:
            self._noise.begin(world, seed)

    @property
    def memory(self) -> list[np.ndarray]:
        """What it remembers of each world `(count, …)`."""
        return [*self._memory, *(self._noise.memory if self._noise else ())]

    @property
    def noise(self) -> list[np.random.Generator | None]:
        """What noise is drawn from in each world; nothing where there is none."""
        return self._noise.streams if self._noise else []

    def observe(
        self, measured: np.ndarray, inputs: Inputs, values: Mapping[str, Any], rows: np.ndarray | int, first: bool
    ) -> np.ndarray:
        """The observations `(k, nobs)` of the worlds `rows` `(k,)`; of one alone `(nobs,)`.

        Args:
          measured: the columns of the model that the terms are taken from, in their order, `(k, …)`.
          inputs: the last actions and the commands of this instant.
          values: of expressions `(k,)`, by the name of the term.
          first: whether an episode begins here.
        """
        current = self.collect(measured, inputs)
        for each in self._values:
            current[..., each.place.start] = values[each.term.name]
        return self.finish(current, rows, first)

    @property
    def has_inputs(self) -> bool:
        """Whether something of what went into the worlds is observed."""
        return bool(self._inputs)

    @property
    def places_of_values(self) -> list[int]:
        """Where the values of expressions are among the numbers of all terms, in their order."""
        return [each.place.start for each in self._values]

    def collect(self, measured: np.ndarray, inputs: Inputs) -> np.ndarray:
        """All terms as they are now, but for the values of expressions: `(k, width)`, or `(width,)` of a single world.

        Args:
          measured, inputs: as for `observe`.
        """
        if self._is_measured:
            return measured.copy()
        now = np.empty((*measured.shape[:-1], self._plan.width))
        for source, place in self._measured:
            now[..., place] = measured[..., source]
        for each in self._inputs:
            now[..., each.place] = self._input(each.term, inputs)
        return now

    def finish(self, now: np.ndarray, rows: np.ndarray | int, first: bool) -> np.ndarray:
        """The observations from what `collect` gave, with the values of expressions in their places."""
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

    def _input(self, term: Observation, inputs: Inputs) -> np.ndarray:
        """What a term has of what went into the worlds: `(k, width)`, or `(width,)` of a single world."""
        if term.action is not None:
            return inputs.actions
        if term.command is not None:
            return inputs.commands[..., self._plan.command_slices[term.command]]
        assert term.phase is not None
        angles = 2 * pi * (inputs.instants * float(self._dt / term.phase))
        return np.stack([np.sin(angles), np.cos(angles)], axis=-1)

    def _change(self, now: np.ndarray, rows: np.ndarray | int) -> None:
        """Turns all terms, adds noise to them, shifts, scales and clips them, in place."""
        plan = self._plan
        for each, body in self._frames:
            assert self._rotations is not None
            _turn(now[..., each.place], self._rotations[rows, body])
        if self._noise:
            now[..., self._noise.columns] += self._noise.next(rows)
        if self._shifted:
            now -= plan.offset
        if self._scaled:
            now *= plan.scale
        if self._clipped:
            now.clip(plan.low, plan.high, out=now)

    def _recalled(
        self, each: _Term, memory: np.ndarray, now: np.ndarray, rows: np.ndarray | int, first: bool
    ) -> np.ndarray:
        """The history of a term, the oldest first: `(k, history·width)`. Before an episode all was as it begins."""
        if first:
            memory[rows] = now[..., None, :]
        else:
            memory[rows, :-1] = memory[rows, 1:]
            memory[rows, -1] = now
        return memory[rows, : each.term.history].reshape(*now.shape[:-1], -1)


def _runs(terms: Sequence[_Term]) -> list[tuple[slice, slice]]:
    """Where the columns of `terms`, one after the other, go: as few runs of them as there can be."""
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
    """Turns vectors `(k, 3·m)` of the world into the axes `(k, 9)` of a body each, in place."""
    axes = rotations.reshape(*vectors.shape[:-1], 3, 3)  # its columns, in the world
    for start in range(0, vectors.shape[-1], 3):
        x, y, z = (vectors[..., start + i].copy() for i in range(3))
        for i in range(3):
            vectors[..., start + i] = axes[..., 0, i] * x + axes[..., 1, i] * y + axes[..., 2, i] * z


def _check_vectors(each: _Term) -> None:
    """Checks that a term is made of vectors."""
    columns = each.columns
    if each.term.source in ("probe", "joints"):
        parts = [column.rpartition("/")[2][-1:] for column in columns]
        fits = all("".join(parts[i : i + 3]) == "".join(VECTOR) for i in range(0, len(parts), 3))
        fits = fits and not any(column.rpartition("/")[2] in ("qx", "qy", "qz", *MATRIX) for column in columns)
    else:
        fits = len(columns) % 3 == 0
    if not fits or len(columns) % 3:
        message = f"{quoted(each.term.name)} is no vector of three components, which a body's axes could have"
        raise UsageError(message, ("frame",))


def _probed(model: mujoco.MjModel, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """The columns that names, groups and wildcards stand for, and their units."""
    found, units = [], []
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
        found += [column.name for column in columns]
        units += [column.unit for column in columns]
    return found, units


def _joint_columns(model: mujoco.MjModel, patterns: Sequence[str], of: str) -> tuple[list[str], list[str]]:
    """The columns of joints, in the order in which they are named, and their units."""
    columns = field_probe(model, of).columns
    joints: list[int] = []
    for index, pattern in enumerate(patterns):
        with concerning("joints", index):
            joints += [joint for joint in matching(model, "joint", pattern) if joint not in joints]
    chosen = [column for joint in joints for column in columns if column.id == joint]
    if not chosen:
        raise UnknownNameError("joint", ", ".join(patterns), [])
    return [column.name for column in chosen], [column.unit for column in chosen]


def _parts(names: Sequence[str]) -> list[str]:
    """What distinguishes columns: their names without what all begin with; nothing for a single one."""
    pieces = [name.split("/") for name in names]
    shared = 0
    while all(len(piece) > shared and piece[: shared + 1] == pieces[0][: shared + 1] for piece in pieces):
        shared += 1
    return ["/".join(piece[shared:]) for piece in pieces]


def _names_within(each: _Term) -> Sequence[str]:
    """What the numbers of a term are called within it."""
    if each.term.phase is not None:
        return WAVES
    if each.term.value is not None:
        return ("",)
    if each.term.action is not None:
        return [column.removeprefix(ACTION) for column in each.columns]
    return _parts(each.columns)
