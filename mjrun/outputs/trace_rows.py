"""The rows of a trace: their columns, and their computation block by block."""

import copy
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import partial
from typing import Any, cast

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import SimulationError, option
from mjrun.model.table_column import Column
from mjrun.physics.control import NEVER
from mjrun.physics.engine import BLOCK_STEPS, BatchStepper, RolloutBlock, recorded_fields
from mjrun.physics.stepper import SHORT, SLEEP, PhysicsStepper, Stepper
from mjrun.probe.contacts import (
    ContactProbe,
    RecordedContacts,
    contact_columns,
    contact_copiers,
    contact_rows,
)
from mjrun.probe.episode_columns import EpisodeColumns, EpisodeProbe
from mjrun.probe.fields import Fields, RecordedFieldProbe
from mjrun.probe.select import select
from mjrun.task.episode import EpisodeStepper
from mjrun.timeline import Timeline, rational, seconds

TIME = Column("time", "s", "simulated time, exact")
ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
ROWS = 256  # rows of a block that is read instant by instant, and the minimum of all other blocks but the last


@dataclass(frozen=True)
class SampledRows:
    """Consecutive rows `(n, ncolumns)` of a trace, and of its contact table `(m, ncolumns)`, if any."""

    values: np.ndarray
    contacts: np.ndarray | None = None


