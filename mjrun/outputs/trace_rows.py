"""The rows of a trace: their columns, and their computation block by block."""

import copy
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import partial
from operator import attrgetter
from typing import NamedTuple, cast

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import SimulationError, option
from mjrun.model.table_column import Column
from mjrun.physics.c_engine import SLEEP, RecordingBatch
from mjrun.physics.engine import BLOCK_STEPS, RolloutBlock
from mjrun.physics.stepper import PhysicsStepper, Stepper
from mjrun.probe.contacts import contact_columns, contact_rows
from mjrun.probe.episode_columns import EpisodeColumns, EpisodeProbe
from mjrun.probe.fields import FieldProbe, Fields
from mjrun.probe.recorded_contacts import ContactProbe, CopiedContacts, RecordedContacts, copy_contacts
from mjrun.probe.select import select
from mjrun.task.episode import EpisodeStepper
from mjrun.timeline import Timeline, rational, seconds

TIME = Column("time", "s", "simulated time, exact")
ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
ROWS = 256  # rows of a block that is read instant by instant, and the minimum of all other blocks but the last
SHORT = 16  # steps; a batch takes longer for fewer than to read each instant


@dataclass(frozen=True)
class SampledRows:
    """Consecutive rows `(n, ncolumns)` of a trace, and of its contact table `(m, ncolumns)`, if any."""

    values: np.ndarray
    contacts: np.ndarray | None = None


class InstantReading(NamedTuple):
    """Copies of the data from which a row is computed.

    Attributes:
      fields: the bytes of fields of MjData, or numbers.
      initial: fields at step 0.
      measured: the values of probes that read an MjData or an episode.
      contacts: the contacts, if a column needs them.
    """

    fields: Sequence[bytes | int]
    initial: Fields
    measured: Sequence[np.ndarray]
    contacts: CopiedContacts | None


