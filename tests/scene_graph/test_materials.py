"""Theorems about materials and textures: what a texture shows at a point is what MuJoCo shows there."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjrun.formats.image_encoding import ImageData, png
from mjrun.scene_graph import meshes
from mjrun.scene_graph.graph import Mesh, Node
from mjrun.scene_graph.materials import PADDING, MaterialCache, TextureMapping, atlas, cube_mapped
from mjrun.scene_graph.recorder import SceneContentSettings, compute_poses, record_scene
from tests.cases import mjcf

MODEL = mjcf("materials")


@pytest.fixture(scope="module")
def nodes() -> dict[str, Node]:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    compute_poses(model, data)
    graph, _ = record_scene(model, [data], [0.0], SceneContentSettings(mujoco.MjvOption()))
    return {node.name: node for node in graph.nodes if node.kind == "geom"}


def uv_at(node: Node, x: float, y: float) -> np.ndarray:
    """Returns the texture coordinates at a point of a rectangle, interpolated linearly."""
    assert node.mesh
    assert node.mesh.uv is not None
    corners = node.mesh.positions[:, :2].astype(float)
    solution = np.linalg.lstsq(np.column_stack([corners, np.ones(4)]), node.mesh.uv.astype(float), rcond=None)[0]
    return np.array([x, y, 1.0]) @ solution


def test_textures_repeat_as_in_the_manual(nodes: dict[str, Node]) -> None:
    """The manual: texrepeat counts repetitions over the object, or per unit of length if texuniform is set."""
    for name, repetitions in (("stretched", (2, 3)), ("even", (8, 6))):
        low, high = uv_at(nodes[name], -4, 2), uv_at(nodes[name], 4, -2)
        assert np.allclose(low, 0, atol=1e-5)  # the first pixel is at the corner −x +y
        assert np.allclose(high, repetitions, atol=1e-5)


def test_an_infinite_plane_repeats_per_two_units_of_length(nodes: dict[str, Node]) -> None:
    moved = uv_at(nodes["floor"], 2, 0) - uv_at(nodes["floor"], 0, 2)
    assert np.allclose(moved, (2, 3), atol=1e-4)


def test_materials_keep_their_parameters(nodes: dict[str, Node]) -> None:
    metal, plain = nodes["metal"].material, nodes["plain"].material
    assert metal
    assert plain
    assert (metal.rgba, metal.metallic, metal.roughness) == ((0.5, 0.5, 0.5, 0.25), 0.75, 0.5)
    assert metal.emission == 0.125
    assert (plain.metallic, plain.texture, metal.texture) == (0.0, None, None)
    assert 0 < plain.roughness < 1


def test_geoms_with_one_look_share_material_and_mesh(nodes: dict[str, Node]) -> None:
    assert nodes["metal"].mesh is nodes["plain"].mesh
    assert nodes["stretched"].material is nodes["floor"].material


def pixel(texture: np.ndarray, uv: np.ndarray) -> tuple[int, ...]:
    height, width, _ = texture.shape
    return tuple(texture[min(int(uv[1] * height), height - 1), min(int(uv[0] * width), width - 1)].tolist())


# The rules of OpenGL for a direction: https://registry.khronos.org/OpenGL/specs/gl/glspec46.core.pdf, 8.13.
RULES = [
    ((1, 0.4, 0.7), 0, (-0.7, -0.4)),
    ((-1, 0.4, 0.7), 1, (0.7, -0.4)),
    ((0.4, 1, 0.7), 2, (0.4, 0.7)),
    ((0.4, -1, 0.7), 3, (0.4, -0.7)),
    ((0.4, 0.7, 1), 4, (0.4, -0.7)),
    ((0.4, 0.7, -1), 5, (-0.4, -0.7)),
]


@pytest.mark.parametrize(("direction", "face", "place"), RULES)
def test_a_direction_shows_the_pixel_of_a_cube_map_that_opengl_shows(
    direction: tuple[float, float, float], face: int, place: tuple[float, float]
) -> None:
    size = 16
    faces = np.arange(6 * size * size * 3, dtype=np.uint32).reshape(6, size, size, 3)
    at = np.array([direction, direction, direction]) + np.eye(3) * 1e-3
    mesh = Mesh("point", at.astype(np.float32), at.astype(np.float32), np.array([(0, 1, 2)], np.uint32))
    made = cube_mapped(mesh, np.ones(3), size)
    assert made.uv is not None
    column, row = (int((each + 1) / 2 * size) for each in place)
    assert pixel(atlas(faces), made.uv.mean(axis=0)) == tuple(faces[face, row, column].tolist())


def test_cutting_keeps_the_surface_and_puts_each_triangle_on_one_face() -> None:
    ball = meshes.sphere(12, 8)
    made = cube_mapped(ball, np.array([1.0, 0.7, 0.4]), 16)

    def area(mesh: Mesh) -> float:
        a, b, c = mesh.positions[mesh.faces].astype(float).transpose(1, 0, 2)
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    assert area(made) == pytest.approx(area(ball), rel=1e-5)
    assert made.uv is not None
    whole = 16 + 2 * PADDING
    cells = np.floor(made.uv * (3 * whole, 2 * whole) / whole - 1e-6).astype(int)[made.faces]
    assert (cells == cells[:, :1]).all()


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e5])
def test_cutting_keeps_meshes_of_any_size(scale: float) -> None:
    ball = meshes.sphere(24, 12)
    mesh = cube_mapped(replace(ball, positions=(ball.positions * scale).astype(np.float32)), np.ones(3), 16)
    radii = np.linalg.norm(mesh.positions.astype(float)[mesh.faces], axis=2) / scale
    whole = np.linalg.norm(cube_mapped(ball, np.ones(3), 16).positions, axis=1)
    assert len(mesh.positions) == len(whole)
    assert (radii.min(), radii.max()) == pytest.approx((whole.min(), whole.max()), rel=1e-5)


def test_a_texture_makes_translucent_geoms_more_so_and_leaves_others_opaque() -> None:
    """As MuJoCo's renderer, which blends only geoms whose own opacity is below 1."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset><texture name="glass" type="2d" file="glass.png" nchannel="4"/>
        <material name="solid" texture="glass"/><material name="thin" texture="glass" rgba="1 1 1 .5"/></asset>
        <worldbody><geom name="a" type="plane" size="1 1 1" material="solid"/>
        <geom name="b" type="plane" size="1 1 1" material="thin"/></worldbody></mujoco>""",
        {"glass.png": png(ImageData(np.full((2, 2, 4), 7, np.uint8), 0, None, {}))},
    )
    data = mujoco.MjData(model)
    compute_poses(model, data)
    graph, _ = record_scene(model, [data], [0.0], SceneContentSettings(mujoco.MjvOption()))
    solid, thin = (node.material.texture for node in graph.nodes if node.material)
    assert solid
    assert thin
    assert solid.pixels.shape == (2, 2, 3)
    assert (thin.pixels[..., 3] == 7).all()


def test_a_texture_is_made_once() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    surfaces = MaterialCache(model)
    assert surfaces.texture(0) is surfaces.texture(0)
    assert surfaces.texture(0).pixels.shape == (4, 4, 3)
    assert TextureMapping(0, "planar", (1.0, 1.0)).applied(meshes.box(), 0).uv is not None
