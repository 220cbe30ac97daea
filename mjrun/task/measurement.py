"""Columns of many worlds at one instant: what is read of `mujoco.batch`, and how, decided once."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from mjrun.model import state
from mjrun.model.column import Column
from mjrun.model.source import Source
from mjrun.probe.episode import EpisodeProbe
from mjrun.probe.fields import LAZY, FieldProbe, InstantProbe, Probe, extents, recorded_probe
from mjrun.probe.select import ALIASES, PAIRS, select

NONE, POSITION, VELOCITY, ACCELERATION = range(4)  # MuJoCo's stages of computation, `mjtStage`
# Derived fields that a stage before the last gives; all others take the last.
STAGES: dict[str, int] = {
    **dict.fromkeys(("cvel", "cdof_dot", "qfrc_bias", "qfrc_passive", "ten_velocity", "actuator_velocity"), VELOCITY),
    **dict.fromkeys(("energy", "subtree_linvel", "subtree_angmom"), VELOCITY),
    **dict.fromkeys(("xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis", "subtree_com"), POSITION),
    **dict.fromkeys(("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat"), POSITION),
    **dict.fromkeys(("light_xpos", "light_xdir", "cdof", "cinert", "ten_length", "actuator_length"), POSITION),
    **dict.fromkeys(("ncon", "crb"), POSITION),
    **dict.fromkeys(state.FIELDS, NONE),
}

# What computes a field that a step leaves out, and a sensor that needs it.
SENSORS: dict[Callable[[mujoco.MjModel, mujoco.MjData], None], mujoco.mjtSensor] = {
    mujoco.mj_rnePostConstraint: mujoco.mjtSensor.mjSENS_FRAMELINACC,
    mujoco.mj_subtreeVel: mujoco.mjtSensor.mjSENS_SUBTREELINVEL,
}
SENSED = tuple(field for field, computation in LAZY.items() if computation in SENSORS)
NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)

Rows = slice | np.ndarray
ALL = slice(None)
Read = Callable[[Rows, np.ndarray], None]  # of some worlds, into `(k, columns)`


@dataclass(frozen=True, eq=False)
class _OfField:
    """Numbers of a field, by their places in it.

    Attributes:
      is_left_out: whether a step leaves the field out, so that it is computed on an MjData.
    """

    field: str
    places: np.ndarray
    is_left_out: bool

    @property
    def is_whole(self) -> bool:
        return self.is_left_out

    @property
    def count(self) -> int:
        return len(self.places)


@dataclass(frozen=True, eq=False)
class _OfProbe:
    """Numbers that a probe computes from fields, or measures on an MjData."""

    probe: FieldProbe | InstantProbe
    count: int

    @property
    def is_whole(self) -> bool:
        return isinstance(self.probe, InstantProbe)


_Piece = _OfField | _OfProbe


class MeasurementPlan:
    """How columns are measured.

    Args:
      model: which has them.
      names: of columns, in the order in which they are wanted; any may stand twice.
      can_sense: whether the model can get sensors that make MuJoCo compute what a step leaves out.

    Attributes:
      columns: in that order.
      pieces: that they are read by.
      sensed: the fields for which it must get such sensors.
      stage: up to which MuJoCo must compute, `mjtStage`.
      is_whole: whether some columns need a whole MjData for each world.
      needs_energy: whether some are of an energy, which MuJoCo computes on demand.
    """

    def __init__(self, model: mujoco.MjModel, names: Sequence[str], can_sense: bool) -> None:
        self._model = model
        self._group = cache(self._group_of)
        self.columns = [self._column(name) for name in names]
        self.pieces = list(self._merged(names, can_sense))
        self.is_whole = any(piece.is_whole for piece in self.pieces)
        if self.is_whole:  # where an MjData is needed anyhow, sensors are not
            self.pieces = list(self._merged(names, can_sense=False))

        fields = [field for piece in self.pieces for field in _fields(piece)]
        gathered = [piece.field for piece in self.pieces if isinstance(piece, _OfField) and not piece.is_left_out]
        self.sensed = tuple(dict.fromkeys(field for field in gathered if field in LAZY))
        self.stage = max((self._stage(field) for field in fields), default=NONE)
        self.stage = ACCELERATION if self.is_whole else self.stage
        self.needs_energy = "energy" in fields

    def _column(self, name: str) -> Column:
        columns, _ = self._group(_group_name(name))
        return next(column for column in columns if column.name == name)

    def _group_of(self, group: str) -> tuple[Sequence[Column], Probe]:
        """The columns of a group, and the probe that has them."""
        field = ALIASES.get(group, group)
        if field in extents():
            probe: Probe = recorded_probe(self._model, field, group)
        else:
            (selected,) = select(self._model, [group])
            assert not isinstance(selected, EpisodeProbe)  # which a task cannot name
            probe = selected
        return probe.columns, probe

    def _merged(self, names: Sequence[str], can_sense: bool) -> Iterator[_Piece]:
        """The pieces that `names` are of, as few as there can be."""
        for group, members in groupby(names, _group_name):
            columns, probe = self._group(group)
            places = {column.name: index for index, column in enumerate(columns)}
            indices = np.array([places[name] for name in members])
            field = ALIASES.get(group, group)
            if field in extents():
                is_left_out = field in LAZY and not (can_sense and field in SENSED)
                yield _OfField(field, indices, is_left_out)
            elif isinstance(probe, FieldProbe):
                yield _OfProbe(probe.only(indices.tolist()), len(indices))
            else:
                yield _OfProbe(probe.only(indices.tolist()), len(indices))

    def _stage(self, field: str) -> int:
        if field == "sensordata":
            return int(self._model.sensor_needstage.max(initial=NONE))
        return STAGES.get(field, ACCELERATION)


class Measurement:
    """Columns of the worlds of a batch at the instant that its last call has left.

    Attributes:
      count: how many columns.
    """

    def __init__(self, batch: Batch, plan: MeasurementPlan, model_of: Callable[[int], mujoco.MjModel]) -> None:
        self._batch, self._model_of = batch, model_of
        self.count = len(plan.columns)
        self._state_fields = state.fields(state.sizes(batch.model))
        self._first: dict[str, np.ndarray] = {}  # fields at the start of each episode, for probes that look at them
        self._runs: list[tuple[slice, np.ndarray]] = []  # views `(n, …)` of columns that follow each other in a field
        self._reads: list[tuple[slice, Read]] = []
        self._measured: list[tuple[slice, InstantProbe]] = []
        left_out: list[tuple[slice, _OfField]] = []
        start = 0
        for piece in plan.pieces:
            place = slice(start, start := start + piece.count)
            match piece:
                case _OfField(is_left_out=True):
                    left_out.append((place, piece))
                case _OfField():
                    self._gather(place, piece)
                case _OfProbe(probe=FieldProbe() as probe):
                    self._reads.append((place, self._compute(probe)))
                case _OfProbe(probe=InstantProbe() as probe):
                    self._measured.append((place, probe))
        self._complete(left_out)

    @property
    def memory(self) -> list[np.ndarray]:
        """What it remembers of each world `(count, …)`."""
        return [*self._first.values()]

    def begin(self, rows: Rows) -> None:
        """Takes the instant for the first of an episode of each of these worlds."""
        for field, first in self._first.items():
            first[rows] = self._batch.bind(field)[rows]

    def read(self, rows: Rows, out: np.ndarray) -> None:
        """Writes the columns of the worlds `rows` into `out` `(k, columns)`."""
        for place, values in self._runs:
            out[:, place] = values[rows]
        for place, read in self._reads:
            read(rows, out[:, place])
        if self._completed or self._measured:
            self._examine(np.arange(self._batch.nsim)[rows], out)

    def reader(self, out: np.ndarray) -> Callable[[], None]:
        """A function that writes the columns of a batch's only world into `out` `(columns,)`; faster than `read`."""
        copies = [(out[place], values[0]) for place, values in self._runs]
        reads = [(read, out[None, place]) for place, read in self._reads]
        has_more = bool(self._completed or self._measured)

        def read_all() -> None:
            for target, values in copies:
                target[...] = values
            for read, target in reads:
                read(ALL, target)
            if has_more:
                self._examine(np.zeros(1, int), out[None])

        return read_all

    def _complete(self, pieces: Sequence[tuple[slice, _OfField]]) -> None:
        """Prepares what is computed on an MjData of ours."""
        self._scratch = mujoco.MjData(self._batch.model)
        self._computations = list(dict.fromkeys(LAZY[piece.field] for _, piece in pieces))
        self._completed = [
            (place, getattr(self._scratch, piece.field).reshape(-1), as_slice(piece.places)) for place, piece in pieces
        ]

    def _examine(self, worlds: np.ndarray, out: np.ndarray) -> None:
        """Writes what an MjData is needed for into `out` `(k, columns)`."""
        for row, world in zip(out, worlds.tolist(), strict=True):
            model, data = self._model_of(world), self._scratch
            self._batch.get_data(world, data)
            for place, probe in self._measured:
                row[place] = probe.measure(model, data)
            for computation in self._computations:
                computation(model, data)
            for place, values, places in self._completed:
                row[place] = values[places]

    def _gather(self, place: slice, piece: _OfField) -> None:
        """Prepares what is read of a field into the columns `place`."""
        if piece.field in state.FIELDS:  # views of the states: gathered from there
            start = self._state_fields[piece.field].start
            values, places = self._batch.state, piece.places + start
        else:
            values, places = self._batch.bind(piece.field), piece.places
            values = values.reshape(self._batch.nsim, -1)
        run = as_slice(places)
        if isinstance(run, slice):
            self._runs.append((place, values[:, run]))
            return

        def gather(rows: Rows, out: np.ndarray) -> None:
            out[:] = values[:, places] if isinstance(rows, slice) else values[rows[:, None], places]

        self._reads.append((place, gather))

    def _compute(self, probe: FieldProbe) -> Read:
        fields = {name: self._batch.bind(name) for name in probe.fields}
        if probe.needs_initial:
            self._first |= {name: np.zeros_like(values) for name, values in fields.items()}
        first = self._first

        def compute(rows: Rows, out: np.ndarray) -> None:
            now = {name: values[rows] for name, values in fields.items()}
            then = {name: first[name][rows] for name in fields} if probe.needs_initial else now
            out[:] = probe.compute(now, then)

        return compute