class ProbeSampler:
    """A sampler of the columns that probes select, in blocks of rows or one row at a time.

    Measured energy is computed even if the model's flag is off; this does not change the motion.

    Args:
      names: names of the probes.
      episode: additional columns of a policy's episode.
      with_contacts: whether the contacts of every row are recorded, too.

    Attributes:
      model: the model to simulate: a copy with energy enabled if energy is measured and disabled in the original.
      columns, contact_columns: columns of the trace, `time` first, and of the contact table.
      names: names of the columns of the trace.
      fields: the fields of MjData that the probes read from recorded fields, not from an MjData.
      reads_fields_only: whether recorded fields determine all rows, without an MjData.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        names: Sequence[str],
        timeline: Timeline,
        episode: EpisodeColumns | None = None,
        with_contacts: bool = False,
    ) -> None:
        self.probes = select(model, names, episode)
        self.columns = [TIME, *(column for probe in self.probes for column in probe.columns)]
        self.names = [column.name for column in self.columns]
        self.reads_fields_only = all(isinstance(probe, RecordedFieldProbe) for probe in self.probes)
        self.contact_columns = contact_columns(model) if with_contacts else []
        self._timeline = timeline
        of_fields = [probe for probe in self.probes if isinstance(probe, RecordedFieldProbe)]
        self.fields = sorted({name for probe in of_fields for name in probe.fields})
        self._initial_fields = sorted({name for probe in of_fields if probe.needs_initial for name in probe.fields})
        self._of_instants = [probe for probe in self.probes if not isinstance(probe, RecordedFieldProbe | ContactProbe)]
        self._copies_contacts = with_contacts or any(isinstance(probe, ContactProbe) for probe in self.probes)
        self._stepper: Stepper | None = None  # the last one that was read, and its data
        self._data: mujoco.MjData | None = None
        self._initial_values: Fields = {}
        self._like: Fields = {}  # an instance of each field
        self._copiers: Sequence[Callable[[], Any]] = ()  # of an instant in the last data
        self.model = model
        if "energy" in self.fields and not model.opt.enableflags & ENERGY:
            self.model = copy.copy(model)
            self.model.opt.enableflags |= ENERGY

    def with_timeline(self, timeline: Timeline) -> "ProbeSampler":
        """Returns a sampler of the same columns on another timeline."""
        sampler = copy.copy(self)
        sampler._timeline = timeline
        return sampler

    def times(self, steps: np.ndarray) -> Any:
        """Returns the times [s] of `steps` `(n,)`."""
        return seconds(steps, self._timeline.timestep)

    def tables(self, block: RolloutBlock, chosen: slice = slice(None)) -> np.ndarray:
        """Computes the rows of the `chosen` simulations of a block from fields alone.

        Returns:
          The rows `(n, rows, ncolumns)`; those after a failure are invalid.
        """
        fields = {name: values[chosen] for name, values in block.fields.items()}
        initial = {name: values[chosen] for name, values in block.initial.items()}
        tables = np.empty((len(block.counts[chosen]), len(block.steps), len(self.columns)))
        tables[..., 0] = self.times(block.steps)
        start = 1
        with np.errstate(all="ignore"):  # of rows after a failure
            for probe in self.probes:
                assert isinstance(probe, RecordedFieldProbe)
                tables[..., start : start + len(probe.columns)] = probe.compute(fields, initial)
                start += len(probe.columns)
        return tables

    def rows(self, steps: np.ndarray, fields: Fields, initial: Fields) -> np.ndarray:
        """Computes the rows `(n, ncolumns)` at `steps` `(n,)` from recorded fields alone.

        Args:
          fields: the fields at these instants, `{name: (n, …)}`.
          initial: the fields at step 0, `{name: (1, …)}`.
        """
        parts = [probe.compute(fields, initial) for probe in self.probes if isinstance(probe, RecordedFieldProbe)]
        return self._timed(steps, parts)

    def blocks(self, stepper: Stepper, rows: Sequence[int]) -> Iterator[Callable[[], SampledRows]]:
        """Yields blocks of the rows at the steps `rows`, as functions that the caller calls to compute them.

        Raises:
          SimulationError: a step fails; the rows before it have been yielded.
        """
        if self._copies_contacts or not self.reads_fields_only or not isinstance(stepper, PhysicsStepper):
            yield from self._by_instants(stepper, rows)
            return
        initial = self._initial(stepper)
        for first, count, fields in blocks(stepper, self.fields, self._timeline.steps):
            steps = np.array(rows[bisect_left(rows, first) : bisect_left(rows, first + count)])
            if len(steps):
                index = slice(None) if len(steps) == count else steps - first
                yield lambda steps=steps, index=index, fields=fields: SampledRows(
                    self.rows(steps, {name: values[0, index] for name, values in fields.items()}, initial)
                )

    def _by_instants(self, stepper: Stepper, rows: Sequence[int]) -> Iterator[Callable[[], SampledRows]]:
        """Yields the same blocks, read from one consistent MjData per row."""
        for start in range(0, len(rows), ROWS):
            steps, copies = rows[start : start + ROWS], list[Any]()
            try:
                self._read_all(stepper, steps, copies)
            except SimulationError:
                if copies:
                    yield partial(self.stack, steps, copies)
                raise
            yield partial(self.stack, steps, copies)

    def _read_all(self, stepper: Stepper, steps: Sequence[int], copies: list[Any]) -> None:
        """Reads the instants at `steps`, and adds their copies.

        Raises:
          SimulationError: a step fails; the instants before it have been added.
        """
        if not isinstance(stepper, PhysicsStepper) or [*steps] != [*range(steps[0], steps[0] + len(steps))]:
            for step in steps:
                stepper.advance(step)
                copies += self.read(stepper)
            return
        stepper.advance(steps[0])
        while count := steps[-1] - stepper.step:
            count, before = min(count, stepper.steps_together()), len(copies)
            if count > 1 and stepper.read_steps(count, partial(self._copiers_of, stepper), copies):
                continue
            del copies[before:]
            for _ in range(count):
                copies += self.read(stepper)
                stepper.advance(stepper.step + 1)
        copies += self.read(stepper)

    def read(self, stepper: Stepper) -> list[Any]:
        """Copies the stepper's instant, as far as the row needs it, for `stack`."""
        return [copier() for copier in self._copiers_of(stepper, stepper.instant())]

    def _copiers_of(self, stepper: Stepper, data: mujoco.MjData) -> Sequence[Callable[[], Any]]:
        """Returns functions that copy the stepper's instant in `data`, as far as the row needs it.

        They return the bytes of each field, or its number, then the values of each probe that reads an MjData or an
        episode, and then the bytes of contacts, if a column needs them.
        """
        if stepper is not self._stepper:
            self._stepper, self._data, self._initial_values = stepper, None, self._initial(stepper)
        if data is not self._data:  # whose arrays stay in place
            self._data = data
            self._like = {name: np.asarray(getattr(data, name)) for name in self.fields}
            copiers: list[Callable[[], Any]] = [_copy_of(data, name) for name in self.fields]
            if "energy" in self.fields and not (model := stepper.model).opt.enableflags & ENERGY:
                copiers[self.fields.index("energy")] = lambda: _with_energy(model, data).energy.tobytes()
            for probe in self._of_instants:
                if isinstance(probe, EpisodeProbe):
                    assert isinstance(stepper, EpisodeStepper)
                    copiers.append(lambda read=probe.read, stepper=stepper: read(stepper.now()))
                else:
                    copiers.append(probe.bind(stepper.model, data))
            if self._copies_contacts:
                copiers += contact_copiers(data)
            self._copiers = copiers or [lambda: None]  # even if time is the only column, an instant is counted
        return self._copiers

    def values(self, stepper: Stepper) -> np.ndarray:
        """Returns the row of the stepper's instant, without its time."""
        return self._computed(self.read(stepper))[0][0]

    def stack(self, steps: Sequence[int], copies: Sequence[Any]) -> SampledRows:
        """Computes rows at `steps`, or at the first of them, with their times, from what was read at each."""
        values, contacts = self._computed(copies)
        timed = self._timed(np.array(steps[: len(values)]), [values])
        return SampledRows(timed, contact_rows(contacts, timed[:, 0]) if contacts and self.contact_columns else None)

    def _computed(self, copies: Sequence[Any]) -> tuple[np.ndarray, RecordedContacts | None]:
        """Returns rows, without their times, and their contacts if any column needs them."""
        width = len(self._copiers)
        columns = [copies[index::width] for index in range(width)]
        fields = {
            name: _joined_copies(like, column)
            for (name, like), column in zip(self._like.items(), columns, strict=False)
        }
        contacts = RecordedContacts(self.model, *columns[-2:]) if self._copies_contacts else None
        measured = iter(columns[len(fields) :])
        parts: list[np.ndarray] = [np.empty((len(columns[0]), 0))]
        for probe in self.probes:
            match probe:
                case RecordedFieldProbe():
                    parts.append(probe.compute(fields, self._initial_values))
                case ContactProbe():
                    assert contacts
                    parts.append(probe.compute(contacts))
                case _:
                    values = next(measured)
                    parts.append(np.concatenate(values).reshape(len(values), -1))
        return np.concatenate(parts, axis=1), contacts

    def _initial(self, stepper: Stepper) -> Fields:
        """Returns the fields at step 0 that probes require."""
        return _fields(stepper.model, stepper.initial(), self._initial_fields) if self._initial_fields else {}

    def _timed(self, steps: np.ndarray, parts: Sequence[np.ndarray]) -> np.ndarray:
        return np.column_stack([self.times(steps), *parts])


