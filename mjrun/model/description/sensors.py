"""Sensors: what they measure, of what, and where their values are."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco

from mjrun.model.description.plain_values import enum_name, object_name
from mjrun.model.description.units import sensor_unit


@dataclass(frozen=True)
class Sensor:
    """A sensor.

    Attributes:
      id, name: of the sensor.
      type: MuJoCo's word, `framepos`, `touch` …
      object_kind, object: what it measures; None of the whole model. The kind `xbody` is a body by its frame,
        `body` by the frame of its inertia.
      reference_kind, reference: what it measures relative to, or the other object; None for the world.
      dim, address: its values are `sensordata[address : address + dim]`.
      unit: of its values; empty for pure numbers, and where it reports several things.
      data_type: `real`, `positive`, `axis` or `quaternion`.
      needs: the state it is computed from: `pos`, `vel` or `acc`.
      cutoff: beyond which its values are cut [unit]; None without one.
      noise: standard deviation that the model tells of [unit]; MuJoCo adds none.
      delay, period: of its values [s]; 0 for none.
      plugin: the plugin instance that computes it; None without one.
    """

    id: int
    name: str
    type: str
    object_kind: str | None
    object: str | None
    reference_kind: str | None
    reference: str | None
    dim: int
    address: int
    unit: str
    data_type: str
    needs: str
    cutoff: float | None
    noise: float
    delay: float
    period: float
    plugin: str | None


def sensors(model: mujoco.MjModel) -> Iterator[Sensor]:
    """Every sensor, in order of id."""
    for i in range(model.nsensor):
        object_kind, name = _object(model, model.sensor_objtype[i], model.sensor_objid[i])
        reference_kind, reference = _object(model, model.sensor_reftype[i], model.sensor_refid[i])
        yield Sensor(
            id=i,
            name=object_name(model, mujoco.mjtObj.mjOBJ_SENSOR, i) or "",
            type=enum_name(mujoco.mjtSensor, model.sensor_type[i]),
            object_kind=object_kind,
            object=name,
            reference_kind=reference_kind,
            reference=reference,
            dim=int(model.sensor_dim[i]),
            address=int(model.sensor_adr[i]),
            unit=sensor_unit(model, i),
            data_type=enum_name(mujoco.mjtDataType, model.sensor_datatype[i]),
            needs=enum_name(mujoco.mjtStage, model.sensor_needstage[i]),
            cutoff=float(model.sensor_cutoff[i]) or None,
            noise=float(model.sensor_noise[i]),
            delay=float(model.sensor_delay[i]),
            period=float(model.sensor_interval[i, 0]),
            plugin=object_name(model, mujoco.mjtObj.mjOBJ_PLUGIN, model.sensor_plugin[i]),
        )


def _object(model: mujoco.MjModel, kind: int, index: int) -> tuple[str | None, str | None]:
    if index < 0 or int(kind) == int(mujoco.mjtObj.mjOBJ_UNKNOWN):
        return None, None
    return enum_name(mujoco.mjtObj, kind), object_name(model, kind, index)
