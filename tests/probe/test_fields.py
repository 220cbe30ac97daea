"""Columns of MjData's fields: every number has the right name, unit and object."""

import copy

import mujoco
import numpy as np
import pytest

from mjrun.model import state
from mjrun.model.units import actuator_force_unit, actuator_unit, rate_unit, tendon_unit
from mjrun.probe.derived import DERIVED
from mjrun.probe.fields import LAZY, MjDataProbe, Probe, extents, field_probe, offered, state_columns
from mjrun.probe.select import available_columns
from tests.cases import cases, mjcf
from tests.model.test_state import CROWDED

MODEL = mujoco.MjModel.from_xml_string(mjcf("every_joint"))


def moved(steps: int = 50) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qvel[:] = np.arange(1, MODEL.nv + 1) / 7
    data.ctrl[:] = [0.5, 2]
    mujoco.mj_step(MODEL, data, nstep=steps)
    mujoco.mj_forward(MODEL, data)
    return data


def everything(data: mujoco.MjData) -> dict[str, bytes | int | float]:
    """Every array of an MjData and of its contacts, as bytes, and every number."""
    values = {name: getattr(data, name) for name in dir(data) if not name.startswith("_")}
    values |= {f"contact.{name}": getattr(data.contact, name) for name in dir(data.contact) if not name.startswith("_")}
    arrays = {name: value.tobytes() for name, value in values.items() if isinstance(value, np.ndarray)}
    return arrays | {name: value for name, value in values.items() if isinstance(value, int | float)}


def measured(field: str, data: mujoco.MjData, group: str = "") -> dict[str, float]:
    """The columns of a field by name."""
    probe = field_probe(MODEL, field, group)
    return dict(zip([column.name for column in probe.columns], row(probe, data), strict=True))


def row(probe: Probe, data: mujoco.MjData) -> np.ndarray:
    """The values of a probe at an instant."""
    return row_of(MODEL, probe, data)


def row_of(model: mujoco.MjModel, probe: Probe, data: mujoco.MjData) -> np.ndarray:
    if isinstance(probe, MjDataProbe):
        return probe.measure(model, data)
    return probe.compute({name: np.array(getattr(data, name)) for name in probe.fields}, {})


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
    mujoco.mj_rnePostConstraint(MODEL, data)
    mujoco.mj_subtreeVel(MODEL, data)
    mujoco.mj_inverse(MODEL, data)
    probe = field_probe(MODEL, field)
    values = np.array(getattr(data, field))
    assert len(probe.columns) == values.size
    assert len({column.name for column in probe.columns}) == values.size
    if values.size:
        assert np.array_equal(row(probe, data), values.ravel(), equal_nan=True)


@cases("field, name, unit")
def test_a_column_has_its_unit(field: str, name: str, unit: str) -> None:
    assert {column.name: column.unit for column in field_probe(MODEL, field).columns}[name] == unit


def test_what_is_applied_to_a_body_is_called_what_it_does_to_it() -> None:
    data = moved()
    body = MODEL.body("cart").id
    data.xfrc_applied[body] = [2, 0, 0, 0, 7, 0]
    found = measured("xfrc_applied", data)
    assert {name: value for name, value in found.items() if value} == {
        "xfrc_applied/cart/fx": 2,
        "xfrc_applied/cart/ty": 7,
    }
    pushed = np.zeros(MODEL.nv)
    force, torque = ([found[f"xfrc_applied/cart/{part}{axis}"] for axis in "xyz"] for part in "ft")
    mujoco.mj_applyFT(MODEL, data, np.array(force), np.array(torque), data.xipos[body], body, pushed)
    assert pushed[MODEL.joint("rail").dofadr[0]] == 2


def test_spatial_forces_and_motions_are_called_by_what_they_are() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="b"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[:] = [1, 2, 3, 4, 5, 6]
    data.xfrc_applied[1] = [10, 20, 30, 1, 2, 3]
    mujoco.mj_forward(model, data)
    found = {}
    for field in ("cvel", "cfrc_ext"):
        probe = field_probe(model, field)
        names = [column.name for column in probe.columns]
        found |= dict(zip(names, row_of(model, probe, data), strict=True))
    assert [found[f"cvel/b/v{axis}"] for axis in "xyz"] == pytest.approx([1, 2, 3])
    assert [found[f"cvel/b/w{axis}"] for axis in "xyz"] == pytest.approx([4, 5, 6])
    assert [found[f"cfrc_ext/b/f{axis}"] for axis in "xyz"] == pytest.approx([10, 20, 30])
    assert [found[f"cfrc_ext/b/t{axis}"] for axis in "xyz"] == pytest.approx([1, 2, 3])


@pytest.mark.parametrize("field", sorted(LAZY))
def test_a_field_that_a_step_leaves_out_is_computed_and_the_instant_is_left_alone(field: str) -> None:
    data = moved()
    before = everything(data)
    assert data.efc_force.any()
    left_out = np.array(getattr(data, field))
    found = np.array(list(measured(field, data).values()))
    assert everything(data) == before
    assert found.any()
    assert not left_out.any()


