"""Columns of MjData's fields: every number has the right name, unit and object."""

import mujoco
import numpy as np
import pytest

from mjrun.probe.fields import Probe, extents, field_probe, offered
from mjrun.probe.select import catalogue

MODEL = mujoco.MjModel.from_xml_string(
    """
    <mujoco>
      <worldbody>
        <body name="free"><freejoint name="root"/><geom name="ball" size=".1"/><site name="tip" pos="0 0 .1"/>
          <body name="arm"><joint name="turn" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
            <body><joint type="ball"/><geom size=".1" pos=".1 0 0"/></body>
          </body>
        </body>
        <body name="cart"><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1"/></body>
      </worldbody>
      <tendon><fixed name="rope"><joint joint="turn" coef="1"/></fixed></tendon>
      <actuator><motor name="motor" joint="turn"/><general joint="rail" dyntype="filter" dynprm="1"/></actuator>
      <sensor>
        <gyro name="gyro" site="tip"/><jointpos name="angle" joint="turn"/><framequat objtype="body" objname="arm"/>
      </sensor>
    </mujoco>
    """
)


def moved() -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qvel[:] = np.arange(1, MODEL.nv + 1) / 7
    data.ctrl[:] = [0.5, 2]
    mujoco.mj_step(MODEL, data, nstep=50)
    mujoco.mj_forward(MODEL, data)
    return data


def measured(field: str, data: mujoco.MjData, group: str = "") -> dict[str, float]:
    """The columns of a field by name."""
    probe = field_probe(MODEL, field, group)
    row = probe.compute({field: np.array(getattr(data, field))[None]})[0]
    return dict(zip([column.name for column in probe.columns], row, strict=True))


def test_positions_and_velocities_are_those_of_the_named_joint() -> None:
    data = moved()
    qpos, qvel = measured("qpos", data), measured("qvel", data)
    assert qpos["qpos/turn"] == data.joint("turn").qpos[0]
    assert qpos["qpos/rail"] == data.joint("rail").qpos[0]
    assert [qpos[f"qpos/root/{c}"] for c in ("x", "y", "z", "qw", "qx", "qy", "qz")] == list(data.joint("root").qpos)
    assert [qpos[f"qpos/joint:2/{c}"] for c in ("qw", "qx", "qy", "qz")] == list(data.joint(2).qpos)
    assert [qvel[f"qvel/root/{c}"] for c in ("vx", "vy", "vz", "wx", "wy", "wz")] == list(data.joint("root").qvel)
    assert [qvel[f"qvel/joint:2/{c}"] for c in ("wx", "wy", "wz")] == list(data.joint(2).qvel)


def test_objects_sensors_and_actuators_are_called_by_name() -> None:
    data = moved()
    assert [measured("xpos", data)[f"xpos/arm/{c}"] for c in "xyz"] == list(data.body("arm").xpos)
    assert [measured("geom_xpos", data)[f"geom_xpos/ball/{c}"] for c in "xyz"] == list(data.geom("ball").xpos)
    sensors = measured("sensordata", data, "sensor")
    assert [sensors[f"sensor/gyro/{c}"] for c in "xyz"] == list(data.sensor("gyro").data)
    assert sensors["sensor/angle"] == data.sensor("angle").data[0]
    assert [sensors[f"sensor/sensor:2/{c}"] for c in ("qw", "qx", "qy", "qz")] == list(data.sensor(2).data)
    assert measured("ctrl", data) == {"ctrl/motor": 0.5, "ctrl/actuator:1": 2}
    assert measured("act", data) == {"act/actuator:1": data.act[0]}
    assert measured("ten_length", data) == {"ten_length/rope": data.tendon("rope").length[0]}
    assert measured("actuator_force", data)["actuator_force/motor"] == data.actuator("motor").force[0]


@pytest.mark.parametrize("field", sorted(extents()))
def test_a_field_has_as_many_columns_as_numbers(field: str) -> None:
    data = moved()
    probe = field_probe(MODEL, field)
    values = np.array(getattr(data, field))
    assert len(probe.columns) == values.size
    assert len({column.name for column in probe.columns}) == values.size
    if values.size:
        assert np.array_equal(probe.compute({field: values[None]})[0], values.ravel(), equal_nan=True)


@pytest.mark.parametrize(
    ("field", "name", "unit"),
    [
        ("qpos", "qpos/turn", "rad"),
        ("qpos", "qpos/rail", "m"),
        ("qpos", "qpos/root/z", "m"),
        ("qpos", "qpos/root/qw", ""),
        ("qvel", "qvel/turn", "rad/s"),
        ("qvel", "qvel/rail", "m/s"),
        ("qvel", "qvel/root/vz", "m/s"),
        ("qvel", "qvel/root/wz", "rad/s"),
        ("qacc", "qacc/turn", "rad/s²"),
        ("qacc", "qacc/root/vx", "m/s²"),
        ("qfrc_actuator", "qfrc_actuator/turn", "N·m"),
        ("qfrc_actuator", "qfrc_actuator/rail", "N"),
        ("xpos", "xpos/arm/x", "m"),
        ("cvel", "cvel/arm/wx", "rad/s"),
        ("cvel", "cvel/arm/vx", "m/s"),
        ("cfrc_ext", "cfrc_ext/arm/fx", "N"),
        ("cfrc_ext", "cfrc_ext/arm/tx", "N·m"),
        ("sensordata", "sensordata/gyro/x", "rad/s"),
    ],
)
def test_a_column_has_its_unit(field: str, name: str, unit: str) -> None:
    assert {column.name: column.unit for column in field_probe(MODEL, field).columns}[name] == unit


def test_a_column_knows_its_object() -> None:
    by_name = {column.name: column for column in catalogue(MODEL)}
    assert (by_name["qpos/turn"].kind, by_name["qpos/turn"].id) == ("joint", MODEL.joint("turn").id)
    assert (by_name["xpos/cart/x"].kind, by_name["xpos/cart/x"].id) == ("body", MODEL.body("cart").id)
    assert (by_name["sensor/angle"].kind, by_name["sensor/angle"].id) == ("sensor", 1)
    assert by_name["xpos/cart/x"].meaning == "Cartesian position of body frame"


def test_the_catalogue_names_every_column_once_and_every_field_of_the_model() -> None:
    found = [column.name for column in catalogue(MODEL)]
    assert len(found) == len(set(found))
    groups = {name.split("/")[0] for name in found}
    assert set(offered(MODEL)) - {"sensordata"} <= groups
    assert {"energy", "contact", "sensor", "speed", "momentum", "com", "contact_force", "penetration"} <= groups


def test_a_probe_may_be_cut_to_some_of_its_columns() -> None:
    data = moved()
    probe = field_probe(MODEL, "xpos").only([4, 0])
    assert [column.name for column in probe.columns] == ["xpos/free/y", "xpos/world/x"]
    assert list(probe.compute({"xpos": data.xpos[None]})[0]) == [data.xpos[1, 1], 0]
    at = Probe(probe.columns, (), probe.compute, lambda model, data: np.array([1.0, 2.0])).only([1])
    assert at.at
    assert list(at.at(MODEL, data)) == [2.0]
