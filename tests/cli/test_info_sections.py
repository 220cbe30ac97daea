"""The sections of `mjrun info` are those of a description, its help lists them, and tables say what the model does."""

import re
from pathlib import Path

import mujoco
import pytest

from mjrun.cli.commands.info import info
from mjrun.cli.info_sections import SECTIONS, LineSection
from mjrun.cli.table_cells import ReportColumn
from mjrun.cli.task_sections import TABLES
from mjrun.model.info import SECTIONS as DESCRIBED
from mjrun.model.info import ModelDescription
from tests.cases import cases

MODEL = """
<mujoco>
  <option gravity="0 0 -1" integrator="RK4"/>
  <worldbody>
    <light name="lamp" pos="0 0 3" castshadow="false"/>
    <camera name="side" pos="0 -2 1" mode="targetbody" target="a" fovy="30"/>
    <body name="a">
      <joint name="turn" range="-90 45" limited="true" damping="2"/><joint name="push" type="slide" damping="3"/>
      <geom name="ball" size=".1" mass="2" condim="4"/><geom type="box" size=".1 .2 .3" mass="1"/>
      <site name="tip" pos="0 0 1"/>
      <body name="b"><joint name="root" type="ball"/><geom name="pin" size=".1" mass=".5"/></body>
    </body>
    <body name="c" mocap="true"><site name="far" pos="0 0 2"/></body>
  </worldbody>
  <tendon>
    <fixed name="sum" range="0 1" limited="true"><joint joint="turn" coef="1"/></fixed>
    <fixed name="mix"><joint joint="turn" coef="1"/><joint joint="push" coef="-.5"/></fixed>
    <spatial name="rope"><site site="tip"/><site site="far"/></spatial>
  </tendon>
  <equality><joint name="gear" joint1="turn" joint2="push" active="false"/></equality>
  <contact><pair name="touch" geom1="ball" geom2="pin" margin=".2"/><exclude name="none" body1="a" body2="b"/></contact>
  <actuator>
    <motor name="drive" joint="turn" ctrlrange="-3 3" gear="2"/>
    <position name="hold" joint="turn" kp="10" kv="1" forcerange="-5 5"/>
  </actuator>
  <sensor>
    <jointpos name="angle" joint="turn"/><accelerometer name="imu" site="tip" noise=".1"/>
    <framepos name="where" objtype="site" objname="tip" reftype="body" refname="a"/>
  </sensor>
  <keyframe><key name="home" qpos="0 0 1 0 0 0"/><key name="far" qpos="2 0 1 0 0 0"/></keyframe>
</mujoco>
"""


def table(section: str, text: str = MODEL, path: Path | None = None) -> dict[str, ReportColumn]:
    """The columns of a section by their headings."""
    model = mujoco.MjModel.from_xml_string(text) if path is None else mujoco.MjModel.from_xml_path(str(path))
    table_section = SECTIONS[section]
    assert not isinstance(table_section, LineSection)
    rows = ModelDescription(model, path).section(section)
    columns = table_section.columns(rows, model)
    assert all(len(column.cells) in (0, len(rows)) for column in columns)
    return {column.heading: column for column in columns}


def test_every_section_of_a_description_is_shown_in_the_same_order() -> None:
    assert tuple(SECTIONS) == DESCRIBED


def test_help_lists_every_section() -> None:
    models, _, tasks = (info.help or "").partition("Sections: ")[2].partition("Sections of a task: ")
    assert re.findall(r"\w+", models) == [*SECTIONS]
    assert re.findall(r"\w+", tasks) == ["task", *TABLES]


@pytest.mark.parametrize("name", [name for name, section in SECTIONS.items() if not isinstance(section, LineSection)])
def test_a_model_without_objects_has_empty_tables(name: str) -> None:
    assert name == "bodies" or not any(any(column.cells) for column in table(name, "<mujoco/>").values())


@cases("section, cells")
def test_tables_say_what_the_source_says(section: str, cells: dict[str, list[str]]) -> None:
    columns = table(section)
    assert {heading: list(columns[heading].cells) for heading in cells} == cells


@cases("section, heading, unit")
def test_a_column_has_the_units_of_what_it_shows(section: str, heading: str, unit: str) -> None:
    assert table(section)[heading].unit == unit


def test_the_kind_of_target_stands_with_each_where_it_differs() -> None:
    text = MODEL.replace("</actuator>", '<adhesion name="stick" body="a" ctrlrange="0 1"/></actuator>')
    assert table("actuators", text)["acts on"].cells == ["joint/turn", "joint/turn", "body/a"]


def test_settings_show_their_value_beside_their_default() -> None:
    path, value, default, _ = (column.cells for column in table("options").values())
    rows = dict(zip(path, zip(value, default, strict=True), strict=True))
    assert rows == {"opt.gravity": ("0 0 -1", "0 0 -9.81"), "opt.integrator": ("rk4", "euler")}


def test_files_of_assets_are_relative_to_the_model(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="meshes/a.obj"/></asset>'
        '<worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    )
    columns = table("assets", path=path)
    index = list(columns["kind"].cells).index("mesh")
    assert columns["name"].cells[index] == "m"
    assert columns["file, from the model's folder"].cells[index] == str(Path("meshes/a.obj"))
    assert "4 vertices" in columns["content"].cells[index]


def test_assets_are_news_only_if_there_are_files_beside_the_models_own() -> None:
    section = SECTIONS["assets"]
    assert not isinstance(section, LineSection)
    assert not section.is_news(ModelDescription(mujoco.MjModel.from_xml_string("<mujoco/>")).assets)
