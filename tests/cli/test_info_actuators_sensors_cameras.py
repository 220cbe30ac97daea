"""Theorems about the tables of actuators, sensors, cameras and lights of `mjrun info`."""

from collections.abc import Sequence

import mujoco
import pytest

from mjrun.cli.info_actuators_sensors_cameras import actuators, cameras, lights, sensors
from mjrun.cli.table_cells import Column
from mjrun.model.description.model_description import ModelDescription

TEXT = """
<mujoco>
  <worldbody>
    <light name="lamp" pos="0 0 3" castshadow="false"/>
    <camera name="side" pos="0 -2 1" mode="targetbody" target="arm" fovy="30"/>
    <body name="arm"><joint name="hinge"/><geom size=".1"/><site name="tip"/></body>
  </worldbody>
  <actuator>
    <motor name="push" joint="hinge" ctrlrange="-3 3" gear="2"/>
    <position name="hold" joint="hinge" kp="10" kv="1" forcerange="-5 5"/>
  </actuator>
  <sensor>
    <jointpos name="angle" joint="hinge"/><accelerometer name="imu" site="tip" noise=".1"/>
    <framepos name="where" objtype="site" objname="tip" reftype="body" refname="arm"/>
  </sensor>
</mujoco>
"""


@pytest.fixture(scope="module")
def description() -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(TEXT))


def cells(columns: Sequence[Column]) -> dict[str, Sequence[str]]:
    """The cells of each column by its heading."""
    return {column.heading: column.cells for column in columns}


def test_actuators_have_their_targets_ranges_and_laws(description: ModelDescription) -> None:
    table = cells(actuators(description.actuators))
    assert table["kind"] == ["motor", "position"]
    assert table["acts on joint"] == ["hinge", "hinge"]
    assert table["ctrl"] == ["0", "1"]
    assert table["ctrl range"] == ["-3..3", ""]
    assert table["gear"] == ["2", "1"]
    assert table["force range"] == ["", "-5..5"]
    assert (table["gain"], table["bias"]) == (["", "10"], ["", "0 -10 -1"])


def test_the_kind_of_target_stands_with_each_where_it_differs() -> None:
    text = TEXT.replace("</actuator>", '<adhesion name="stick" body="arm" ctrlrange="0 1"/></actuator>')
    table = cells(actuators(ModelDescription(mujoco.MjModel.from_xml_string(text)).actuators))
    assert table["acts on"] == ["joint/hinge", "joint/hinge", "body/arm"]


def test_sensors_have_their_objects_addresses_and_units(description: ModelDescription) -> None:
    model, table = mujoco.MjModel.from_xml_string(TEXT), cells(sensors(description.sensors))
    assert table["of"] == ["joint/hinge", "site/tip", "site/tip"]
    assert table["relative to"] == ["", "", "body/arm"]
    assert [cell.partition(":")[0] for cell in table["sensordata"]] == [str(start) for start in model.sensor_adr]
    assert table["unit"] == ["rad", "m/s²", "m"]
    assert table["noise"] == ["0", "0.1", "0"]


def test_cameras_and_lights_have_their_modes(description: ModelDescription) -> None:
    seeing, lit = cells(cameras(description.cameras)), cells(lights(description.lights))
    assert (seeing["mode"], seeing["fovy"]) == (["targetbody arm"], ["30"])
    assert (lit["name"], lit["shadow"]) == (["lamp"], ["no"])


def test_a_model_without_any_has_empty_tables() -> None:
    empty = ModelDescription(mujoco.MjModel.from_xml_string("<mujoco/>"))
    columns = [*actuators(empty.actuators), *sensors(empty.sensors), *cameras(empty.cameras), *lights(empty.lights)]
    assert not any(column.cells for column in columns)
