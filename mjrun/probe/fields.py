"""Columns of the fixed-size fields of MjData: their objects, components, units and meanings.

What a field holds, and by which object it is indexed, is read from MuJoCo's own description of mjData.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import DATA_FIELDS
from mujoco.introspect import structs

from mjrun.model.column import Column
from mjrun.model.description.units import sensor_unit
from mjrun.model.joints import QPOS_PARTS, QVEL_PARTS
from mjrun.model.names import actuator_parts, names

# What the first dimension of a field counts, as the kind of object and the model's size of it.
KINDS = {"nbody": "body", "njnt": "joint", "ngeom": "geom", "nsite": "site", "ncam": "camera", "ntendon": "tendon"}
KINDS |= {"nlight": "light", "nactuator": "actuator", "neq": "equality"}
# What counts parts of actuators, as the number of each in the model.
PARTS = {"nu": "actuator_ctrlnum", "nout": "actuator_outnum"}
VECTOR, QUATERNION = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
TWIST, WRENCH = ("wx", "wy", "wz", "vx", "vy", "vz"), ("tx", "ty", "tz", "fx", "fy", "fz")
MATRIX = tuple(f"{row}{column}" for row in "xyz" for column in "xyz")
COMPONENTS = {3: VECTOR, 4: QUATERNION, 6: TWIST, 9: MATRIX}
WRENCHES = ("cfrc_int", "cfrc_ext")

LENGTHS = ("xpos", "xipos", "xanchor", "geom_xpos", "site_xpos", "cam_xpos", "light_xpos", "subtree_com", "ten_length")
UNITS = dict.fromkeys(LENGTHS, "m") | {
    "mocap_pos": "m",
    "ten_velocity": "m/s",
    "actuator_force": "N",
    "energy": "J",
    "subtree_linvel": "m/s",
    "subtree_angmom": "kg·m²/s",
    "xfrc_applied": "N",
}
# Generalized quantities: units for a translation and for a rotation.
DOF_UNITS = {"qvel": ("m/s", "rad/s"), "qacc": ("m/s²", "rad/s²"), "qacc_warmstart": ("m/s²", "rad/s²")}
FORCE_UNITS = ("N", "N·m")
TWIST_UNITS = {"cvel": ("rad/s", "m/s"), "cacc": ("rad/s²", "m/s²"), "cfrc_int": ("N·m", "N"), "cfrc_ext": ("N·m", "N")}

Record = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Probe:
    """Something to measure: columns, and how to compute them.

    Attributes:
      columns: in order.
      fields: the MjData fields it reads; all of them must belong to one instant.
      compute: from `{field: (n, …)}` of n instants to `(n, len(columns))`.
      at: for what no field holds: from one consistent MjData to `(len(columns),)`; `compute` is not used.
    """

    columns: Sequence[Column]
    fields: Sequence[str]
    compute: Callable[[Record], np.ndarray]
    at: Callable[[mujoco.MjModel, mujoco.MjData], np.ndarray] | None = None

    def only(self, kept: Sequence[int]) -> "Probe":
        """The probe with only these of its columns."""
        index, compute, at = np.array(kept, int), self.compute, self.at
        return Probe(
            [self.columns[i] for i in kept],
            self.fields,
            lambda record: compute(record)[:, index],
            None if at is None else lambda model, data: at(model, data)[index],
        )


def instant_only(record: Record) -> np.ndarray:
    """The `compute` of a probe that has `at`."""
    raise TypeError("this probe is read at an instant")


@cache
def extents() -> dict[str, tuple[tuple[str | int, ...], str]]:
    """Every array field of MjData that can be recorded, with its extents and its meaning."""
    described: Any = structs.STRUCTS["mjData"].fields
    arrays = [field for field in described if getattr(field, "array_extent", None)]
    return {field.name: (tuple(field.array_extent), field.doc) for field in arrays if field.name in DATA_FIELDS}


def offered(model: mujoco.MjModel) -> list[str]:
    """The fields that have columns in `model`."""
    return [name for name in extents() if np.prod(_shape(model, name))]


def field_probe(model: mujoco.MjModel, field: str, group: str = "") -> Probe:
    """The probe of a field; its columns are called `group/…`, or by the field's own name."""
    columns = tuple(_columns(model, field, group or field))

    def compute(record: Record) -> np.ndarray:
        values = record[field]
        return values.reshape(len(values), -1).astype(float, copy=False)

    return Probe(columns, (field,), compute)


def _shape(model: mujoco.MjModel, field: str) -> tuple[int, ...]:
    return tuple(size if isinstance(size, int) else getattr(model, size) for size in extents()[field][0])


def _columns(model: mujoco.MjModel, field: str, group: str) -> Iterator[Column]:
    extent, meaning = extents()[field]
    first = extent[0]
    if field == "qpos":
        yield from _of_joints(model, group, meaning, QPOS_PARTS, field)
    elif first == "nv":
        yield from _of_joints(model, group, meaning, QVEL_PARTS, field, COMPONENTS[6] if len(extent) > 1 else ("",))
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
    width = int(np.prod(shape[1:]))
    parts = WRENCH if field in WRENCHES else COMPONENTS.get(width, tuple(map(str, range(width))))
    for name, index in objects:
        for i, part in enumerate(("",) if len(shape) == 1 else parts):
            unit = TWIST_UNITS[field][i > 2] if field in TWIST_UNITS else UNITS.get(field, "")
            yield Column(f"{group}/{name}" + (f"/{part}" if part else ""), unit, meaning, kind, index)


def _objects(model: mujoco.MjModel, counted: str, count: int) -> tuple[str, list[tuple[str, int]]]:
    """Kind, names and ids of what the first dimension of a field counts."""
    if counted in PARTS:
        return "actuator", actuator_parts(model, getattr(model, PARTS[counted]))
    kind = KINDS.get(counted, "")
    if not kind:
        return "", [(str(i), -1) for i in range(count)]
    return kind, [(name, i) for i, name in enumerate(names(model, kind))]
