"""Theorems about described actuators: they are what the source says."""

import xml.etree.ElementTree as ET
from collections.abc import Callable

import pytest

from mjrun.model.description.model_description import ModelDescription

DEVICE = """<mujoco><worldbody><site name="a"/><body name="b"><joint name="hinge"/><geom size="1"/><site name="s"/>
</body><body name="c"><joint name="ball" type="ball"/><geom size="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    "element",
    [
        '<general joint="hinge" gainprm="5"/>',
        '<motor joint="hinge" gear="7"/>',
        '<position joint="hinge" kp="7"/>',
        '<position joint="hinge" kp="7" kv="2" timeconst=".1"/>',
        '<velocity joint="hinge" kv="3"/>',
        '<intvelocity joint="hinge" kp="2" actrange="-1 1"/>',
        '<damper joint="hinge" kv="2" ctrlrange="0 1"/>',
        '<cylinder joint="hinge" area="2"/>',
        '<muscle joint="hinge" lengthrange="0 1"/>',
        '<adhesion body="b" gain="3" ctrlrange="0 1"/>',
        '<pid joint="hinge" kp="1" ki="2" kv=".1"/>',
        '<orientation joint="ball" kp="3"/>',
        '<dcmotor joint="hinge" motorconst="1 1" resistance="1"/>',
    ],
)
def test_an_actuator_is_of_the_kind_that_it_was_written_as(
    element: str, described: Callable[[str], ModelDescription]
) -> None:
    (actuator,) = described(DEVICE.format(element)).actuators
    written = ET.fromstring(element)
    assert actuator.kind == written.tag
    assert (actuator.target_kind, actuator.target) == next(
        (kind, written.get(kind)) for kind in ("joint", "body") if written.get(kind)
    )


def test_actuators_say_what_the_source_says(mixed: ModelDescription) -> None:
    motor, muscle, servo, integrator, jet = mixed.actuators
    assert [actuator.name for actuator in mixed.actuators] == ["m", "actuator:1", "o", "actuator:3", "actuator:4"]
    assert (motor.gear, motor.force_range, motor.ctrl_range, motor.gain_parameters) == (
        ((3,),),
        (-4, 5),
        ((-1, 1),),
        (1,),
    )
    assert [(actuator.unit, actuator.force_unit) for actuator in mixed.actuators] == [
        ("rad", "N·m"), ("m", "N"), ("rad", "N·m"), ("rad", "N·m"), ("rad", "N·m"),
    ]  # fmt: skip
    assert (muscle.transmission, muscle.target, muscle.act_size) == ("tendon", "rope", 1)
    assert (servo.ctrl_size, servo.gear, servo.act) == (3, ((1,),) * 3, None)
    assert (integrator.act_range, jet.target_kind, jet.reference) == ((-1, 1), "site", None)


def test_a_slider_crank_names_both_sites(described: Callable[[str], ModelDescription]) -> None:
    element = '<position cranksite="s" slidersite="a" cranklength="1"/>'
    (actuator,) = described(DEVICE.format(element)).actuators
    assert (actuator.transmission, actuator.target, actuator.reference) == ("slidercrank", "s", "a")
