"""Theorems about the tables of actuators, sensors, cameras, lights and plugins of `mjrun info`."""

from collections.abc import Sequence

import mujoco
import pytest

from mjrun.cli.info_actuators_sensors_cameras import DEVICES
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


def table(description: ModelDescription, section: str) -> dict[str, Sequence[str]]:
    """The cells of each column by its heading."""
    return {column.heading: column.cells for column in DEVICES[section](getattr(description, section))}


def test_actuators_have_their_targets_ranges_and_laws(description: ModelDescription) -> None:
    actuators = table(description, "actuators")
    assert actuators["kind"] == ["motor", "position"]
    assert actuators["acts on joint"] == ["hinge", "hinge"]
    assert actuators["ctrl"] == ["0", "1"]
    assert actuators["ctrl range"] == ["-3..3", ""]
    assert actuators["gear"] == ["2", "1"]
    assert actuators["force range"] == ["", "-5..5"]
    assert (actuators["gain"], actuators["bias"]) == (["", "10"], ["", "0 -10 -1"])


def test_the_kind_of_target_stands_with_each_where_it_differs() -> None:
    text = TEXT.replace("</actuator>", '<adhesion name="stick" body="arm" ctrlrange="0 1"/></actuator>')
    actuators = table(ModelDescription(mujoco.MjModel.from_xml_string(text)), "actuators")
    assert actuators["acts on"] == ["joint/hinge", "joint/hinge", "body/arm"]


def test_sensors_have_their_objects_addresses_and_units(description: ModelDescription) -> None:
    model, sensors = mujoco.MjModel.from_xml_string(TEXT), table(description, "sensors")
    assert sensors["of"] == ["joint/hinge", "site/tip", "site/tip"]
    assert sensors["relative to"] == ["", "", "body/arm"]
    assert [cell.partition(":")[0] for cell in sensors["sensordata"]] == [str(start) for start in model.sensor_adr]
    assert sensors["unit"] == ["rad", "m/s²", "m"]
    assert sensors["noise"] == ["0", "0.1", "0"]


def test_cameras_and_lights_have_their_modes(description: ModelDescription) -> None:
    cameras, lights = table(description, "cameras"), table(description, "lights")
    assert (cameras["mode"], cameras["fovy"]) == (["targetbody arm"], ["30"])
    assert (lights["name"], lights["shadow"]) == (["lamp"], ["no"])


def test_a_model_without_any_has_empty_tables() -> None:
    empty = ModelDescription(mujoco.MjModel.from_xml_string("<mujoco/>"))
    assert all(not any(column.cells) for section in DEVICES for column in DEVICES[section](getattr(empty, section)))
