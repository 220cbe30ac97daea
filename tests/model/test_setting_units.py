"""Units of settings, against the units that MuJoCo's manual gives for the attributes."""

import mujoco

from mjrun.model.units import setting_unit
from tests.cases import cases

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <body name="b"><joint name="turn"/><joint name="push" type="slide"/><geom name="g" size=".1"/><site name="s"/></body>
  <camera name="c"/></worldbody>
  <actuator><motor name="m" joint="push"/></actuator></mujoco>""")


@cases("path, unit")
def test_settings_have_the_units_of_their_fields(path: str, unit: str) -> None:
    assert setting_unit(MODEL, path) == unit
