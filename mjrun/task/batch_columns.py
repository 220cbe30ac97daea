"""Columns of many worlds at one instant: the fields of `mujoco.batch` that provide them, selected once.

`mujoco.batch` reveals only the fields that MuJoCo computes by itself. For functions that read an MjData, worlds are
stepped side by side in threads: copying an MjData out of a batch takes longer than what is then read from it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import groupby
from pathlib import Path
from threading import Lock
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.batch import SimulationError as BatchError

from mjrun.dataclass import dataclass
from mjrun.model import state
from mjrun.model.source import ModelSource
from mjrun.model.table_column import Column
from mjrun.physics.stepper import RK4, SLEEP
from mjrun.probe.episode_columns import EpisodeProbe
from mjrun.probe.fields import LAZY, MjDataProbe, Probe, RecordedFieldProbe, extents, recorded_probe
from mjrun.probe.select import ALIASES, PAIRS, require_measurable, select

NONE, POSITION, VELOCITY, ACCELERATION = range(4)  # MuJoCo's stages of computation, `mjtStage`
# Derived fields that are complete before the last stage; all others need the last.
STAGES: dict[str, int] = {
    **dict.fromkeys(("cvel", "cdof_dot", "qfrc_bias", "qfrc_passive", "ten_velocity", "actuator_velocity"), VELOCITY),
    **dict.fromkeys(("energy", "subtree_linvel", "subtree_angmom"), VELOCITY),
    **dict.fromkeys(("xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis", "subtree_com"), POSITION),
    **dict.fromkeys(("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat"), POSITION),
    **dict.fromkeys(("light_xpos", "light_xdir", "cdof", "cinert", "ten_length", "actuator_length"), POSITION),
    **dict.fromkeys(("ncon", "crb"), POSITION),
    **dict.fromkeys(state.FIELDS, NONE),
}

# Computations that a step leaves out, and the type of sensor that makes a step perform them.
SENSORS: dict[Callable[[mujoco.MjModel, mujoco.MjData], None], mujoco.mjtSensor] = {
    mujoco.mj_rnePostConstraint: mujoco.mjtSensor.mjSENS_FRAMELINACC,
    mujoco.mj_subtreeVel: mujoco.mjtSensor.mjSENS_SUBTREELINVEL,
}
SENSED = tuple(field for field, computation in LAZY.items() if computation in SENSORS)
NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)

Rows = slice | np.ndarray
ALL = slice(None)
Read = Callable[[Rows, np.ndarray], None]  # reads some worlds into `(k, columns)`
NumberSource = tuple[np.ndarray, int]  # an array `(size,)`, and the place of a number in it
INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
Examine = Callable[[int, mujoco.MjModel, mujoco.MjData], None]
_Call = Callable[[mujoco.MjModel, mujoco.MjData], np.ndarray | None]  # returns the velocities to examine, if others


class MjDataBatch:
    """`nsim` simulations of a model, with the arrays and calls of `mujoco.batch.Batch` and the same results.

    Args:
      model: the model.
      nsim: the number of simulations.
      nthread: the number of threads.
      persistent: whether each simulation has its own MjData, instead of each thread.
      is_lagged: whether a step is examined with the velocities before it, to which all that it computes belongs. With
        RK4, what a step leaves belongs to its last stage instead, and is examined with the new velocities.

    Attributes:
      state: the integration states `(nsim, nstate)`.
      warning: the last information and the number of MuJoCo's warnings of each kind `(nsim, kinds, 2)`.
      examine: called with the id, the model and the MjData of each simulation after every call, in several threads.
    """

    def __init__(
        self, model: mujoco.MjModel, nsim: int, nthread: int, persistent: bool, is_lagged: bool = False
    ) -> None:
        self.model, self.nsim, self._is_lagged = model, nsim, is_lagged
        self._models: Sequence[mujoco.MjModel] = [model] * nsim
        self._layout = Batch(model, 1, 1, persistent)
        self._places = state.fields(state.sizes(model))
        self._persistent, self._threads = persistent, min(nthread, nsim)
        self._datas = [mujoco.MjData(model) for _ in range(nsim if persistent else self._threads)]
        self._warned = [data.warning.number for data in self._datas]
        self._pool = _pool(self._threads - 1)
        self._bound: dict[str, np.ndarray] = {}
        # Views of the bound fields, since making them takes longer than copying: of each simulation and of each MjData.
        self._copies: list[list[np.ndarray]] = [[] for _ in range(nsim)]
        self._sources: list[list[np.ndarray]] = [[] for _ in self._datas]
        self._counts = dict[str, np.ndarray]()  # bound fields that are single numbers
        self.examine: Examine = _ignore
        self.state = np.zeros((nsim, mujoco.mj_stateSize(model, INTEGRATION)))
        self._rows = [*self.state]
        for row in self._rows:
            mujoco.mj_getState(model, self._datas[0], row, INTEGRATION)
        self.warning = np.zeros((nsim, len(self._warned[0]), 2), np.int32)
        self._no_warning = self._warned[0].tobytes()

    def bind(self, name: str) -> np.ndarray:
        """Returns the array `(nsim, …)` of a field of MjData: a view of the states, or a copy made after every call."""
        example: Any = np.asarray(getattr(self._datas[0], name))
        if name in self._places:
            return self.state[:, self._places[name]].reshape(self.nsim, *example.shape)
        if name not in self._bound:
            values = self._bound[name] = np.zeros((self.nsim, *example.shape), example.dtype)
            if example.ndim:
                rows: Sequence[Any] = [*values]
                for copies, row in zip(self._copies, rows, strict=True):
                    copies.append(row)
                for sources, data in zip(self._sources, self._datas, strict=True):
                    sources.append(getattr(data, name))
            else:
                self._counts[name] = values
        return self._bound[name]

    def set_models(self, models: Sequence[mujoco.MjModel]) -> None:
        """Runs each simulation on its own model; raises `mujoco.FatalError` if one has another layout, as `Batch`."""
        for model in set(models) - {*self._models}:
            self._layout.set_models(model)
        self._models = models

    def step(self, ids: np.ndarray | None = None, nstep: int = 1, stage: int = NONE) -> None:
        """Takes steps, and then computes everything that belongs to the new state unless `stage` is NONE.

        Raises:
          BatchError: MuJoCo raised an error in some simulations, which keep their state; the others were stepped.
        """

        def step(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray | None:
            if self._is_lagged and model.opt.integrator != RK4:
                mujoco.mj_step(model, data, nstep - 1)
                velocities = data.qvel.copy()
                mujoco.mj_step(model, data)
                return velocities
            mujoco.mj_step(model, data, nstep)
            if stage != NONE:
                mujoco.mj_forward(model, data)
            return None

        self._run(ids, step)

    def forward(self, ids: np.ndarray | None = None, stage: int = NONE) -> None:
        """Computes everything that belongs to the state; raises the error of `step`."""
        self._run(ids, mujoco.mj_forward)

    def _run(self, ids: np.ndarray | None, call: _Call) -> None:
        worlds = range(self.nsim) if ids is None else ids.tolist()
        failures = dict[int, str]()
        left = iter(worlds)
        others = range(1, min(self._threads, len(worlds)))
        tasks = [self._pool.submit(self._work, left, thread, call, failures) for thread in others if self._pool]
        self._work(left, 0, call, failures)
        for task in tasks:
            task.result()
        if failures:
            failed = sorted(failures)
            raise BatchError(np.array(failed), failures[failed[0]])

    def _work(
        self,
        worlds: Iterator[int],
        thread: int,
        call: _Call,
        failures: dict[int, str],
    ) -> None:
        """Runs simulations until none is left."""
        for world in worlds:
            model, row = self._models[world], self._rows[world]
            place = world if self._persistent else thread
            data = self._datas[place]
            mujoco.mj_setState(model, data, row, INTEGRATION)
            try:
                velocities = call(model, data)
            except mujoco.FatalError as error:
                failures[world] = str(error)
                mujoco.mj_resetData(model, data)
                continue
            mujoco.mj_getState(model, data, row, INTEGRATION)
            if self._warned[place].tobytes() != self._no_warning:
                self._count_warnings(world, data)
            for copy, source in zip(self._copies[world], self._sources[place], strict=True):
                copy[...] = source
            for name, values in self._counts.items():
                values[world] = getattr(data, name)
            if velocities is not None:  # the next call sets the state again
                data.qvel[:] = velocities
            self.examine(world, model, data)

    def _count_warnings(self, world: int, data: mujoco.MjData) -> None:
        """Adds the warnings of a call to those of its simulation."""
        numbers, information = data.warning.number, data.warning.lastinfo
        self.warning[world, :, 1] += numbers
        np.copyto(self.warning[world, :, 0], information, where=numbers > 0)
        numbers[:] = 0


class SingleMjData:
    """The fields of one MjData, which others step, as the arrays of a batch of one simulation.

    Args:
      data: an MjData of the model.

    Attributes:
      examine: called with 0, the model and the MjData at every update.
    """

    nsim = 1

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.model, self.data = model, data
        self.examine: Examine = _ignore
        self._numbers = dict[str, np.ndarray]()

    def bind(self, name: str) -> np.ndarray:
        """Returns a view `(1, …)` of a field; an array of a single number, which is set by `update`."""
        value: Any = getattr(self.data, name)
        if isinstance(value, np.ndarray):
            return value[None]
        return self._numbers.setdefault(name, np.array([value]))

    def update(self) -> None:
        """Sets what are no views of the MjData; called before the arrays are read."""
        for name, number in self._numbers.items():
            number[0] = getattr(self.data, name)
        self.examine(0, self.model, self.data)


def _pool(threads: int) -> Any:
    if not threads:
        return None
    from concurrent.futures import ThreadPoolExecutor  # slow to import

    return ThreadPoolExecutor(threads)


def _ignore(world: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    pass


# --- worlds as MjData --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _FieldPiece:
    """Numbers of a field.

    Attributes:
      places: the places of the numbers in the field.
      is_left_out: whether a step leaves the field out, so that it is computed on an MjData.
    """

    field: str
    places: np.ndarray
    is_left_out: bool

    @property
    def needs_data(self) -> bool:
        return self.is_left_out

    @property
    def fields(self) -> Sequence[str]:
        return () if self.is_left_out else (self.field,)

    @property
    def count(self) -> int:
        return len(self.places)


@dataclass(frozen=True, eq=False)
class _ProbePiece:
    """Numbers that a probe computes from fields, or measures on an MjData.

    Attributes:
      group: the group of columns that the probe measures in full.
      indices: the indices of the numbers in the group.
    """

    probe: RecordedFieldProbe | MjDataProbe
    group: str
    indices: Sequence[int]

    def of(self, model: mujoco.MjModel) -> RecordedFieldProbe:
        """Returns a probe that reads another model of the same structure."""
        (probe,) = select(model, [self.group])
        assert isinstance(probe, RecordedFieldProbe)
        return probe.only(self.indices)

    @property
    def needs_data(self) -> bool:
        return isinstance(self.probe, MjDataProbe)

    @property
    def fields(self) -> Sequence[str]:
        return self.probe.fields if isinstance(self.probe, RecordedFieldProbe) else ()

    @property
    def count(self) -> int:
        return len(self.probe.columns)


_Piece = _FieldPiece | _ProbePiece


class MeasurementPlan:
    """The plan of a measurement: for each column, the source from which it is read.

    Args:
      model: the model with the columns.
      names: the names of the columns in order; a name may occur several times.
      can_sense: whether sensors can be appended to the model, which make MuJoCo compute what a step leaves out.

    Attributes:
      names: the names of the columns.
      count: the number of columns.
      pieces: the pieces from which they are read.
      sensed: the fields that need such sensors.
      stage: the last stage that MuJoCo must compute, `mjtStage`.
      needs_data: whether some columns need an MjData of each world.
      needs_energy: whether some read an energy, which MuJoCo computes on demand.
    """

    def __init__(self, model: mujoco.MjModel, names: Sequence[str], can_sense: bool) -> None:
        self._model = model
        self._group = cache(self._group_of)
        self.names, self.count = names, len(names)
        self.pieces = list(self._pieces(names, can_sense))
        self.needs_data = any(piece.needs_data for piece in self.pieces)
        # Without sensors, the MjData computes the rest too; where bodies sleep, it is read too late for what is lagged.
        if self.needs_data and not model.opt.enableflags & SLEEP:
            self.pieces = list(self._pieces(names, can_sense=False))

        fields = [field for piece in self.pieces for field in piece.fields]
        copied = [piece.field for piece in self.pieces if isinstance(piece, _FieldPiece) and not piece.is_left_out]
        self.sensed = tuple(dict.fromkeys(field for field in copied if field in LAZY))
        self.stage = ACCELERATION if self.needs_data else max(map(self._stage, fields), default=NONE)
        self.needs_energy = "energy" in fields

    def _group_of(self, group: str) -> tuple[Sequence[Column], Probe]:
        """Returns the columns of a group, and the probe that has them."""
        field = ALIASES.get(group, group)
        if field in extents():
            require_measurable(self._model, field)
            probe: Probe = recorded_probe(self._model, field, group)
        else:
            (selected,) = select(self._model, [group])
            assert not isinstance(selected, EpisodeProbe)  # refused in a task
            probe = selected
        return probe.columns, probe

    def _pieces(self, names: Sequence[str], can_sense: bool) -> Iterator[_Piece]:
        """Yields the pieces that provide `names`, as few as possible."""
        for group, members in groupby(names, _group_name):
            columns, probe = self._group(group)
            places = {column.name: index for index, column in enumerate(columns)}
            indices = [places[name] for name in members]
            chosen = probe.only(indices)
            if isinstance(chosen, RecordedFieldProbe) and chosen.places is not None:
                (field,) = chosen.fields
                is_left_out = field in LAZY and not (can_sense and field in SENSED)
                yield _FieldPiece(field, np.array(chosen.places), is_left_out)
            else:
                yield _ProbePiece(chosen, group, indices)

    def _stage(self, field: str) -> int:
        if field == "sensordata":
            return int(self._model.sensor_needstage.max(initial=NONE))
        return STAGES.get(field, ACCELERATION)


class _DataColumns:
    """Columns that are read from an MjData.

    Attributes:
      measured: probes, and the places of their columns.
    """

    def __init__(self) -> None:
        self.measured: list[tuple[slice, MjDataProbe]] = []
        self._computations: list[Callable[[mujoco.MjModel, mujoco.MjData], None]] = []
        self._computed: list[tuple[slice, str, slice | np.ndarray]] = []
        self._views: dict[int, list[tuple[slice, np.ndarray, np.ndarray | None]]] = {}  # of each MjData, by its id
        self._lock = Lock()  # probes may share memory

    @property
    def places(self) -> list[slice]:
        """The places of all columns."""
        return [place for place, *_ in (*self.measured, *self._computed)]

    def compute(self, place: slice, piece: _FieldPiece) -> None:
        """Adds numbers of a field that a step leaves out."""
        if LAZY[piece.field] not in self._computations:
            self._computations.append(LAZY[piece.field])
        self._computed.append((place, piece.field, as_slice(piece.places)))

    def read(self, model: mujoco.MjModel, data: mujoco.MjData, row: np.ndarray) -> None:
        """Writes the columns into a row; changes fields that a step computes from the state.

        The MjData is one of a few that last as long as this object.
        """
        if self.measured:
            with self._lock:
                for place, probe in self.measured:
                    row[place] = probe.measure(model, data)
        for computation in self._computations:
            computation(model, data)
        if (views := self._views.get(id(data))) is None:
            views = self._views[id(data)] = [*self._viewed(data)]
        for place, values, scattered in views:
            row[place] = values if scattered is None else values[scattered]

    def _viewed(self, data: mujoco.MjData) -> Iterator[tuple[slice, np.ndarray, np.ndarray | None]]:
        """Yields views of the computed numbers; with the places of those that are not adjacent, which have none."""
        for place, field, places in self._computed:
            values = getattr(data, field).reshape(-1)
            yield (place, values[places], None) if isinstance(places, slice) else (place, values, places)


class BatchColumns:
    """Columns of the worlds of a batch, as of its last call.

    A `MjDataBatch` examines the MjData of each world right after its step.

    Attributes:
      count: the number of columns.
    """

    def __init__(
        self,
        batch: Batch | MjDataBatch | SingleMjData,
        plan: MeasurementPlan,
        model_of: Callable[[int], mujoco.MjModel],
    ) -> None:
        self._batch, self._model_of = batch, model_of
        self.count = plan.count
        self._first: dict[str, np.ndarray] = {}  # fields at the start of each episode, for probes that read them
        self._fields: dict[str, np.ndarray] = {}  # flattened, `(n, size)`
        self._gathered: list[tuple[slice, str, np.ndarray]] = []  # columns that are numbers of a field, at these places
        self._copied: list[tuple[slice, np.ndarray]] = []  # views `(n, …)` of adjacent numbers
        self._reads: list[tuple[slice, Read]] = []
        examined = _DataColumns()
        start = 0
        for piece in plan.pieces:
            place = slice(start, start := start + piece.count)
            match piece:
                case _FieldPiece(is_left_out=True):
                    examined.compute(place, piece)
                case _FieldPiece():
                    self._gather(place, piece)
                case _ProbePiece(probe=RecordedFieldProbe() as probe):
                    compute = self._compute_by_model(piece) if probe.reads_model else self._compute(probe)
                    self._reads.append((place, compute))
                case _ProbePiece(probe=MjDataProbe() as probe):
                    examined.measured.append((place, probe))
        self._examined = None
        if not isinstance(batch, Batch):
            if examined.places:
                values = np.zeros((batch.nsim, plan.count))
                rows = [*values]
                batch.examine = lambda world, model, data: examined.read(model, data, rows[world])
                self._copied += [(place, values[:, place]) for place in examined.places]
        elif examined.places:
            self._examined, self._scratch = examined, mujoco.MjData(batch.model)

    @property
    def memory(self) -> list[np.ndarray]:
        """The fields that it remembers of each world `(count, …)`."""
        return [*self._first.values()]

    def begin_as(self, other: "BatchColumns") -> None:
        """Takes the first instants of the episodes from the same columns of another batch."""
        for field, first in self._first.items():
            first[...] = other._first[field]

    def begin(self, rows: Rows) -> None:
        """Takes the current instant as the first of an episode in each of these worlds."""
        for field, first in self._first.items():
            first[rows] = self._batch.bind(field)[rows]

    def read(self, rows: Rows, out: np.ndarray) -> None:
        """Writes the columns of the worlds `rows` into `out` `(k, columns)`."""
        for place, values in self._copied:
            out[:, place] = values[rows]
        for place, read in self._reads:
            read(rows, out[:, place])
        if self._examined:
            self._examine(np.arange(self._batch.nsim)[rows], out)

    def alone(self) -> tuple[list[NumberSource], Callable[[], None] | None]:
        """Returns the source of each column of the only world, and a function that updates those that are no fields."""
        row = np.zeros(self.count)
        sources: list[NumberSource] = [(row, place) for place in range(self.count)]
        fields = {name: values[0] for name, values in self._fields.items() if values.dtype == row.dtype}
        for place, name, places in self._gathered:
            if name in fields:
                sources[place] = [(fields[name], index) for index in places.tolist()]
        others = {place for source, place in sources if source is row}
        if not others:
            return sources, None
        copies = [(row[place], values[0]) for place, values in self._copied if place.start in others]
        reads = [(read, row[None, place]) for place, read in self._reads if place.start in others]

        def update() -> None:
            if isinstance(self._batch, SingleMjData):
                self._batch.update()
            for target, values in copies:
                target[...] = values
            for read, target in reads:
                read(ALL, target)
            if self._examined:
                self._examine(np.zeros(1, int), row[None])

        return sources, update

    def _examine(self, worlds: np.ndarray, out: np.ndarray) -> None:
        """Writes the columns that need an MjData into `out` `(k, columns)`."""
        assert self._examined
        assert isinstance(self._batch, Batch)
        for row, world in zip(out, worlds.tolist(), strict=True):
            self._batch.get_data(world, self._scratch)
            self._examined.read(self._model_of(world), self._scratch, row)

    def _gather(self, place: slice, piece: _FieldPiece) -> None:
        """Prepares reading numbers of a field into the columns `place`."""
        field, places = piece.field, piece.places
        if field not in self._fields:
            self._fields[field] = self._batch.bind(field).reshape(self._batch.nsim, -1)  # a view
        values = self._fields[field]
        self._gathered.append((place, field, places))
        run = as_slice(places)
        if isinstance(run, slice):
            self._copied.append((place, values[:, run]))
            return

        def gather(rows: Rows, out: np.ndarray) -> None:
            out[:] = values[:, places] if isinstance(rows, slice) else values[rows[:, None], places]

        self._reads.append((place, gather))

    def _compute(self, probe: RecordedFieldProbe) -> Read:
        fields = {name: self._batch.bind(name) for name in probe.fields}
        if probe.needs_initial:
            self._first |= {name: np.zeros_like(values) for name, values in fields.items()}
        first = self._first

        def compute(rows: Rows, out: np.ndarray) -> None:
            now = {name: values[rows] for name, values in fields.items()}
            initial = {name: first[name][rows] for name in fields} if probe.needs_initial else now
            out[:] = probe.compute(now, initial)

        return compute

    def _compute_by_model(self, piece: _ProbePiece) -> Read:
        """Computes a probe that reads numbers of the model, which may differ from world to world."""
        readers: dict[int, tuple[mujoco.MjModel, Read]] = {}
        for field in piece.fields:
            self._batch.bind(field)  # a field that is bound later has no values before the next call

        def compute(rows: Rows, out: np.ndarray) -> None:
            for row, world in enumerate(np.arange(self._batch.nsim)[rows].tolist()):
                model = self._model_of(world)
                if world not in readers or readers[world][0] is not model:
                    readers[world] = model, self._compute(piece.of(model))
                readers[world][1](np.array([world]), out[row : row + 1])

        return compute


@dataclass(frozen=True)
class SourceWithSensors(ModelSource):
    """A model with sensors appended, so that a step also computes `fields`, which it would otherwise leave out.

    Args:
      source: the source of the model, with its own overrides.
      fields: fields of MjData that are in `SENSED`.
    """

    source: ModelSource
    fields: tuple[str, ...]

    @property
    def text(self) -> str:
        return self.source.text

    @property
    def stem(self) -> str:
        return self.source.stem

    @property
    def files(self) -> tuple[Path, ...]:
        return self.source.files

    def stored_at(self, place: Callable[[Path], Path]) -> ModelSource:
        return replace(self, source=self.source.stored_at(place))

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        spec, _ = self.source.with_overrides(self.overrides).compile()
        assert spec, "a compiled model cannot get sensors"
        for computation in dict.fromkeys(LAZY[field] for field in self.fields):
            spec.add_sensor(type=SENSORS[computation], objtype=mujoco.mjtObj.mjOBJ_BODY, objname="world")
        return spec, spec.compile()


def can_sense(spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> bool:
    """Returns whether sensors can be appended to a model, and MuJoCo computes them."""
    return spec is not None and not model.opt.disableflags & NO_SENSORS


def as_slice(places: np.ndarray) -> slice | np.ndarray:
    """Returns adjacent `places` as a slice, which is faster, and any others unchanged."""
    start = int(places[0]) if len(places) else 0
    run = slice(start, start + len(places))
    return run if np.array_equal(places, np.arange(run.start, run.stop)) else places


def _group_name(name: str) -> str:
    """Returns the group by which a column can be selected with others; contacts of a pair are a group each."""
    is_pair = name.startswith(f"{PAIRS}/") and name.count("/") > 1
    return name if is_pair else name.partition("/")[0]
