"""Tables of bodies, joints, geoms, sites and keyframes, of a model whose numbers are known."""

from collections.abc import Sequence

import mujoco
import pytest

from mjrun.cli.info_kinematics import bodies, geoms, joints, keyframes, sites
from mjrun.cli.table_cells import Column
from mjrun.model.description.model_description import ModelDescription

MODEL = """
<mujoco>
  <worldbody>
    <body name="a">
      <joint name="turn" range="-90 45" limited="true" damping="2"/><joint name="push" type="slide" damping="3"/>
      <geom name="ball" size=".1" mass="2" condim="4"/><geom type="box" size=".1 .2 .3" mass="1"/>
      <site name="tip" pos="0 0 1"/>
      <body name="b"><joint name="root" type="ball"/><geom name="pin" size=".1" mass=".5"/></body>
    </body>
    <body name="c" mocap="true"/>
  </worldbody>
  <keyframe><key name="home" qpos="0 0 1 0 0 0"/><key name="far" qpos="2 0 1 0 0 0"/></keyframe>
</mujoco>
"""


def cells(columns: Sequence[Column]) -> dict[str, list[str]]:
    return {column.heading: list(column.cells) for column in columns}


@pytest.fixture(scope="module")
def model() -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(MODEL))


def test_bodies_are_a_tree_with_their_joints_masses_and_geoms(model: ModelDescription) -> None:
    table = cells(bodies(model.bodies))
    assert table["body"] == ["world", "├─ a", "│  └─ b", "└─ c"]
    assert table["joints"] == ["", "turn (hinge), push (slide)", "root (ball)", ""]
    assert (table["mass"], table["subtree"]) == (["0", "3", "0.5", "0"], ["3.5", "3.5", "0.5", "0"])
    assert table["geoms"] == ["", "sphere, box", "sphere", ""]


def test_joints_have_their_place_in_qpos_and_qvel_and_each_range_its_unit(model: ModelDescription) -> None:
    columns = joints(model.joints)
    table = cells(columns)
    assert (table["name"], table["type"]) == (["turn", "push", "root"], ["hinge", "slide", "ball"])
    assert (table["qpos"], table["qvel"]) == (["0", "1", "2:6"], ["0", "1", "2:5"])
    assert table["range"] == ["-1.5708..0.7854", "", ""]
    damping = next(column for column in columns if column.heading == "damping")
    assert (list(damping.cells), damping.unit) == (["2", "3", "0"], "N·m·s/rad\nN·s/m")


def test_geoms_and_sites_say_where_and_how_large_they_are(model: ModelDescription) -> None:
    table = cells(geoms(model.geoms))
    assert table["name"] == ["ball", "geom:1", "pin"]
    assert table["size"][1] == "0.1 0.2 0.3"
    assert table["condim"] == ["4", "3", "3"]
    assert table["contact bits"] == []
    assert cells(sites(model.sites))["position"] == ["0 0 1"]


def test_keyframes_name_the_joints_that_are_outside_their_range(model: ModelDescription) -> None:
    assert cells(keyframes(model.keyframes))["outside its range"] == ["", "qpos/turn"]
