"""The plan of the observations of a task: the numbers of the vector in order, and where each comes from."""

from collections.abc import Callable, Iterator, Sequence

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
from mjrun.probe.task_expression import TaskColumns, TaskExpression, parse_task_value
from mjrun.task.action_map import spread
from mjrun.task.command_signals import CommandSignals
from mjrun.task.expressions import ACTION, COMMAND
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
    """The terms of the observation with their columns.

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
        columns: TaskColumns,
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
    def frames(self) -> list[tuple[ObservedTerm, int]]:
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
