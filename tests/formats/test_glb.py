"""Theorems about binary glTF files, read back by pygltflib and trimesh."""

import io
import json
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.formats.glb import linear, write_glb, xyzw
from mjrun.scene_graph import meshes
from mjrun.scene_graph.graph import (
    CameraLens,
    Deformation,
    Material,
    Node,
    SceneGraph,
    SceneLight,
    SceneMotion,
    Skin,
    Texture,
    Track,
)
from tests.gltf_files import accessor, animated, read_gltf

RED = Material("red", (1.0, 0.0, 0.0, 0.5), 0.0, 0.5)
BALL = meshes.sphere(8, 8)
NODES = [
    Node("world", "world", 0, -1),
    Node("body", "body", 1, 0, (1.0, 2.0, 3.0), moves=True, facts={"mass": 2.0}),
    Node("ball", "geom", 0, 1, (0.0, 0.0, 1.0), scale=(0.1, 0.2, 0.3), mesh=BALL, material=RED, layer="visual"),
    Node("ball 2", "geom", 1, 0, mesh=BALL, material=RED),
    Node("eye", "camera", 0, 1, lens=CameraLens(0.8, 1.5, 0.01, 50)),
    Node("sun", "light", 0, 0, light=SceneLight("spot", (1.0, 1.0, 1.0), 3.0, cutoff=0.5)),
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


def test_a_view_that_cannot_be_shifted_is_reported() -> None:
    nodes = [NODES[0], Node("eye", "camera", 0, 0, lens=CameraLens(0.8, 1.5, 0.01, 50, shift=(0.1, 0.0)))]
    (remark,) = write_glb(io.BytesIO(), SceneGraph(nodes))
    assert "camera eye is centred" in remark
    assert write_glb(io.BytesIO(), SceneGraph(NODES)) == []


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
    import trimesh

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


def test_what_comes_and_goes_has_keys_of_its_own() -> None:
    blinking = Track(3, np.array([0, 2, 3]), np.zeros((3, 3)), np.eye(4)[[0, 0, 0]], np.eye(3), smooth=False)
    motion = SceneMotion(TIMES, [1], POSITIONS, QUATERNIONS, [blinking])
    gltf = read_gltf(written(SceneGraph(NODES), motion))
    assert animated(gltf, "ball 2").keys() == {"scale"}
    (channel,) = (each for each in gltf.animations[0].channels if each.target.node == 3)
    sampler = gltf.animations[0].samplers[channel.sampler]
    assert (sampler.interpolation, sampler.extras) == ("STEP", {"frames": [0, 2, 3]})
    assert np.array_equal(accessor(gltf, sampler.input).ravel(), TIMES[[0, 2, 3]].astype(np.float32))


def test_the_shapes_of_vertices_are_targets() -> None:
    shapes_of_ball = np.stack([BALL.positions * size for size in (1, 2, 4)])
    normals = np.stack([np.asarray(BALL.normals)] * 3)
    motion = SceneMotion(
        TIMES,
        [],
        np.empty((4, 0, 3)),
        np.empty((4, 0, 4)),
        (),
        [Deformation(3, np.array([0, 1, 3]), shapes_of_ball, normals)],
    )
    gltf = read_gltf(written(SceneGraph(NODES), motion))
    weights = animated(gltf, "ball 2")["weights"].reshape(3, 2)
    primitive = gltf.meshes[gltf.nodes[3].mesh].primitives[0]
    base, *targets = (
        accessor(gltf, index) for index in (primitive.attributes.POSITION, *(t["POSITION"] for t in primitive.targets))
    )
    for row, expected in zip(weights, shapes_of_ball, strict=True):
        assert np.allclose(base + sum(w * target for w, target in zip(row, targets, strict=True)), expected, atol=1e-6)
    assert gltf.meshes[gltf.nodes[2].mesh].primitives[0].targets == []


def test_a_skin_is_bound_to_the_nodes_of_its_bodies() -> None:
    bind = np.eye(4)
    bind[:3, 3] = 1, 2, 3
    count = len(BALL.positions)
    skin = Skin([1], bind[None], np.zeros((count, 4), int), np.eye(4)[np.zeros(count, int)])
    gltf = read_gltf(written(SceneGraph([*NODES, Node("skin", "skin", 0, 0, mesh=BALL, skin=skin)])))
    assert gltf.skins[0].joints == [1]
    assert gltf.scenes[0].nodes == [0, len(NODES)]  # the format ignores what is above a skin
    assert len(NODES) not in gltf.nodes[0].children
    assert accessor(gltf, gltf.skins[0].inverseBindMatrices)[0, 12:].tolist() == [1, 2, 3, 1]  # column by column
    attributes = gltf.meshes[gltf.nodes[-1].mesh].primitives[0].attributes
    assert accessor(gltf, attributes.WEIGHTS_0).sum() == count


def test_lines_have_no_normals() -> None:
    line = Node("line", "decoration", -1, 0, mesh=meshes.line(), material=RED)
    primitive = read_gltf(written(SceneGraph([NODES[0], line]))).meshes[0].primitives[0]
    assert (primitive.mode, primitive.attributes.NORMAL) == (1, None)


def test_textures_are_read_back() -> None:
    pixels = np.arange(5 * 4 * 3, dtype=np.uint8).reshape(5, 4, 3)
    material = replace(RED, texture=Texture("checker", pixels))
    ball = Node("ball", "geom", 0, 0, mesh=meshes.sphere(8, 8), material=material)
    gltf = read_gltf(written(SceneGraph([NODES[0], ball])))
    view = gltf.bufferViews[gltf.images[0].bufferView]
    assert np.array_equal(iio.imread(gltf.binary_blob()[view.byteOffset :][: view.byteLength]), pixels)
    assert accessor(gltf, gltf.meshes[0].primitives[0].attributes.TEXCOORD_0).max() == 1


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