def test_a_field_that_is_offered_belongs_to_the_instant_and_not_to_the_step_before() -> None:
    for integrator in (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICIT):
        model = copy.copy(MODEL)
        model.opt.integrator = int(integrator)
        model.dof_damping[:] = 0.1
        stepped, fresh = mujoco.MjData(model), mujoco.MjData(model)
        stepped.ctrl[:] = [0.5, 2]
        mujoco.mj_step(model, stepped, nstep=50)
        state.restore(model, fresh, state.save(model, stepped))
        for data in (stepped, fresh):
            mujoco.mj_forward(model, data)
        for field in extents():
            assert np.array_equal(getattr(stepped, field), getattr(fresh, field), equal_nan=True), field
        assert any(not np.array_equal(getattr(stepped, name), getattr(fresh, name)) for name in ("qH", "qLU"))


def test_a_column_knows_its_object() -> None:
    by_name = {column.name: column for column in available_columns(MODEL)}
    assert (by_name["qpos/turn"].kind, by_name["qpos/turn"].id) == ("joint", MODEL.joint("turn").id)
    assert (by_name["xpos/cart/x"].kind, by_name["xpos/cart/x"].id) == ("body", MODEL.body("cart").id)
    assert (by_name["sensor/angle"].kind, by_name["sensor/angle"].id) == ("sensor", 1)
    assert by_name["xpos/cart/x"].meaning == "Cartesian position of body frame"


def test_the_catalogue_names_every_column_once_and_every_field_of_the_model() -> None:
    found = [column.name for column in available_columns(MODEL)]
    assert len(found) == len(set(found))
    groups = {name.split("/")[0] for name in found}
    assert set(offered(MODEL)) - {"sensordata"} <= groups
    assert {"energy", "contact", "sensor", "speed", "momentum", "com", "contact_force", "penetration"} <= groups


def test_a_probe_may_be_cut_to_some_of_its_columns() -> None:
    data = moved()
    probe = field_probe(MODEL, "xpos").only([4, 0])
    assert [column.name for column in probe.columns] == ["xpos/free/y", "xpos/world/x"]
    assert row(probe, data).tolist() == [data.xpos[1, 1], 0]
    lone = MjDataProbe(probe.columns, lambda model, data: lambda: np.array([1.0, 2.0])).only([1])
    assert row(lone, data).tolist() == [2.0]


def test_vertices_and_edges_of_flexes_have_units() -> None:
    flex = '<flexcomp name="cloth" type="grid" count="2 2 1" spacing=".1 .1 .1" dim="2"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{flex}</worldbody></mujoco>")
    units = {name: field_probe(model, name).columns[0].unit for name in offered(model) if name.startswith("flex")}
    assert {name: unit for name, unit in units.items() if unit} == {
        "flexvert_xpos": "m",
        "flexedge_length": "m",
        "flexedge_velocity": "m/s",
    }


def test_the_unit_of_a_tendon_or_an_actuator_is_that_of_what_it_moves() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf("units"))
    units = {name: [column.unit for column in field_probe(model, name).columns] for name in offered(model)}
    tendons = [tendon_unit(model, index) for index in range(model.ntendon)]
    actuators = [actuator_unit(model, index) for index in range(model.nu)]
    assert (units["ten_length"], units["ten_velocity"]) == (tendons, [rate_unit(unit) for unit in tendons])
    assert units["actuator_length"] == actuators
    assert units["actuator_velocity"] == [rate_unit(unit) for unit in actuators]
    assert units["actuator_force"] == [actuator_force_unit(model, index) for index in range(model.nu)]


def test_blocks_of_simulations_are_measured_as_each_instant_alone() -> None:
    instants = np.array([[moved(steps) for steps in row] for row in ((0, 5, 11), (7, 2, 50))])
    probes = [field_probe(MODEL, name) for name in offered(MODEL)] + [make(MODEL) for make in DERIVED.values()]
    compared = 0
    for probe in probes:
        if isinstance(probe, MjDataProbe):
            continue
        fields = {name: np.array([[getattr(data, name) for data in row] for row in instants]) for name in probe.fields}
        values = probe.compute(fields, {name: part[:, :1] for name, part in fields.items()})
        assert values.shape == (2, 3, len(probe.columns))
        for n, row_index in np.ndindex(2, 3):
            alone = probe.compute(
                {name: part[n, row_index] for name, part in fields.items()},
                {name: part[n, 0] for name, part in fields.items()},
            )
            assert values[n, row_index].tobytes() == alone.tobytes()
            compared += 1
    assert compared > 300


EXPECTED = {
    "time": ("time", 0),
    "qpos/root/z": ("qpos", 2),
    "qpos/swivel/qw": ("qpos", 7),
    "qpos/knee": ("qpos", 11),
    "qvel/swivel/wz": ("qvel", 8),
    "act/filter": ("act", 0),
    "ctrl/late": ("ctrl", 1),
    "xfrc_applied/box/fz": ("xfrc_applied", 14),
    "xfrc_applied/box/tx": ("xfrc_applied", 15),
    "mocap_pos/0/z": ("mocap_pos", 2),
    "userdata/2": ("userdata", 2),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_name_stands_where_its_number_is(name: str) -> None:
    model = mujoco.MjModel.from_xml_string(CROWDED)
    names = state_columns(model)
    assert len(names) == len(set(names)) == state.size(model)

    data = mujoco.MjData(model)
    numbers = state.save(model, data)
    numbers[names.index(name)] = 7.25
    state.restore(model, data, numbers)
    field, index = EXPECTED[name]
    assert np.ravel(getattr(data, field))[index] == 7.25
