"""Actuators of several inputs: names of controls are those of MuJoCo's own addresses, everywhere."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import BadValueError, UnknownNameError
from mjrun.formats.table_reader import read_table
from mjrun.model.names import control_names, control_slices
from mjrun.outputs.trace import Trace
from mjrun.probe.fields import field_probe
from mjrun.simulation.simulation import Simulation
from tests.check.models import lint_file

TEXT = """
<mujoco>
  <worldbody>
    <body name="a"><joint name="ball" type="ball" range="0 1"/><geom size=".1"/></body>
    <body name="b" pos="1 0 0"><joint name="hinge"/><geom size=".1"/></body>
  </worldbody>
  <actuator>
    <orientation name="turn" joint="ball"/><motor name="push" joint="hinge" ctrlrange="-3 3"/>
  </actuator>
  <keyframe><key name="far" ctrl="0 0 0 9"/></keyframe>
</mujoco>
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "turn.xml"
    found.write_text(TEXT)
    return found


def test_every_control_has_the_name_of_the_actuator_at_its_address(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.nu > model.nactuator
    names = control_names(model)
    assert len(names) == model.nu
    for actuator, name in enumerate(("turn", "push")):
        (part,) = control_slices(model, name)
        address = model.actuator_ctrladr[actuator]
        assert (part.start, part.stop) == (address, address + model.actuator_ctrlnum[actuator])
        assert {found.partition("/")[0] for found in names[part]} == {name}
    assert control_slices(model, "turn/1") == [slice(1, 2)]
    with pytest.raises(UnknownNameError, match="no actuator 'turn/3'"):
        control_slices(model, "turn/3")


def test_controls_by_name_drive_what_they_name(path: Path, tmp_path: Path) -> None:
    simulation = Simulation(path, steps=5, ctrl={"push": 2.0, "turn/2": 0.5})
    data = simulation.start.data(simulation.load())
    assert list(data.ctrl) == [0, 0, 0.5, 2]
    Trace(simulation, f"{tmp_path}/a.csv", probe=["ctrl", "qpos", "actuator_force"]).run()
    table = read_table(tmp_path / "a.csv", lambda name: True)
    model = mujoco.MjModel.from_xml_path(str(path))
    bare = mujoco.MjData(model)
    bare.ctrl[model.actuator("push").id + 2] = 2
    bare.ctrl[2] = 0.5
    mujoco.mj_step(model, bare, nstep=5)
    assert table["qpos/hinge"][-1] == bare.qpos[-1]
    assert (table["ctrl/push"] == 2).all()
    mujoco.mj_forward(model, bare)
    assert table["actuator_force/push"][-1] == bare.actuator_force[model.actuator_outadr[1]]
    again = Simulation(path, steps=5, ctrl_from=tmp_path / "a.csv")
    Trace(again, f"{tmp_path}/b.csv", probe=["ctrl", "qpos", "actuator_force"]).run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_an_actuator_of_three_inputs_takes_three_numbers(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    assert list(Simulation(path, ctrl={"turn": (1, 2, 3)}).start.data(model).ctrl[:3]) == [1, 2, 3]
    with pytest.raises(BadValueError, match="3 numbers"):
        Simulation(path, ctrl={"turn": 1}).start.data(model)


def test_columns_of_outputs_belong_to_their_actuators(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    columns = field_probe(model, "actuator_force").columns
    owners = np.repeat(np.arange(model.nactuator), model.actuator_outnum)
    assert [column.id for column in columns] == owners.tolist()
    assert {column.kind for column in columns} == {"actuator"}


def test_a_keyframe_beyond_the_range_of_a_control_names_its_actuator(path: Path) -> None:
    found = lint_file(path)
    assert "MJ005" not in {one.code for one in found}
    (beyond,) = [one for one in found if one.code == "MJ403"]
    assert "actuator 'push'" in beyond.message
