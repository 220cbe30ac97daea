"""The sections of `mjrun info` are those of a model's description, and its help lists them."""

import re

import mujoco

from mjrun.cli.info import info
from mjrun.cli.info_sections import SECTIONS, LineSection
from mjrun.cli.task_page import TABLES
from mjrun.model.description.model_description import SECTIONS as DESCRIBED
from mjrun.model.description.model_description import ModelDescription

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


def test_every_section_of_a_description_is_shown_in_the_same_order() -> None:
    assert tuple(SECTIONS) == DESCRIBED


def test_help_lists_every_section() -> None:
    models, _, tasks = (info.help or "").partition("Sections: ")[2].partition("Sections of a task: ")
    assert re.findall(r"\w+", models) == [*SECTIONS]
    assert re.findall(r"\w+", tasks) == ["task", *TABLES]


def test_each_table_has_the_rows_of_its_own_section() -> None:
    description = ModelDescription(mujoco.MjModel.from_xml_string(TEXT))
    for name, section in SECTIONS.items():
        if isinstance(section, LineSection):
            assert section.lines(description)
        else:
            rows = section.rows(description)
            assert rows == getattr(description, name)
            assert all(len(column.cells) in (0, len(rows)) for column in section.columns(rows))


def test_assets_are_news_only_if_there_are_files_beside_the_models_own() -> None:
    section = SECTIONS["assets"]
    assert not isinstance(section, LineSection)
    description = ModelDescription(mujoco.MjModel.from_xml_string("<mujoco/>"))
    assert not section.is_news(section.rows(description))