class RowBuffer:
    """A buffer of rows that are read one by one, at `steps`, and written block by block."""

    def __init__(self, table: ProbeSampler, steps: Sequence[int], write: Callable[[SampledRows], object]) -> None:
        self._table, self._steps, self._write = table, steps, write
        self._copies: list[Any] = []  # of the last instants
        self._count = self._written = 0

    def record(self, stepper: Stepper) -> None:
        """Adds the row of the stepper's instant."""
        self._copies += self._table.read(stepper)
        self._count += 1
        if self._count == ROWS:
            self.flush()

    def flush(self) -> None:
        """Writes the buffered rows."""
        if self._count:
            end = self._written + self._count
            self._write(self._table.stack(self._steps[self._written : end], self._copies))
            self._written, self._count, self._copies = end, 0, []


def rate_warning(timeline: Timeline, rate: float | str | Fraction | None) -> str:
    """Returns a warning if `rate` [Hz] requests more rows than there are steps; otherwise an empty string."""
    if rate is None or rational(rate) * timeline.timestep <= 1:
        return ""
    steps = f"{float(1 / timeline.timestep):g}"
    text = f"{option('rate')} {float(rational(rate)):g} exceeds the {steps} steps of a simulated second"
    return f"{text}: each step gives one row; a smaller {option('timestep')} gives more"


def _copy_of(data: mujoco.MjData, name: str) -> Callable[[], bytes | int]:
    """Returns a function that returns the bytes of a field of `data`, or its number."""
    value = getattr(data, name)
    # The method of a memoryview is faster than that of the array.
    return value.data.tobytes if isinstance(value, np.ndarray) else partial(getattr, data, name)


def _joined_copies(like: np.ndarray, copies: Sequence[bytes | int]) -> np.ndarray:
    """Returns copies of a field at n instants as an array `(n, …)`."""
    if not like.ndim:
        return np.array(copies)
    return np.frombuffer(b"".join(cast("Sequence[bytes]", copies)), like.dtype).reshape(len(copies), *like.shape)


def _fields(model: mujoco.MjModel, data: mujoco.MjData, names: Sequence[str]) -> Fields:
    if "energy" in names and not model.opt.enableflags & ENERGY:
        data = _with_energy(model, data)
    return {name: np.array(getattr(data, name)) for name in names}


