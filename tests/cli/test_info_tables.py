"""Theorems about the tables of `mjrun info`: what MuJoCo's arrays hold, in columns of text."""

from collections.abc import Sequence

import mujoco
import pytest

from mjrun.cli.info_formatting import Column
from mjrun.cli.info_tables import TABLES
from mjrun.model.description.model_description import SECTIONS, ModelDescription

TEXT = """
<mujoco>
  <option timestep=".005"/>
  <worldbody>
    <body name="arm">
      <joint name="hinge" range="-90 90" damping=".5"/><joint name="slide" type="slide" range="0 2"/>
      <geom name="ball" size=".1" mass="2"/><geom name="box" type="box" size=".1 .2 .3" mass="1" condim="4"/>
      <site name="tip" size=".01"/>
      <body name="hand"><geom size=".1" mass="1"/></body>
    </body>
    <body name="base"/>
  </worldbody>
  <tendon><fixed name="cord"><joint joint="hinge" coef="2"/></fixed></tendon>
  <equality><joint name="gear" joint1="hinge" joint2="slide" active="false"/></equality>
  <contact>
    <pair name="touch" geom1="ball" geom2="box" margin=".01"/><exclude name="apart" body1="arm" body2="hand"/>
  </contact>
  <keyframe><key name="home"/><key name="far" qpos="9 9"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def description() -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(TEXT))


def table(description: ModelDescription, section: str) -> dict[str, Sequence[str]]:
    """The cells of each column by its heading."""
    columns: list[Column] = TABLES[section](getattr(description, section))
    return {column.heading: column.cells for column in columns}


@pytest.mark.parametrize("section", TABLES)
def test_every_column_has_a_cell_for_every_row_or_none(description: ModelDescription, section: str) -> None:
    rows = len(getattr(description, section))
    assert {len(cells) for cells in table(description, section).values()} <= {rows, 0}


def test_every_section_that_is_a_list_has_a_table() -> None:
    assert set(SECTIONS) - set(TABLES) == {"summary", "statistics"}


def test_bodies_are_a_tree_with_joints_and_masses(description: ModelDescription) -> None:
    bodies = table(description, "bodies")
    assert bodies["body"] == ["world", "├─ arm", "│  └─ hand", "└─ base"]
    assert bodies["joints"] == ["", "hinge (hinge), slide (slide)", "", ""]
    assert bodies["mass"] == ["0", "3", "1", "0"]
    assert bodies["subtree"] == ["4", "4", "1", "0"]
    assert bodies["geoms"] == ["", "sphere, box", "sphere", ""]


def test_joints_have_their_ranges_addresses_and_units(description: ModelDescription) -> None:
    joints = table(description, "joints")
    assert joints["range"] == ["-1.5708..1.5708", "0..2"]
    assert (joints["qpos"], joints["qvel"]) == (["0", "1"], ["0", "1"])
    columns = {column.heading: column.unit for column in TABLES["joints"](description.joints)}
    assert (columns["range"], columns["damping"]) == ("rad\nm", "N·m·s/rad")


def test_geoms_show_what_differs_from_the_usual(description: ModelDescription) -> None:
    geoms = table(description, "geoms")
    assert geoms["size"] == ["0.1", "0.1 0.2 0.3", "0.1"]
    assert geoms["condim"] == ["3", "4", "3"]
    assert geoms["contact bits"] == []


def test_constraints_name_their_objects(description: ModelDescription) -> None:
    assert table(description, "tendons")["path"] == ["2 hinge"]
    equalities = table(description, "equalities")
    assert (equalities["of"], equalities["and"], equalities[""]) == (["joint/hinge"], ["joint/slide"], ["off"])
    assert (table(description, "pairs")["geom 1"], table(description, "pairs")["margin"]) == (["ball"], ["0.01"])
    assert table(description, "excludes")["body 2"] == ["hand"]


def test_keyframes_name_the_joints_that_are_outside_their_ranges(description: ModelDescription) -> None:
    assert table(description, "keyframes")["outside its range"] == ["", "qpos/hinge, qpos/slide"]


def test_options_are_those_that_differ_from_mujocos_defaults(description: ModelDescription) -> None:
    options = table(description, "options")
    assert dict(zip(options["setting"], options["value"], strict=True))["opt.timestep"] == "0.005"
    assert options["default"][options["setting"].index("opt.timestep")] == "0.002"
