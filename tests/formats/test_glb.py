"""Theorems about binary glTF files, read back by pygltflib and trimesh."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mjrun.errors import UsageError
from mjrun.formats.glb import linear, write_glb, xyzw
from mjrun.scene_graph import shapes
from mjrun.scene_graph.graph import CameraLens, Light, Material, Node, SceneGraph, SceneMotion
from tests.gltf_files import accessor, animated, read_gltf

RED = Material("red", (1.0, 0.0, 0.0, 0.5), 0.0, 0.5)
BALL = shapes.sphere(8, 8)
NODES = [
    Node("world", "world", 0, -1),
    Node("body", "body", 1, 0, (1.0, 2.0, 3.0), moves=True, facts={"mass": 2.0}),
    Node("ball", "geom", 0, 1, (0.0, 0.0, 1.0), scale=(0.1, 0.2, 0.3), mesh=BALL, material=RED, layer="visual"),
    Node("ball 2", "geom", 1, 0, mesh=BALL, material=RED),
    Node("eye", "camera", 0, 1, lens=CameraLens(0.8, 1.5, 0.01, 50)),
    Node("sun", "light", 0, 0, light=Light("spot", (1.0, 1.0, 1.0), 3.0, cutoff=0.5)),
]
TIMES = np.arange(4) / 30
POSITIONS = np.array([[[0.1 * k, 1.0, 1 / 3]] for k in range(4)])
QUATERNIONS = np.array([[[np.cos(k), np.sin(k), 0, 0]] for k in range(4)])
MOTION = SceneMotion(TIMES, [1], POSITIONS, QUATERNIONS)


def written(graph: SceneGraph, motion: SceneMotion | None = None, **facts: object) -> bytes:
    file = io.BytesIO()
    write_glb(file, graph, motion, facts)
    return file.getvalue()


def test_nodes_cameras_lights_and_facts_are_read_back() -> None:
    gltf = read_gltf(written(SceneGraph(NODES), model="m.xml"))
    assert [node.name for node in gltf.nodes] == [node.name for node in NODES]
    assert gltf.nodes[0].children == [1, 3, 5]
    assert gltf.nodes[1].extras == {"kind": "body", "id": 1, "mass": 2.0}
    assert gltf.asset.extras["model"] == "m.xml"
    assert gltf.cameras[0].perspective.yfov == 0.8
    assert gltf.extensions["KHR_lights_punctual"]["lights"][0]["spot"] == {"outerConeAngle": 0.5}
    assert gltf.materials[0].alphaMode == "BLEND"


def test_nodes_share_meshes_and_materials() -> None:
    gltf = read_gltf(written(SceneGraph(NODES)))
    assert (len(gltf.meshes), len(gltf.materials)) == (1, 1)
    blue = Material("blue", (0.0, 0.0, 1.0, 1.0), 0.0, 0.5)
    other = Node("ball 3", "geom", 2, 0, mesh=BALL, material=blue)
    gltf = read_gltf(written(SceneGraph([*NODES, other])))
    first, second = (mesh.primitives[0] for mesh in gltf.meshes)
    assert vars(first.attributes) == vars(second.attributes)
    assert (first.indices, first.material != second.material) == (second.indices, True)


def test_geometry_is_where_it_belongs_with_z_turned_into_y(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(written(SceneGraph(NODES)))
    scene = trimesh.load_scene(tmp_path / "a.glb")
    points = scene.to_mesh().vertices
    expected = np.concatenate([BALL.positions * (0.1, 0.2, 0.3) + (1, 2, 4), BALL.positions])[:, [0, 2, 1]] * (1, 1, -1)
    assert np.allclose(points[np.lexsort(points.T)], expected[np.lexsort(expected.T)], atol=1e-6)


def test_motion_has_exact_times_and_poses() -> None:
    gltf = read_gltf(written(SceneGraph(NODES), MOTION))
    (animation,) = gltf.animations
    assert len({sampler.input for sampler in animation.samplers}) == 1
    assert np.array_equal(accessor(gltf, animation.samplers[0].input).ravel(), TIMES.astype(np.float32))
    values = animated(gltf, "body")
    assert np.allclose(values["translation"], POSITIONS[:, 0], atol=1e-7)
    assert np.allclose(np.abs(np.sum(values["rotation"] * QUATERNIONS[:, 0][:, [1, 2, 3, 0]], axis=1)), 1, atol=1e-6)


def test_what_does_not_move_has_no_channels() -> None:
    still = SceneMotion(TIMES, [1], np.repeat(POSITIONS[:1], 4, axis=0), QUATERNIONS)
    gltf = read_gltf(written(SceneGraph(NODES), still))
    assert [channel.target.path for channel in gltf.animations[0].channels] == ["rotation"]
    resting = SceneMotion(TIMES, [1], still.positions, np.repeat(QUATERNIONS[:1], 4, axis=0))
    assert not read_gltf(written(SceneGraph(NODES), resting)).animations


def test_quaternions_do_not_jump_to_the_opposite_sign() -> None:
    angles = np.linspace(0, 20, 50)
    smooth = np.column_stack([np.cos(angles), np.sin(angles), np.zeros((50, 2))])
    flipped = smooth * np.where(np.arange(50) % 3, 1, -1)[:, None]
    assert np.allclose(np.abs(xyzw(flipped)), np.abs(smooth[:, [1, 2, 3, 0]]))
    assert np.sum(xyzw(flipped)[1:] * xyzw(flipped)[:-1], axis=1).min() > 0


def test_colours_are_linear_light() -> None:
    assert [linear(value) for value in (-1, 0, 1, 2)] == [0, 0, 1, 1]
    assert linear(0.5) == pytest.approx(0.2140, abs=1e-4)  # CSS Color 4, sample values of sRGB
    assert linear(0.04045) == pytest.approx(0.04045 / 12.92)


def test_names_cannot_leave_their_strings() -> None:
    name = '"},{"evil</script>\u2028'
    content = written(SceneGraph([*NODES, Node(name, "body", 2, 0)]))
    assert read_gltf(content).nodes[-1].name == name
    text = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    assert text.isascii()
    assert json.loads(text)["nodes"][-1]["name"] == name


def test_frames_too_close_for_their_numbers_are_refused() -> None:
    close = SceneMotion(1e6 + TIMES[:2] / 1000, [1], POSITIONS[:2], QUATERNIONS[:2])
    with pytest.raises(UsageError, match="too close together"):
        written(SceneGraph(NODES), close)
