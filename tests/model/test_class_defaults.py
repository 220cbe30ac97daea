"""Theorems about the place of an attribute: MuJoCo takes the value from there."""

from pathlib import Path

import mujoco
import pytest

from mjrun.model.xml_source import holder, read_xml

DEFAULTS = """
  <default>
    <joint armature="1"/>
    <motor gear="1"/>
    <default class="a">
      <joint armature="2"/>
      <default class="b"><joint damping="3"/><position gear="3"/></default>
    </default>
  </default>
  <default><joint armature="4"/></default>"""
MODEL = """<mujoco>{defaults}
  <worldbody><body childclass="{outer}"><frame childclass="{inner}"><joint name="j" {own}/></frame>
    <geom size="1"/></body></worldbody>
  <actuator><general name="m" joint="j" {actuator}/></actuator>
</mujoco>"""


@pytest.mark.parametrize(
    "own", ["", 'class="a"', 'class="b"', 'class="main"', 'armature="5"', 'class="b" armature="6"']
)
@pytest.mark.parametrize(("outer", "inner"), [("a", "b"), ("b", "a"), ("b", "main")])
@pytest.mark.parametrize("actuator", ["", 'class="b"', 'class="a"'])
def test_mujoco_takes_the_value_from_the_holder(
    tmp_path: Path, own: str, outer: str, inner: str, actuator: str
) -> None:
    text = MODEL.format(defaults=DEFAULTS, outer=outer, inner=inner, own=own, actuator=actuator)
    path = tmp_path / "model.xml"
    path.write_text(text)
    model = mujoco.MjModel.from_xml_string(text)
    elements = list(read_xml(path).elements())
    joint = holder(next(e for e in elements if e.attributes.get("name") == "j"), "armature")
    motor = holder(next(e for e in elements if e.attributes.get("name") == "m"), "gear")
    assert joint
    assert motor
    assert float(joint.attributes["armature"]) == model.dof_armature[0]
    assert float(motor.attributes["gear"]) == model.actuator_gear[0, 0]
    assert holder(next(e for e in elements if e.attributes.get("name") == "j"), "stiffness") is None
