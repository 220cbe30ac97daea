"""Columns of the fixed-size fields of MjData: their objects, components, units and meanings.

The meaning of a field, and the kind of object that indexes it, are read from MuJoCo's own description of mjData.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import product
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import DATA_FIELDS

from mjrun.dataclass import dataclass
from mjrun.model import state
from mjrun.model.names import KIND_OF_COUNT, QPOS_COMPONENTS, QUATERNION, QVEL_COMPONENTS, VECTOR, actuator_parts, names
from mjrun.model.table_column import Column
from mjrun.model.units import field_unit, sensor_unit

# Counts of parts of actuators, and the number of parts per actuator in the model.
PARTS = {"nu": "actuator_ctrlnum", "nout": "actuator_outnum"}
MATRIX = tuple(f"{row}{column}" for row in "xyz" for column in "xyz")
NUMBERED = ("nflex", "nplugin")  # counts of objects whose names are numbers
COMPONENTS = {3: VECTOR, 4: QUATERNION, 9: MATRIX}
# Spatial vectors, in MuJoCo's own order: rotation first, except in xfrc_applied.
TWIST, WRENCH = ("wx", "wy", "wz", "vx", "vy", "vz"), ("tx", "ty", "tz", "fx", "fy", "fz")
SPATIAL = {"cvel": TWIST, "cacc": TWIST, "cdof": TWIST, "cdof_dot": TWIST, "cfrc_int": WRENCH, "cfrc_ext": WRENCH}
SPATIAL |= {"xfrc_applied": WRENCH[3:] + WRENCH[:3]}

# Generalized quantities: units for a translation and for a rotation.
DOF_UNITS = {"qvel": ("m/s", "rad/s")}
DOF_UNITS |= dict.fromkeys(("qacc", "qacc_smooth", "qacc_warmstart"), ("m/s²", "rad/s²"))
FORCE_UNITS = ("N", "N·m")
# Units of spatial vectors, by the first letter of their components.
WRENCH_UNITS = {"f": "N", "t": "N·m"}
SPATIAL_UNITS: dict[str, dict[str, str]] = dict.fromkeys(("cfrc_int", "cfrc_ext", "xfrc_applied"), WRENCH_UNITS)
SPATIAL_UNITS |= {"cvel": {"w": "rad/s", "v": "m/s"}, "cacc": {"w": "rad/s²", "v": "m/s²"}}

# Fields that cannot be measured, and the reasons.
UNMEASURABLE: dict[str, str] = {
    **dict.fromkeys(("qH", "qHDiagInv", "qDeriv", "qLU"), "an integrator computes it in the middle of a step"),
    "flexvert_lambda": "a step passes it on to the next, outside the state",
    "flexvert_conage": "a step passes it on to the next, outside the state",
    "plugin_data": "it holds addresses in memory",
}

Fields = Mapping[str, np.ndarray]
Binder = Callable[[mujoco.MjModel, mujoco.MjData], Callable[[], np.ndarray]]


@dataclass(frozen=True)
class RecordedFieldProbe:
    """A probe whose columns are computed from recorded fields, for any number of simulations and instants at once.

    Attributes:
      columns: columns in order.
      fields: fields of MjData that it reads; all of them must belong to one instant.
      compute: returns `(*instants, len(columns))`, given fields `{name: (*instants, …)}`, whose leading axes are any
        number of instants, and the same fields at step 0 of each simulation, which broadcast against them.
      relative: names of the columns that use the latter.
      reads_model: whether `compute` also reads numbers of the model, such as masses.
      places: the places of the columns in the only field, where they are its numbers unchanged; None otherwise.
    """

    columns: Sequence[Column]
    fields: Sequence[str]
    compute: Callable[[Fields, Fields], np.ndarray]
    relative: Collection[str] = ()
    reads_model: bool = False
    places: Sequence[int] | None = None

    @property
    def needs_initial(self) -> bool:
        """True if `compute` reads the fields at step 0."""
        return bool(self.relative)

    def only(self, indices: Sequence[int]) -> "RecordedFieldProbe":
        """Returns the probe with only these of its columns."""
        index, compute = np.array(indices, int), self.compute
        columns = [self.columns[i] for i in indices]
        places = None if self.places is None else [self.places[i] for i in indices]
        return replace(
            self, columns=columns, compute=lambda fields, initial: compute(fields, initial)[..., index], places=places
        )


@dataclass(frozen=True)
class MjDataProbe:
    """A probe whose columns are measured on an MjData, as no recorded field holds them.

    Attributes:
      columns: columns in order.
      bind: returns a function of a model and an MjData that measures `(len(columns),)` whenever everything in the
        MjData belongs to one instant; it modifies neither.
    """

    columns: Sequence[Column]
    bind: Binder

    def measure(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Measures a single instant."""
        return self.bind(model, data)()

    def only(self, indices: Sequence[int]) -> "MjDataProbe":
        """Returns the probe with only these of its columns."""
        index, whole = np.array(indices, int), self.bind

        def bind(model: mujoco.MjModel, data: mujoco.MjData) -> Callable[[], np.ndarray]:
            measure = whole(model, data)
            return lambda: measure()[index]

        return MjDataProbe([self.columns[i] for i in indices], bind)


