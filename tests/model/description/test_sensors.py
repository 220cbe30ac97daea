"""Theorems about described sensors: they are what the source says."""

from collections.abc import Callable

import pytest

from mjrun.model.description.model_description import ModelDescription


@pytest.mark.parametrize(
    ("element", "kind", "name", "dim", "unit"),
    [
        ('<jointpos joint="hinge"/>', "joint", "hinge", 1, "rad"),
        ('<jointvel joint="slide"/>', "joint", "slide", 1, "m/s"),
        ('<jointactuatorfrc joint="slide"/>', "joint", "slide", 1, "N"),
        ('<tendonpos tendon="sum"/>', "tendon", "sum", 1, "rad"),
        ('<tendonvel tendon="rope"/>', "tendon", "rope", 1, "m/s"),
        ('<tendonpos tendon="both"/>', "tendon", "both", 1, ""),
        ('<actuatorfrc actuator="m"/>', "actuator", "m", 1, "N·m"),
        ('<ballquat joint="ball"/>', "joint", "ball", 4, ""),
        ('<framepos objtype="xbody" objname="car"/>', "xbody", "car", 3, "m"),
        ('<framelinacc objtype="site" objname="s"/>', "site", "s", 3, "m/s²"),
        ('<rangefinder site="s"/>', "site", "s", 1, "m"),
        ('<rangefinder site="s" data="dist normal"/>', "site", "s", 4, ""),
        ('<contact geom1="tip" data="force"/>', "geom", "tip", 3, "N"),
        ('<contact geom1="tip" data="found"/>', "geom", "tip", 1, ""),
        ("<clock/>", None, None, 1, "s"),
        ('<user dim="3"/>', None, None, 3, ""),
    ],
)
def test_a_sensor_says_of_what_how_much_and_in_which_unit(
    element: str,
    kind: str | None,
    name: str | None,
    dim: int,
    unit: str,
    described: Callable[[str], ModelDescription],
    mixed_xml: str,
) -> None:
    keyless = mixed_xml[: mixed_xml.index("<keyframe>")]
    (sensor,) = described(f"{keyless}<sensor>{element}</sensor></mujoco>").sensors
    assert (sensor.object_kind, sensor.object, sensor.dim, sensor.unit) == (kind, name, dim, unit)
    assert sensor.name == "sensor:0"


def test_cutoff_noise_and_the_frame_of_a_sensor_are_told(
    described: Callable[[str], ModelDescription], mixed_xml: str
) -> None:
    keyless = mixed_xml[: mixed_xml.index("<keyframe>")]
    element = '<framepos objtype="geom" objname="tip" reftype="site" refname="ref" cutoff="3" noise=".5"/>'
    (sensor,) = described(f"{keyless}<sensor>{element}</sensor></mujoco>").sensors
    assert (sensor.reference_kind, sensor.reference, sensor.cutoff, sensor.noise) == ("site", "ref", 3, 0.5)