@dataclass(frozen=True)
class SensingSource(Source):
    """A model with a sensor of the world for each way of computing `fields`, behind all others.

    Args:
      source: of the model, with overrides of its own.
      fields: of MjData, of those in `SENSED`.
    """

    source: Source
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

    def stored_at(self, place: Callable[[Path], Path]) -> Source:
        return replace(self, source=self.source.stored_at(place))

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        spec, _ = self.source.with_overrides(self.overrides).compile()
        assert spec, "a compiled model cannot get sensors"
        for computation in dict.fromkeys(LAZY[field] for field in self.fields):
            spec.add_sensor(type=SENSORS[computation], objtype=mujoco.mjtObj.mjOBJ_BODY, objname="world")
        return spec, spec.compile()


def can_sense(spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> bool:
    """Whether a model can get sensors, and MuJoCo computes them."""
    return spec is not None and not model.opt.disableflags & NO_SENSORS


def as_slice(places: np.ndarray) -> slice | np.ndarray:
    """`places` as a slice, which is faster, where they follow each other."""
    start = int(places[0]) if len(places) else 0
    run = slice(start, start + len(places))
    return run if np.array_equal(places, np.arange(run.start, run.stop)) else places


def _group_name(name: str) -> str:
    """The group of a column: what it may be asked for with all its like; a pair's contacts are their own."""
    is_pair = name.startswith(f"{PAIRS}/") and name.count("/") > 1
    return name if is_pair else name.partition("/")[0]


def _fields(piece: _Piece) -> Sequence[str]:
    """The fields that a piece reads; none of those that an MjData is needed for."""
    if isinstance(piece, _OfField):
        return () if piece.is_left_out else (piece.field,)
    return piece.probe.fields if isinstance(piece.probe, FieldProbe) else ()
