"""Theorems about described objects: they are what the source says."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.model.info import ModelDescription
from tests.cases import cases

DEVICE = """<mujoco><worldbody><site name="a"/><body name="b"><joint name="hinge"/><geom size="1"/><site name="s"/>
</body><body name="c"><joint name="ball" type="ball"/><geom size="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""


def test_the_tree_of_bodies_is_that_of_the_source(scene: ModelDescription) -> None:
    def nested(element: ET.Element, depth: int) -> Iterator[tuple[str | None, int]]:
        for child in element.findall("body"):
            yield child.get("name"), depth
            yield from nested(child, depth + 1)

    world = ET.parse(scene.path or "").getroot().find("worldbody")
    assert world is not None
    written = [("world", 0), *nested(world, 1)]
    if len(written) != len(scene.bodies):
        pytest.skip("the source replicates bodies")
    assert [(body.name, body.depth) for body in scene.bodies] == [
        (name or f"body:{i}", depth) for i, (name, depth) in enumerate(written)
    ]


def test_bodies_hold_every_joint_geom_and_site_once_and_masses_add_up(scene: ModelDescription) -> None:
    for what in ("joints", "geoms", "sites"):
        held = [name for body in scene.bodies for name in getattr(body, what)]
        assert sorted(held) == sorted(thing.name for thing in getattr(scene, what))
        for thing in getattr(scene, what):
            assert thing.name in next(getattr(body, what) for body in scene.bodies if body.name == thing.body)
    for body in scene.bodies:
        children = [other for other in scene.bodies if other.parent == body.id]
        assert body.subtree_mass == pytest.approx(body.mass + sum(child.subtree_mass for child in children))
        assert all(child.depth == body.depth + 1 for child in children)


def test_joints_say_what_the_source_says(mixed: ModelDescription) -> None:
    ball, slide, hinge, free = mixed.joints
    assert [joint.name for joint in mixed.joints] == ["ball", "slide", "hinge", "joint:3"]
    assert [joint.type for joint in mixed.joints] == ["ball", "slide", "hinge", "free"]
    assert [joint.unit for joint in mixed.joints] == ["rad", "m", "rad", ""]
    assert [joint.body for joint in mixed.joints] == ["ball", "car", "car", "body:4"]
    assert [joint.range for joint in mixed.joints] == [(0, 1), None, (-1, 2), None]
    assert [joint.axis for joint in mixed.joints] == [None, (0, 1, 0), (0, 0, 1), None]
    assert (slide.damping, slide.stiffness, hinge.armature, hinge.frictionloss) == (2, 3, 0.5, 0.25)
    assert (hinge.anchor, hinge.qpos0, hinge.spring_reference) == ((0, 0, 0.5), (0,), 0)
    assert (ball.qpos0, free.qpos0) == ((1, 0, 0, 0), (2, 0, 0, 1, 0, 0, 0))


def test_a_geom_has_as_many_sizes_as_its_type(mixed: ModelDescription) -> None:
    sizes = [(geom.type, len(geom.size)) for geom in mixed.geoms]
    assert sizes == [("plane", 3), ("sphere", 1), ("capsule", 2), ("sphere", 1), ("box", 3)]
    assert mixed.bodies[2].geom_types == ("capsule",)
    assert mixed.bodies[-1].mocap


def test_colours_of_geoms_are_those_of_the_model(described: Callable[[str], ModelDescription]) -> None:
    geoms = '<geom size=".1" rgba=".2 .4 .9 .5"/><geom size=".1"/><geom size=".1" material="m"/>'
    text = f'<mujoco><asset><material name="m" rgba="1 0 0 1"/></asset><worldbody>{geoms}</worldbody></mujoco>'
    colours = mujoco.MjModel.from_xml_string(text).geom_rgba
    np.testing.assert_array_equal(np.float32([geom.rgba for geom in described(text).geoms]), colours)


def test_a_camera_has_an_angle_a_height_or_a_sensor(described: Callable[[str], ModelDescription]) -> None:
    usual, flat, lens, follower = described("""<mujoco><worldbody><camera fovy="30"/>
        <camera name="flat" projection="orthographic" fovy="2"/><camera sensorsize=".04 .03" focal=".05 .06"
        principal=".001 0" resolution="640 480" output="rgb depth"/><body name="b"><geom size="1"/></body>
        <camera mode="targetbody" target="b"/></worldbody></mujoco>""").cameras
    assert (usual.name, usual.fovy, usual.height, usual.sensor_size) == ("camera:0", 30, None, None)
    assert (flat.fovy, flat.height, flat.projection) == (None, 2, "orthographic")
    assert (lens.fovy, lens.sensor_size, lens.focal_length) == (None, (0.04, 0.03), (0.05, 0.06))
    assert (lens.principal_point, lens.resolution, lens.outputs) == ((0.001, 0), (640, 480), ("rgb", "depth"))
    assert (follower.mode, follower.target, follower.body) == ("targetbody", "b", "world")


def test_a_tendon_passes_what_the_source_lists(mixed: ModelDescription) -> None:
    total, both, rope = mixed.tendons
    assert [tuple(vars(point).values()) for point in total.path] == [("joint", "hinge", 2)]
    assert [tuple(vars(point).values()) for point in both.path] == [("joint", "hinge", 1), ("joint", "slide", -0.5)]
    assert [(point.kind, point.name) for point in rope.path] == [
        ("site", "s"), ("sphere", "car"), ("site", "ref"), ("pulley", None), ("site", "s"), ("site", "ref"),
    ]  # fmt: skip
    assert rope.path[3].coefficient == 2
    assert [tendon.unit for tendon in mixed.tendons] == ["rad", "", "m"]
    assert [tendon.range for tendon in mixed.tendons] == [(0, 1), None, None]
    assert rope.stiffness == 5


def test_equalities_pairs_and_excludes_name_what_they_bind(mixed: ModelDescription) -> None:
    bound = [(e.type, e.object_kind, e.object1, e.object2, e.active) for e in mixed.equalities]
    assert bound == [
        ("connect", "body", "car", "world", True),
        ("weld", "site", "s", "ref", False),
        ("joint", "joint", "hinge", "slide", True),
        ("tendon", "tendon", "rope", None, True),
    ]
    assert mixed.equalities[0].data[:3] == (1, 2, 3)
    assert [(p.name, p.geom1, p.geom2, p.friction) for p in mixed.pairs] == [("pair:0", "tip", "car", (1, 2, 3, 4, 5))]
    assert [(e.name, e.body1, e.body2) for e in mixed.excludes] == [("exclude:0", "car", "goal")]


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
