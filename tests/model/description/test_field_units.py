"""Units of the fields of a compiled model."""

import mujoco
import pytest

from mjrun.diff.model_fields import model_fields
from mjrun.model.description.field_units import UNITS, field_unit

MODEL = mujoco.MjModel.from_xml_string(
    """
<mujoco><worldbody>
  <body><freejoint/><geom size="1"/></body>
  <body><joint name="slide" type="slide"/><geom size="1"/><body><joint name="hinge"/><geom size="1"/></body></body>
  <camera fovy="1" projection="orthographic"/><camera/>
</worldbody>
<tendon><fixed><joint joint="hinge" coef="1"/></fixed></tendon>
<actuator><motor joint="slide"/><motor joint="hinge"/></actuator>
<sensor><gyro site="s"/></sensor></mujoco>""".replace("<camera/>", '<camera/><site name="s"/>')
)


@pytest.mark.parametrize(
    ("field", "units"),
    [
        ("qpos0", ["m"] * 3 + [""] * 4 + ["m", "rad"]),
        ("dof_damping", ["N·s/m"] * 3 + ["N·m·s/rad"] * 3 + ["N·s/m", "N·m·s/rad"]),
        ("dof_armature", ["kg"] * 3 + ["kg·m²"] * 3 + ["kg", "kg·m²"]),
        ("dof_frictionloss", ["N"] * 3 + ["N·m"] * 3 + ["N", "N·m"]),
        ("jnt_range", ["", "m", "rad"]),
        ("jnt_stiffness", ["", "N/m", "N·m/rad"]),
        ("tendon_stiffness", ["N·m/rad"]),
        ("actuator_forcerange", ["N", "N·m"]),
        ("actuator_lengthrange", ["m", "rad"]),
        ("sensor_noise", ["rad/s"]),
        ("cam_fovy", ["m", "deg"]),
        ("body_mass", ["kg"] * 4),
        ("geom_rgba", [""] * 3),
    ],
)
def test_units_are_those_of_the_object(field: str, units: list[str]) -> None:
    assert [field_unit(MODEL, field, i) for i in range(len(getattr(MODEL, field)))] == units


def test_every_field_with_a_unit_exists() -> None:
    assert set(UNITS) <= {field.name for field in model_fields()}
