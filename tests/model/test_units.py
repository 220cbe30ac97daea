"""Theorems about units: they follow from metres, kilograms and seconds, so forces and velocities do work in joules."""

import mujoco
import pytest

from mjrun.model.fields import arrays
from mjrun.model.units import (
    ARMATURE,
    DAMPING,
    FORCES,
    STIFFNESS,
    UNITS,
    actuator_force_unit,
    actuator_unit,
    field_unit,
    joint_unit,
    rate_unit,
    tendon_unit,
)
from mjrun.probe.fields import extents
from tests.cases import cases, mjcf

MODEL = mujoco.MjModel.from_xml_string(mjcf("units"))


def test_hinges_and_balls_turn_slides_move_and_free_joints_do_both() -> None:
    assert [joint_unit(MODEL, i) for i in range(MODEL.njnt)] == ["rad", "m", "rad", ""]


def test_a_tendon_is_as_long_as_what_it_sums() -> None:
    assert [tendon_unit(MODEL, i) for i in range(MODEL.ntendon)] == ["rad", "m", "", "m"]


@pytest.mark.parametrize(
    ("actuator", "unit", "force"),
    [
        *((0, "rad", "N·m"), (1, "m", "N"), (2, "rad", "N·m"), (3, "rad", "N·m"), (4, "m", "N"), (5, "", "")),
        *((6, "m", "N"), (8, "m", "N"), (9, "rad", "N·m"), (10, "", ""), (11, "m", "N")),
    ],
)
def test_the_force_of_an_actuator_does_work_on_its_length(actuator: int, unit: str, force: str) -> None:
    assert (actuator_unit(MODEL, actuator), actuator_force_unit(MODEL, actuator)) == (unit, force)


def test_adhesion_is_a_force_between_surfaces() -> None:
    assert actuator_force_unit(MODEL, 7) == "N"


def test_a_rate_is_per_second_if_there_is_a_unit() -> None:
    assert [rate_unit(unit) for unit in ("m", "rad", "")] == ["m/s", "rad/s", ""]


FIELD_UNITS_MODEL = mujoco.MjModel.from_xml_string(
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


@cases("field, units")
def test_units_are_those_of_the_object(field: str, units: list[str]) -> None:
    assert [field_unit(FIELD_UNITS_MODEL, field, i) for i in range(len(getattr(FIELD_UNITS_MODEL, field)))] == units


def test_every_field_with_a_unit_exists() -> None:
    assert set(UNITS) <= {*arrays(), *extents()}
    assert not {*UNITS} & {*arrays()} & {*extents()}


def test_they_are_forces_by_the_unit_of_position_and_its_rates() -> None:
    for unit, force in FORCES.items():
        assert STIFFNESS[unit] == f"{force}/{unit}"
        assert DAMPING[unit] == f"{force}·s/{unit}"
    assert ARMATURE == {"rad": "kg·m²", "m": "kg"}