Probe = RecordedFieldProbe | MjDataProbe


@cache
def extents() -> dict[str, tuple[tuple[str | int, ...], str]]:
    """Returns every array field of MjData that can be recorded, with its extents and its meaning."""
    from mujoco.introspect import structs  # slow to import, and images need no columns

    described: Any = structs.STRUCTS["mjData"].fields
    arrays = [field for field in described if getattr(field, "array_extent", None)]
    recordable = DATA_FIELDS - UNMEASURABLE.keys()
    return {field.name: (tuple(field.array_extent), field.doc) for field in arrays if field.name in recordable}


def offered(model: mujoco.MjModel) -> list[str]:
    """Returns the fields that have columns in `model`."""
    return [name for name in extents() if math.prod(_shape(model, name)) and not unmeasurable(model, name)]


def unmeasurable(model: mujoco.MjModel, field: str) -> str:
    """Returns why `field` cannot be measured at an instant of `model`; empty if it can be, or if none has that name."""
    is_discrete = bool(model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    if field == "qfrc_inverse" and is_discrete and model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return "MuJoCo's inverse dynamics of discrete time (flag invdiscrete) excludes the integrator RK4"
    return UNMEASURABLE.get(field, "")


def field_probe(model: mujoco.MjModel, field: str, group: str = "") -> Probe:
    """Returns the probe of a field; the names of its columns begin with `group`, or with the field's own name."""
    if field in LAZY:
        return MjDataProbe(tuple(_columns(model, field, group or field)), _completed(field))
    return recorded_probe(model, field, group)


def recorded_probe(model: mujoco.MjModel, field: str, group: str = "") -> RecordedFieldProbe:
    """Returns the probe of a field as a step leaves it; fields in `LAZY` are valid only if a sensor needs them."""
    columns = tuple(_columns(model, field, group or field))
    axes = len(extents()[field][0])
    if field == "sensordata" and (kinetic := kinetic_sensors(model)):
        return _sensor_probe(model, columns, kinetic)

    def compute(fields: Fields, initial: Fields) -> np.ndarray:
        values = fields[field]
        return values.reshape(*values.shape[: values.ndim - axes], -1).astype(float, copy=False)

    return RecordedFieldProbe(columns, (field,), compute, places=range(len(columns)))


def kinetic_sensors(model: mujoco.MjModel) -> list[int]:
    """Returns the ids of the sensors of kinetic energy whose values are those of the instant."""
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR:
        return []
    is_kinetic = model.sensor_type == mujoco.mjtSensor.mjSENS_E_KINETIC
    is_late = (model.sensor_delay > 0) | (model.sensor_interval[:, 0] > 0)
    return np.flatnonzero(is_kinetic & ~is_late).tolist()


def _sensor_probe(model: mujoco.MjModel, columns: Sequence[Column], kinetic: Sequence[int]) -> RecordedFieldProbe:
    """Returns the probe of sensors, of which those of kinetic energy are read from the energy of the instant.

    With the energy flag, which measuring energy sets, MuJoCo gives these sensors the energy of the step before.
    """
    places, cutoffs = model.sensor_adr[kinetic], model.sensor_cutoff[kinetic]
    limits = np.where(cutoffs > 0, cutoffs, np.inf)

    def compute(fields: Fields, initial: Fields) -> np.ndarray:
        values = fields["sensordata"].astype(float)
        values[..., places] = np.minimum(fields["energy"][..., 1:], limits)
        return values

    return RecordedFieldProbe(columns, ("sensordata", "energy"), compute)


_compute_inverse = partial(mujoco.mj_inverseSkip, skipstage=int(mujoco.mjtStage.mjSTAGE_VEL), skipsensor=True)

# Fields that a step computes only if a sensor needs them, and the functions that compute them.
LAZY: dict[str, Callable[[mujoco.MjModel, mujoco.MjData], None]] = {
    "qfrc_inverse": _compute_inverse,
    **dict.fromkeys(("cacc", "cfrc_int", "cfrc_ext"), mujoco.mj_rnePostConstraint),
    **dict.fromkeys(("subtree_linvel", "subtree_angmom"), mujoco.mj_subtreeVel),
}
# All that these functions change in an MjData: arrays, arrays whose places and sizes change, and a flag.
CHANGED: dict[Callable[..., None], tuple[Sequence[str], Sequence[str], str]] = {
    _compute_inverse: (("qfrc_inverse", "qfrc_constraint"), ("efc_force", "efc_state"), ""),
    mujoco.mj_rnePostConstraint: (("cacc", "cfrc_int", "cfrc_ext"), (), "flg_rnepost"),
    mujoco.mj_subtreeVel: (("subtree_linvel", "subtree_angmom"), (), "flg_subtreevel"),
}


def _completed(field: str) -> Binder:
    """Measures a field that a step leaves out, and puts back what its computation changes."""
    compute = LAZY[field]
    fixed, moving, flag = CHANGED[compute]

    def bind(model: mujoco.MjModel, data: mujoco.MjData) -> Callable[[], np.ndarray]:
        values = getattr(data, field)
        # Bytes of arrays in place, which are copied and written faster than their numbers.
        views = [getattr(data, name).reshape(-1).view(np.uint8).data for name in fixed]

        def measure() -> np.ndarray:
            contents = [view.tobytes() for view in views]
            arrays = [getattr(data, name) for name in moving]
            copies = [array.copy() for array in arrays]
            raised = getattr(data, flag) if flag else False
            compute(model, data)
            measured = values.flatten()

            for view, content in zip(views, contents, strict=True):
                view[:] = content
            for array, before in zip(arrays, copies, strict=True):
                array[:] = before
            if flag:
                setattr(data, flag, raised)
            return measured

        return measure

    return bind


def _shape(model: mujoco.MjModel, field: str) -> tuple[int, ...]:
    return tuple(size if isinstance(size, int) else getattr(model, size) for size in extents()[field][0])


def _columns(model: mujoco.MjModel, field: str, group: str) -> Iterator[Column]:
    extent, meaning = extents()[field]
    first = extent[0]
    if field == "qpos":
        yield from _of_joints(model, group, meaning, QPOS_COMPONENTS, field)
    elif first == "nv":
        yield from _of_joints(model, group, meaning, QVEL_COMPONENTS, field, SPATIAL.get(field, ("",)))
    elif field == "sensordata":
        yield from _of_sensors(model, group)
    elif first == "na":
        yield from _of_activations(model, group, meaning)
    else:
        yield from _of_objects(model, field, group, meaning)


def _of_joints(
    model: mujoco.MjModel,
    group: str,
    meaning: str,
    parts: Mapping[int, tuple[str, ...]],
    field: str,
    inner: Sequence[str] = ("",),
) -> Iterator[Column]:
    joints = names(model, "joint")
    for joint, kind in enumerate(map(int, model.jnt_type)):
        for part, component in product(parts.get(kind, ("",)), inner):
            name = "/".join(filter(None, (group, joints[joint], part, component)))
            yield Column(name, _joint_unit(field, kind, part), meaning, "joint", joint)


def _joint_unit(field: str, kind: int, part: str) -> str:
    turns = part.startswith("w") if part else kind == mujoco.mjtJoint.mjJNT_HINGE
    if field == "qpos":
        return "" if part.startswith("q") else "rad" if turns else "m"
    return DOF_UNITS.get(field, FORCE_UNITS if field.startswith("qfrc") else ("", ""))[turns]


def _of_sensors(model: mujoco.MjModel, group: str) -> Iterator[Column]:
    sensors = names(model, "sensor")
    for sensor, size in enumerate(map(int, model.sensor_dim)):
        kind = mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_").lower()
        parts = ("",) if size == 1 else COMPONENTS.get(size if size in (3, 4) else 0, tuple(map(str, range(size))))
        for part in parts:
            name = f"{group}/{sensors[sensor]}" + (f"/{part}" if part else "")
            yield Column(name, sensor_unit(model, sensor), f"{kind} sensor", "sensor", sensor)


def _of_activations(model: mujoco.MjModel, group: str, meaning: str) -> Iterator[Column]:
    actuators = names(model, "actuator")
    for actuator, count in enumerate(map(int, model.actuator_actnum)):
        for i in range(count):
            name = f"{group}/{actuators[actuator]}" + (f"/{i}" if count > 1 else "")
            yield Column(name, "", meaning, "actuator", actuator)


def _of_objects(model: mujoco.MjModel, field: str, group: str, meaning: str) -> Iterator[Column]:
    shape = _shape(model, field)
    kind, objects = _objects(model, str(extents()[field][0][0]), shape[0])
    width = math.prod(shape[1:])
    parts = SPATIAL.get(field) or COMPONENTS.get(width, tuple(map(str, range(width))))
    for name, index in objects:
        for part in ("",) if len(shape) == 1 else parts:
            unit = _unit(model, field, part, index)
            yield Column(f"{group}/{name}" + (f"/{part}" if part else ""), unit, meaning, kind, index)


def _unit(model: mujoco.MjModel, field: str, part: str, index: int) -> str:
    if field in SPATIAL_UNITS:
        return SPATIAL_UNITS[field][part[0]]
    return field_unit(model, field, index)


def _objects(model: mujoco.MjModel, counted: str, count: int) -> tuple[str, list[tuple[str, int]]]:
    """Returns kind, names and ids of the objects that the first dimension of a field counts."""
    if counted in PARTS:
        return "actuator", actuator_parts(model, getattr(model, PARTS[counted]))
    kind = KIND_OF_COUNT.get(counted, "")
    if not kind or counted in NUMBERED:
        return "", [(str(i), -1) for i in range(count)]
    return kind, [(name, i) for i, name in enumerate(names(model, kind))]


def state_columns(model: mujoco.MjModel) -> list[str]:
    """Returns the names of all numbers in an integration state of `model`, in order, as in columns of traces."""
    names: list[str] = []
    for field, part in state.fields(state.sizes(model)).items():
        own = ["time"] if field == "time" else [column.name for column in field_probe(model, field).columns]
        assert len(own) == part.stop - part.start, field
        names += own
    return names