class ProbeSampler:
    """The columns that probes select, with their rows, read in blocks or one at a time.

    Measured energy is computed even if the model's flag is off; this does not change the motion.

    Args:
      names: names of the probes.
      episode: additional columns of a policy's episode.
      with_contacts: whether the contacts of every row are recorded, too.

    Attributes:
      model: the model to simulate: a copy with energy enabled if energy is measured and disabled in the original.
      columns, contact_columns: columns of the trace, `time` first, and of the contact table.
      names: names of the columns of the trace.
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
        self.reads_fields_only = all(isinstance(probe, FieldProbe) for probe in self.probes)
        self.contact_columns = contact_columns(model) if with_contacts else []
        self._timeline = timeline
        of_fields = [probe for probe in self.probes if isinstance(probe, FieldProbe)]
        self._fields = sorted({name for probe in of_fields for name in probe.fields})
        self._initial_fields = sorted({name for probe in of_fields if probe.needs_initial for name in probe.fields})
        self._of_instants = [probe for probe in self.probes if not isinstance(probe, FieldProbe | ContactProbe)]
        self._copies_contacts = with_contacts or any(isinstance(probe, ContactProbe) for probe in self.probes)
        self._stepper: Stepper | None = None  # the last one that was read, and its data
        self._data: mujoco.MjData | None = None
        self._initial_values: Fields = {}
        self._like: Fields = {}  # an instance of each field
        self._copies: Sequence[Callable[[], bytes | int]] = ()  # copy each field of the last MjData
        self.model = model
        if "energy" in self._fields and not model.opt.enableflags & ENERGY:
            self.model = copy.copy(model)
            self.model.opt.enableflags |= ENERGY

    @property
    def fields(self) -> Sequence[str]:
        """The fields of MjData that the probes read from recorded fields, not from an MjData."""
        return self._fields

    def tables(self, block: RolloutBlock, count: int, chosen: slice = slice(None)) -> np.ndarray:
        """Computes the first `count` rows of the `chosen` simulations of a block from fields alone.

        Returns:
          The rows `(n, count, ncolumns)`; those after a failure are invalid.
        """
        fields = {name: values[chosen, :count] for name, values in block.fields.items()}
        initial = {name: values[chosen] for name, values in block.initial.items()}
        tables = np.empty((len(block.counts[chosen]), count, len(self.columns)))
        tables[..., 0] = seconds(block.steps[:count], self._timeline.timestep)
        start = 1
        with np.errstate(all="ignore"):  # of rows after a failure
            for probe in self.probes:
                assert isinstance(probe, FieldProbe)
                tables[..., start : start + len(probe.columns)] = probe.compute(fields, initial)
                start += len(probe.columns)
        return tables

    def rows(self, steps: np.ndarray, fields: Fields, initial: Fields) -> np.ndarray:
        """Computes the rows `(n, ncolumns)` at `steps` `(n,)` from recorded fields alone.

        Args:
          fields: the fields at these instants, `{name: (n, …)}`.
          initial: the fields at step 0, `{name: (1, …)}`.
        """
        parts = [probe.compute(fields, initial) for probe in self.probes if isinstance(probe, FieldProbe)]
        return self._timed(steps, parts)

    def blocks(self, stepper: PhysicsStepper, rows: Sequence[int]) -> Iterator[Callable[[], SampledRows]]:
        """Yields blocks of the rows at the steps `rows`, as functions that the caller calls to compute them."""
        if self._copies_contacts or not all(isinstance(probe, FieldProbe) for probe in self.probes):
            yield from self._by_instants(stepper, rows)
            return
        initial = self._initial(stepper)
        for first, count, fields in blocks(stepper, self._fields, self._timeline.steps):
            steps = np.array(rows[bisect_left(rows, first) : bisect_left(rows, first + count)])
            if len(steps):
                index = slice(None) if len(steps) == count else steps - first
                yield lambda steps=steps, index=index, fields=fields: SampledRows(
                    self.rows(steps, {name: values[0, index] for name, values in fields.items()}, initial)
                )

    def _by_instants(self, stepper: PhysicsStepper, rows: Sequence[int]) -> Iterator[Callable[[], SampledRows]]:
        """Yields the same blocks, read from one consistent MjData per row."""
        for start in range(0, len(rows), ROWS):
            steps, readings = rows[start : start + ROWS], list[InstantReading]()
            try:
                for step in steps:
                    stepper.advance(step)
                    readings.append(self.read(stepper))
            except SimulationError:
                if readings:
                    yield partial(self.stack, steps, readings)
                raise
            yield partial(self.stack, steps, readings)

    def read(self, stepper: Stepper) -> InstantReading:
        """Copies the stepper's instant, as far as the row needs it."""
        data = stepper.instant()
        if stepper is not self._stepper:
            self._stepper, self._initial_values = stepper, self._initial(stepper)
        if data is not self._data:  # whose arrays stay in place
            self._data = data
            self._like = {name: np.asarray(getattr(data, name)) for name in self._fields}
            self._copies = [_copy_of(stepper.model, data, name) for name in self._fields]
        measured: list[np.ndarray] = []
        for probe in self._of_instants:
            if isinstance(probe, EpisodeProbe):
                assert isinstance(stepper, EpisodeStepper)
                measured.append(probe.read(stepper.now()))
            else:
                measured.append(probe.measure(stepper.model, data))
        return InstantReading(
            [copy() for copy in self._copies],
            self._initial_values,
            measured,
            copy_contacts(data) if self._copies_contacts else None,
        )

    def values(self, stepper: Stepper) -> np.ndarray:
        """Returns the row of the stepper's instant, without its time."""
        return self._computed([self.read(stepper)])[0][0]

    def stack(self, steps: Sequence[int], readings: Sequence[InstantReading]) -> SampledRows:
        """Computes the rows of `readings` at `steps`, or at the first of them, with their times."""
        values, contacts = self._computed(readings)
        timed = self._timed(np.array(steps[: len(readings)]), [values])
        return SampledRows(timed, contact_rows(contacts, timed[:, 0]) if contacts and self.contact_columns else None)

    def _computed(self, readings: Sequence[InstantReading]) -> tuple[np.ndarray, RecordedContacts | None]:
        """Returns the rows of `readings`, without their times, and their contacts if any column needs them."""
        first = readings[0]
        fields = {
            name: _joined_copies(like, [reading.fields[index] for reading in readings])
            for index, (name, like) in enumerate(self._like.items())
        }
        contacts = None
        if self._copies_contacts:
            contacts = RecordedContacts(self.model, [reading.contacts for reading in readings if reading.contacts])
        measured = iter(range(len(first.measured)))
        parts: list[np.ndarray] = [np.empty((len(readings), 0))]
        for probe in self.probes:
            match probe:
                case FieldProbe():
                    parts.append(probe.compute(fields, first.initial))
                case ContactProbe():
                    assert contacts
                    parts.append(probe.compute(contacts))
                case _:
                    index = next(measured)
                    parts.append(np.stack([reading.measured[index] for reading in readings]))
        return np.concatenate(parts, axis=1), contacts

    def _initial(self, stepper: Stepper) -> Fields:
        """Returns the fields at step 0 that probes require."""
        return _fields(stepper.model, stepper.initial(), self._initial_fields) if self._initial_fields else {}

    def _timed(self, steps: np.ndarray, parts: Sequence[np.ndarray]) -> np.ndarray:
        return np.column_stack([seconds(steps, self._timeline.timestep), *parts])


