"""Theorems about described bodies, joints, geoms and sites: they are what the source says."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator

import pytest

from mjrun.model.info import ModelDescription


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