def _with_energy(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """Returns a copy of an instant, with the energy that the model leaves out."""
    instant = mujoco.MjData(model)
    mujoco.mj_copyData(instant, model, data)
    mujoco.mj_energyPos(model, instant)
    mujoco.mj_energyVel(model, instant)
    return instant


def blocks(
    stepper: PhysicsStepper, record: Sequence[str], steps: int, size: int = BLOCK_STEPS
) -> Iterator[tuple[int, int, Fields]]:
    """Runs `steps` steps from the stepper's current one, and yields every instant on the way, the last included.

    The numbers are bit for bit those of a bare loop that calls `mj_forward` on a copy at every step.

    Args:
      stepper: a stepper at the first instant, which advances as blocks are taken.
      record: names of MjData fields.
      size: maximum number of steps in a block.

    Yields:
      The step of the first row, the number of rows, and `{field: (1, rows, …)}` of instants a step apart.

    Raises:
      SimulationError: the simulation fails; every valid instant has been yielded before.
    """
    end, is_done, recorder = stepper.step + steps, False, _InstantRecorder(stepper, record)
    while not is_done:
        first = stepper.step
        rows = _InstantRows(recorder.templates, min(size, end + 1 - first))
        enough = min(ROWS, rows.size)
        try:
            while not is_done and rows.count < enough:
                is_done = recorder.add(rows, end)
        except SimulationError:
            if rows.count:
                yield first, rows.count, rows.stored()
            raise
        yield first, rows.count, rows.stored()


class _InstantRows:
    """Fields of successive instants.

    Args:
      templates: an instance of each field.
      size: the number of instants for which there is room.

    Attributes:
      count: the number of instants so far.
      all: the fields `{field: (1, size + 1, …)}` that are stored; a recorded step writes the state after it.
    """

    def __init__(self, templates: Fields, size: int) -> None:
        self.size, self.count = size, 0
        self.all = {name: np.empty((1, size + 1, *value.shape), value.dtype) for name, value in templates.items()}
        self._templates = {name: value for name, value in templates.items() if value.size}
        self._data: mujoco.MjData | None = None  # the last one, and what copies each of its fields
        self._copies: Sequence[Callable[[], bytes | int]] = ()
        self._read = list[bytes | int]()  # the fields of the last instants, which are not stored yet

    def add(self, data: mujoco.MjData) -> None:
        """Adds an instant."""
        self._read += [copy() for copy in self._copies_of(data)]
        self.count += 1

    def add_steps(self, stepper: PhysicsStepper, count: int) -> bool:
        """Takes steps and adds the instants before them, as `PhysicsStepper.read_steps`."""
        first, length = stepper.step, len(self._read)
        try:
            return stepper.read_steps(count, self._copies_of, self._read)
        finally:
            taken = stepper.step - first
            self.count += taken
            del self._read[length + taken * len(self._copies) :]

    def store(self) -> None:
        """Stores the instants that were added one by one."""
        if not self._read:
            return
        width = len(self._copies)
        first = self.count - len(self._read) // width
        for index, (name, template) in enumerate(self._templates.items()):
            self.all[name][0, first : self.count] = _joined_copies(template, self._read[index::width])
        self._read.clear()

    def _copies_of(self, data: mujoco.MjData) -> Sequence[Callable[[], bytes | int]]:
        """Returns functions that copy each field of `data`."""
        if data is not self._data:
            self._data, self._copies = data, [_copy_of(data, name) for name in self._templates]
        return self._copies

    def stored(self) -> Fields:
        """Returns the fields of the instants so far: `{field: (1, count, …)}`."""
        self.store()
        return {name: values[:, : self.count] for name, values in self.all.items()}


class _InstantRecorder:
    """A stepper that is moved step by step, or in C over steps with the same inputs.

    Args:
      record: names of MjData fields.

    Attributes:
      templates: an instance of each field.
    """

    def __init__(self, stepper: PhysicsStepper, record: Sequence[str]) -> None:
        model = stepper.model
        self._stepper, self._record, self._batch = stepper, record, None
        self.templates = recorded_fields(model, record)
        self._least = NEVER if model.opt.enableflags & SLEEP else SHORT  # a record lacks which bodies sleep

    def add(self, rows: _InstantRows, end: int) -> bool:
        """Takes some steps, and adds the instants before them; returns whether that at step `end` has been added."""
        stepper = self._stepper
        if stepper.step == end:
            rows.add(stepper.instant())
            return True
        left = min(rows.size - rows.count, end - stepper.step)
        count = min(left, stepper.steps_alike())
        if count >= self._least and self._add_recorded(rows, count):
            return False
        if count < self._least:
            count = min(left, stepper.steps_together())
            if count > 1 and rows.add_steps(stepper, count):
                return False
        for _ in range(count):  # which names the failing step, or gets past it
            rows.add(stepper.instant())
            stepper.advance(stepper.step + 1)
        return False

    def _add_recorded(self, rows: _InstantRows, count: int) -> bool:
        """Adds steps that are taken in C; returns False if one of them fails."""
        stepper, at = self._stepper, self._stepper.step
        self._batch = self._batch or BatchStepper([stepper.model], self._record, BLOCK_STEPS)
        controls = stepper.control.rows(at, count)[None] if stepper.control.varies else None
        rows.store()
        after = self._batch.extend(rows.all, rows.count, stepper.state(), count, controls)
        if after is None:
            return False
        rows.count += count
        stepper.jump(at + count, after)
        return True
