"""Theorems about described actuators: they are what the source says."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import mujoco

from mjrun.model.info import ModelDescription
from tests.cases import cases

DEVICE = """<mujoco><worldbody><site name="a"/><body name="b"><joint name="hinge"/><geom size="1"/><site name="s"/>
</body><body name="c"><joint name="ball" type="ball"/><geom size="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""


@cases("element")
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


@cases("element, kind, name, dim, unit")
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


def test_cutoff_noise_and_the_frame_of_a_sensor_are_reported(
    described: Callable[[str], ModelDescription], mixed_xml: str
) -> None:
    keyless = mixed_xml[: mixed_xml.index("<keyframe>")]
    element = '<framepos objtype="geom" objname="tip" reftype="site" refname="ref" cutoff="3" noise=".5"/>'
    (sensor,) = described(f"{keyless}<sensor>{element}</sensor></mujoco>").sensors
    assert (sensor.reference_kind, sensor.reference, sensor.cutoff, sensor.noise) == ("site", "ref", 3, 0.5)


def test_plugins_are_reported_by_name_with_what_the_source_sets(shared_models: Path) -> None:
    path = shared_models / "plugin/actuator/pid.xml"
    written = {
        instance.get("name"): {config.get("key"): config.get("value") for config in instance.findall("config")}
        for instance in ET.parse(path).getroot().iter("instance")
    }
    found = ModelDescription(mujoco.MjModel.from_xml_path(str(path))).plugins
    assert {plugin.name: plugin.settings for plugin in found} == written
    assert {plugin.plugin for plugin in found} == {"mujoco.pid"}
    assert [plugin.users for plugin in found] == [(f"actuator/actuator:{i}",) for i in range(4)]


def test_a_flex_is_counted_and_its_equality_names_it(shared_models: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(shared_models / "flex/pancake.xml"))
    found = ModelDescription(model)
    (flex,) = found.flexes
    assert (flex.name, flex.elements_are, flex.edge_equality) == ("plate", "triangles", "edges")
    assert (flex.vertices, flex.elements, flex.edges) == (model.nflexvert, model.nflexelem, model.nflexedge)
    assert [(e.type, e.object_kind, e.object1) for e in found.equalities] == [("flex", "flex", "plate")]