class RowBuffer:
    """A buffer of rows that are read one by one, at `steps`, and written block by block."""

    def __init__(self, table: ProbeSampler, steps: Sequence[int], write: Callable[[SampledRows], object]) -> None:
        self._table, self._steps, self._write = table, steps, write
        self._rows: list[InstantReading] = []
        self._written = 0

    def add(self, reading: InstantReading) -> None:
        """Adds the next row, as `ProbeSampler.read` returns it."""
        self._rows.append(reading)
        if len(self._rows) == ROWS:
            self.flush()

    def flush(self) -> None:
        """Writes the buffered rows."""
        if self._rows:
            self._write(self._table.stack(self._steps[self._written :][: len(self._rows)], self._rows))
            self._written, self._rows = self._written + len(self._rows), []


def rate_warning(timeline: Timeline, rate: float | str | Fraction | None) -> str:
    """Returns a warning if `rate` [Hz] requests more rows than there are steps; otherwise an empty string."""
    if rate is None or rational(rate) * timeline.timestep <= 1:
        return ""
    steps = f"{float(1 / timeline.timestep):g}"
    text = f"{option('rate')} {float(rational(rate)):g} exceeds the {steps} steps of a simulated second"
    return f"{text}: each step gives one row; a smaller {option('timestep')} gives more"


def _copy_of(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Callable[[], bytes | int]:
    """Returns a function that returns the bytes of a field of `data`, or its number."""
    if name == "energy" and not model.opt.enableflags & ENERGY:
        return lambda: _with_energy(model, data).energy.tobytes()
    value = getattr(data, name)
    return value.tobytes if isinstance(value, np.ndarray) else partial(getattr, data, name)


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
    first, count, waiting = stepper.step, 0, list[Fields]()
    failure: SimulationError | None = None
    try:
        for length, fields in _pieces(stepper, record, stepper.step + steps, size):
            waiting.append(fields)
            count += length
            if count >= min(ROWS, size):
                yield first, count, _joined(waiting)
                first, count, waiting = first + count, 0, []
    except SimulationError as error:
        failure = error
    if count:
        yield first, count, _joined(waiting)
    if failure:
        raise failure


def _pieces(stepper: PhysicsStepper, record: Sequence[str], end: int, size: int) -> Iterator[tuple[int, Fields]]:
    """Yields the same instants in pieces of any length, with their lengths."""
    sleeps, batch = bool(stepper.model.opt.enableflags & SLEEP), None
    while stepper.step < end:
        at = stepper.step
        count = min(size, end - at, stepper.steps_alike())
        if sleeps or count < SHORT:
            yield from _single_steps(stepper, record, min(ROWS, size, end - at))
            continue
        batch = batch or RecordingBatch([stepper.model], record, size)
        controls = stepper.control.rows(at, count)[None] if stepper.control.varies else None
        recorded = batch.run(stepper.state()[None], count, controls)
        if recorded.completed.all():
            stepper.jump(at + count, recorded.states[0])
            yield count, recorded.fields
        else:  # stepping singly names the failing step, or gets past it
            yield from _single_steps(stepper, record, count)
    data = stepper.instant()
    yield 1, {name: np.array(getattr(data, name))[None, None] for name in record}


def _single_steps(stepper: PhysicsStepper, record: Sequence[str], count: int) -> Iterator[tuple[int, Fields]]:
    """Takes `count` steps one by one, and yields the instants before them."""
    end = stepper.step + count
    while stepper.step < end:
        instants = _InstantRows(record, min(ROWS, end - stepper.step))
        try:
            for step in range(stepper.step, stepper.step + instants.size):
                instants.add(stepper.instant())
                stepper.advance(step + 1)
        except SimulationError:
            if instants.count:
                yield instants.count, instants.fields
            raise
        yield instants.count, instants.fields


class _InstantRows:
    """Fields of successive instants.

    Args:
      record: names of MjData fields.
      size: the number of instants for which there is room.
    """

    def __init__(self, record: Sequence[str], size: int) -> None:
        self.size, self.count = size, 0
        self._record = record
        self._fields: dict[str, np.ndarray] = {}
        self._targets: list[np.ndarray] = []

    @property
    def fields(self) -> Fields:
        """The fields of the instants so far: `{field: (1, count, …)}`."""
        return {name: values[None, : self.count] for name, values in self._fields.items()}

    def add(self, data: mujoco.MjData) -> None:
        """Adds an instant."""
        index = self.count
        if not index:
            self._allocate(data)
        for target, value in zip(self._targets, self._read(data), strict=False):
            target[index] = value
        self.count = index + 1

    def _allocate(self, data: mujoco.MjData) -> None:
        values = {name: np.asarray(getattr(data, name)) for name in self._record}
        self._fields = {name: np.empty((self.size, *value.shape), value.dtype) for name, value in values.items()}
        filled = [name for name, value in values.items() if value.size]
        self._targets = [self._fields[name] for name in filled]
        self._read = attrgetter(*filled, "time", "time")  # a tuple in any case


def _joined(pieces: Sequence[Fields]) -> Fields:
    if len(pieces) == 1:
        return pieces[0]
    return {name: np.concatenate([piece[name] for piece in pieces], axis=1) for name in pieces[0]}
