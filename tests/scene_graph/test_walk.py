"""Theorems about the scene of a model: nodes are where MuJoCo puts their objects; lights are in physical units."""

import math

import mujoco
import numpy as np
import pytest

from mjrun.scene_graph.graph import Node, SceneGraph, SceneLight
from mjrun.scene_graph.recorder import SceneContentSettings, compute_poses, record_scene
from mjrun.scene_graph.walk import light_of, matrix_quaternion, toward
from tests.cases import mjcf

ARM = mjcf("posed_arm")


def stepped(count: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    data.qvel[:] = 1, -2, 3
    mujoco.mj_step(model, data, nstep=count)
    data.mocap_pos[0] = count, 1, 2
    return model, data


def whole(model: mujoco.MjModel, data: mujoco.MjData, options: mujoco.MjvOption | None = None) -> SceneGraph:
    compute_poses(model, data)
    return record_scene(model, [data], [0.0], SceneContentSettings(options or mujoco.MjvOption()))[0]


def matrix(node: Node) -> np.ndarray:
    made = np.eye(4)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, node.quaternion)
    made[:3, :3], made[:3, 3] = rotation.reshape(3, 3), node.position
    return made


def world(graph: SceneGraph, node: Node) -> np.ndarray:
    return matrix(node) if node.parent < 0 else world(graph, graph.nodes[node.parent]) @ matrix(node)


def test_every_object_is_where_mujoco_puts_it() -> None:
    model, data = stepped(100)
    graph = whole(model, data)
    places = {
        "body": (data.xpos, data.xmat),
        "geom": (data.geom_xpos, data.geom_xmat),
        "site": (data.site_xpos, data.site_xmat),
        "camera": (data.cam_xpos, data.cam_xmat),
    }
    for node in graph.nodes:
        if node.kind in places:
            positions, rotations = places[node.kind]
            assert np.allclose(world(graph, node)[:3, 3], positions[node.id], atol=1e-9)
            assert np.allclose(world(graph, node)[:3, :3].ravel(), rotations[node.id], atol=1e-9)
    (light,) = (node for node in graph.nodes if node.kind == "light")
    assert np.allclose(-world(graph, light)[:3, 2], data.light_xdir[0], atol=1e-9)


def test_lenses_are_as_wide_as_intrinsics_make_them() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom size=".1"/><camera resolution="320 240" focalpixel="250 300" principalpixel="20 -10"
        sensorsize=".032 .024"/><camera resolution="300 200" fovy="40"/></worldbody></mujoco>"""
    )
    exact, plain = (node.lens for node in whole(model, mujoco.MjData(model)).nodes if node.lens)
    assert (np.tan(exact.fovy / 2), exact.aspect) == pytest.approx((120 / 300, (320 / 250) / (240 / 300)), abs=1e-6)
    assert exact.shift == pytest.approx((20 / 250 * 300 / 240, 10 / 240), abs=1e-6)
    assert (np.rad2deg(plain.fovy), plain.aspect, plain.shift) == (pytest.approx(40), pytest.approx(1.5), (0, 0))


def test_hidden_groups_are_left_out() -> None:
    model, data = stepped(0)
    names = {node.name for node in whole(model, data).nodes if node.kind == "geom"}
    assert names == {"floor", "upper", "egg", "target"}
    options = mujoco.MjvOption()
    options.geomgroup[4] = 1
    options.sitegroup[0] = 0
    shown = whole(model, data, options)
    assert {node.name for node in shown.nodes if node.kind in ("geom", "site")} == names | {"hidden"}


def test_what_collides_and_is_hidden_is_included_on_request() -> None:
    model, data = stepped(0)
    compute_poses(model, data)
    request = SceneContentSettings(mujoco.MjvOption(), hidden=True)
    nodes = {node.name: node for node in record_scene(model, [data], [0.0], request)[0].nodes if node.kind == "geom"}
    assert (nodes["hidden"].visible, nodes["hidden"].layer) == (False, "collision")
    assert (nodes["egg"].visible, nodes["egg"].layer) == (True, "both")


def test_directions_become_rotations_of_the_view() -> None:
    for direction in np.eye(3)[[0, 1, 2]] * [[1], [-1], [1]]:
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, toward(direction))
        assert np.allclose(-rotation.reshape(3, 3)[:, 2], direction)
        assert np.allclose(np.abs(matrix_quaternion(rotation)), np.abs(toward(direction)))


def lights(*elements: str) -> list[SceneLight | None]:
    xml = f"<mujoco><worldbody><geom type='plane' size='9 9 1'/>{''.join(elements)}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return [light_of(model, data, index) for index in range(model.nlight)]


def test_a_spot_gives_the_floor_the_brightness_of_its_colour() -> None:
    (light,) = lights("<light pos='0 0 3' dir='0 0 -1' diffuse='.5 .25 0' cutoff='30'/>")
    assert light
    assert (light.kind, light.color) == ("spot", (1.0, 0.5, 0.0))
    assert light.intensity / 3**2 == pytest.approx(math.pi * 0.5)
    assert light.cutoff == pytest.approx(math.pi / 6)


def test_the_sun_is_the_same_everywhere() -> None:
    (light,) = lights("<light type='directional' pos='0 0 7' diffuse='1 1 1'/>")
    assert light == SceneLight("directional", (1.0, 1.0, 1.0), math.pi)


def test_lights_that_are_off_or_dark_are_left_out() -> None:
    dark = ("active='false'", "diffuse='0 0 0'", "type='spot' cutoff='0'")
    assert lights(*(f"<light {each}/>" for each in dark)) == [None, None, None]
