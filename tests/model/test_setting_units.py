"""Units of settings, against the units that MuJoCo's manual gives for the attributes."""

import mujoco
import pytest

from mjrun.model.units import setting_unit

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <body name="b"><joint name="turn"/><joint name="push" type="slide"/><geom name="g" size=".1"/><site name="s"/></body>
  <camera name="c"/></worldbody>
  <actuator><motor name="m" joint="push"/></actuator></mujoco>""")


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("opt.timestep", "s"),
        ("opt.gravity[2]", "m/s²"),
        ("opt.iterations", ""),
        ("geom/g.size[0]", "m"),
        ("geom/*.density", "kg/m³"),
        ("scale:geom/*.density", ""),
        ("add:body/b.pos", "m"),
        ("geom/g.friction[0]", ""),
        ("joint/turn.damping", "N·m·s/rad"),
        ("joint/push.damping", "N·s/m"),
        ("joint/turn.range", ""),  # in degrees or radians, as the source chooses
        ("actuator/m.forcerange[1]", "N"),
        ("camera/c.fovy", "deg"),
        ("geom/missing.size", ""),
        ("nonsense", ""),
    ],
)
def test_settings_have_the_units_of_their_fields(path: str, unit: str) -> None:
    assert setting_unit(MODEL, path) == unit
