"""Theorems about USD files, read back and validated by OpenUSD itself."""

import io
import math
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats.usd import write_usd
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
from mjrun.scene_graph.recorder import SceneContentSettings, compute_poses, record_scene
from tests.processes import largest_file

RED = Material("red", (1.0, 0.0, 0.0, 0.5), 0.25, 0.75)
BALL = meshes.sphere(8, 8)
PLAIN = replace(BALL, uv=None)
NODES = [
    Node("world", "world", 0, -1),
    Node("body 1", "body", 1, 0, (1.0, 2.0, 3.0), moves=True),
    Node("ball", "geom", 0, 1, (0.0, 0.0, 1.0), scale=(0.1, 0.2, 0.3), mesh=PLAIN, material=RED),
    Node("ball", "geom", 1, 0, mesh=PLAIN, material=RED),
    Node("eye", "camera", 0, 1, lens=CameraLens(0.8, 1.5, 0.01, 50)),
    Node("sun", "light", 0, 0, light=SceneLight("directional", (1.0, 1.0, 1.0), 3.0)),
    Node("lamp", "light", 1, 0, light=SceneLight("spot", (1.0, 1.0, 1.0), 3.0, cutoff=0.5)),
]
TIMES = np.arange(4) * 1001 / 30000
POSITIONS = np.array([[[0.1 * k, 1.0, 1 / 3]] for k in range(4)])
QUATERNIONS = np.array([[[np.cos(k), np.sin(k), 0, 0]] for k in range(4)])
MOTION = SceneMotion(TIMES, [1], POSITIONS, QUATERNIONS)


def stage_of(
    folder: Path, graph: SceneGraph, motion: SceneMotion = MOTION, suffix: str = ".usdc"
) -> tuple[Any, list[str]]:
    """Writes a scene; returns the stage that OpenUSD reads, and the remarks."""
    from pxr import Usd

    file = io.BytesIO()
    remarks = write_usd(file, suffix, graph, motion, 30000 / 1001, {"model": "m.xml"})
    (folder / f"a{suffix}").write_bytes(file.getvalue())
    return Usd.Stage.Open(str(folder / f"a{suffix}")), remarks


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_a_file_that_cannot_be_written_is_reported(suffix: str) -> None:
    problem = r"scene\.usd.: cannot be written: .*File too large"
    with largest_file(1000), pytest.raises(FileError, match=problem) as caught:
        write_usd(io.BytesIO(), suffix, SceneGraph(NODES), MOTION, 30, {})
    assert caught.value.__notes__ == ["set TMPDIR to another folder"]


def place(stage: Any, path: str, frame: float) -> np.ndarray:
    """Returns the transformation from an object to the world `(4, 4)` at a frame."""
    from pxr import Usd, UsdGeom

    prim = UsdGeom.Xformable(stage.GetPrimAtPath(path))
    return np.array(prim.ComputeLocalToWorldTransform(Usd.TimeCode(frame))).T


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_time_codes_are_frames_at_any_rate(tmp_path: Path, suffix: str) -> None:
    from pxr import Gf, UsdGeom

    stage, _ = stage_of(tmp_path, SceneGraph(NODES), suffix=suffix)
    assert stage.GetTimeCodesPerSecond() == 30000 / 1001
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 3)
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 1)
    for frame, (position, quaternion) in enumerate(zip(POSITIONS[:, 0], QUATERNIONS[:, 0], strict=True)):
        found = place(stage, "/World/body_1", frame)
        turn = Gf.Matrix3d(Gf.Rotation(Gf.Quatd(*quaternion.tolist())))
        assert np.allclose(found[:3, 3], position, atol=1e-12)
        assert np.allclose(found[:3, :3], np.array(turn).T, atol=1e-6)
    assert np.allclose(place(stage, "/World/body_1", 0.5)[:3, 3], (POSITIONS[0, 0] + POSITIONS[1, 0]) / 2)


def test_nothing_in_it_is_invalid(tmp_path: Path) -> None:
    from pxr import UsdValidation

    stage, _ = stage_of(tmp_path, SceneGraph(NODES), suffix=".usdz")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []


def test_geoms_share_vertices_and_keep_their_names(tmp_path: Path) -> None:
    from pxr import UsdGeom

    stage, _ = stage_of(tmp_path, SceneGraph(NODES))
    first, second = (stage.GetPrimAtPath(path) for path in ("/World/body_1/ball", "/World/ball"))
    assert first.GetDisplayName() == second.GetDisplayName() == "ball"
    assert stage.GetPrimAtPath("/World/body_1").GetDisplayName() == "body 1"
    assert first.GetCustomDataByKey("mjrun") == {"kind": "geom", "id": 0}
    for prim in (first, second):
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get())
        assert np.array_equal(points, BALL.positions)
    assert len([prim for prim in stage.TraverseAll() if prim.GetParent().GetPath() == "/Meshes"]) == 1
    corner = place(stage, "/World/body_1/ball", 0) @ [1, 0, 0, 1]
    assert np.allclose(corner[:3], POSITIONS[0, 0] + (0.1, 0, 1), atol=1e-6)


def test_materials_cameras_and_lights_are_read_back(tmp_path: Path) -> None:
    from pxr import Gf, UsdGeom, UsdLux, UsdShade

    stage, _ = stage_of(tmp_path, SceneGraph(NODES))
    material = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/ball")).ComputeBoundMaterial()[0]
    inputs = {each.GetBaseName(): each.Get() for each in material.ComputeSurfaceSource()[0].GetInputs()}
    assert inputs == {"diffuseColor": Gf.Vec3f(1, 0, 0), "opacity": 0.5, "metallic": 0.25, "roughness": 0.75}

    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/body_1/eye")).GetCamera(0)
    assert math.radians(camera.GetFieldOfView(Gf.Camera.FOVVertical)) == pytest.approx(0.8, abs=1e-6)
    assert camera.aspectRatio == pytest.approx(1.5)
    assert UsdLux.DistantLight(stage.GetPrimAtPath("/World/sun")).GetIntensityAttr().Get() == 3
    lamp = stage.GetPrimAtPath("/World/lamp")
    assert UsdLux.ShapingAPI(lamp).GetShapingConeAngleAttr().Get() == pytest.approx(math.degrees(0.5))


def test_textures_are_in_packages_and_elsewhere_their_mean(tmp_path: Path) -> None:
    from pxr import UsdGeom, UsdShade

    pixels = np.zeros((4, 4, 3), np.uint8)
    pixels[:2] = 255
    material = Material("checker", (1.0, 1.0, 1.0, 1.0), 0.0, 0.5, texture=Texture("checker", pixels))
    graph = SceneGraph([NODES[0], Node("ball", "geom", 0, 0, mesh=BALL, material=material)])
    package, remarks = stage_of(tmp_path, graph, suffix=".usdz")
    assert remarks == []
    image = UsdShade.Shader(package.GetPrimAtPath("/World/Looks/checker/diffuseColorImage"))
    assert image.GetInput("file").Get().resolvedPath.endswith("a.usdz[texture_0.png]")
    st = np.array(UsdGeom.PrimvarsAPI(package.GetPrimAtPath("/World/ball")).GetPrimvar("st").Get())
    assert np.allclose(st, np.asarray(BALL.uv) * (1, -1) + (0, 1), atol=1e-6)

    with largest_file(20), pytest.raises(FileError, match="cannot hold temporary files: File too large\nset TMPDIR"):
        write_usd(io.BytesIO(), ".usdz", graph, MOTION, 30, {})
    plain, remarks = stage_of(tmp_path, graph)
    assert len(remarks) == 1
    assert ".usdz" in remarks[0]
    surface = UsdShade.Shader(plain.GetPrimAtPath("/World/Looks/checker/surface"))
    assert np.allclose(surface.GetInput("diffuseColor").Get(), 0.5)


def test_the_opacity_of_a_texture_multiplies_that_of_its_material(tmp_path: Path) -> None:
    from pxr import UsdShade

    texture = Texture("glass", np.array([[(255, 0, 0, 0), (255, 0, 0, 51)]], np.uint8))
    material = Material("glass", (1.0, 1.0, 1.0, 0.5), 0.0, 0.5, emission=0.5, texture=texture)
    graph = SceneGraph([NODES[0], Node("ball", "geom", 0, 0, mesh=BALL, material=material)])
    plain, _ = stage_of(tmp_path, graph)
    surface = UsdShade.Shader(plain.GetPrimAtPath("/World/Looks/glass/surface"))
    assert surface.GetInput("opacity").Get() == pytest.approx(0.5 * 0.1)

    package, _ = stage_of(tmp_path, graph, suffix=".usdz")
    surface = UsdShade.Shader(package.GetPrimAtPath("/World/Looks/glass/surface"))
    (source,), _ = surface.GetInput("opacity").GetConnectedSources()
    assert source.sourceName == "a"
    assert tuple(UsdShade.Shader(source.source).GetInput("scale").Get()) == (1, 1, 1, 0.5)


def test_a_texture_is_on_the_light_that_a_material_emits(tmp_path: Path) -> None:
    from pxr import UsdShade

    texture = Texture("dark", np.zeros((4, 4, 3), np.uint8))
    material = Material("lamp", (1.0, 1.0, 1.0, 1.0), 0.0, 0.5, emission=0.5, texture=texture)
    graph = SceneGraph([NODES[0], Node("ball", "geom", 0, 0, mesh=BALL, material=material)])
    plain, _ = stage_of(tmp_path, graph)
    surface = UsdShade.Shader(plain.GetPrimAtPath("/World/Looks/lamp/surface"))
    assert tuple(surface.GetInput("emissiveColor").Get()) == (0, 0, 0)

    package, _ = stage_of(tmp_path, graph, suffix=".usdz")
    surface = UsdShade.Shader(package.GetPrimAtPath("/World/Looks/lamp/surface"))
    (source,), _ = surface.GetInput("emissiveColor").GetConnectedSources()
    image = UsdShade.Shader(source.source)
    assert image.GetInput("file").Get().resolvedPath.endswith("a.usdz[texture_0.png]")
    assert tuple(image.GetInput("scale").Get()) == (0.5, 0.5, 0.5, 1)


def test_rotations_are_exact_to_more_digits_than_float32(tmp_path: Path) -> None:
    from pxr import UsdGeom

    angles = np.array([1e-4, 3e-4, 5e-4, 7e-4])
    turns = np.stack([np.cos(angles / 2), np.sin(angles / 2), 0 * angles, 0 * angles], axis=1)
    held = Node("held", "body", 2, 0, quaternion=tuple(turns[3].tolist()))
    stage, _ = stage_of(tmp_path, SceneGraph([*NODES, held]), replace(MOTION, quaternions=turns[:, None]))

    def angle(path: str, frame: int) -> float:
        matrix = UsdGeom.XformCache(frame).GetLocalToWorldTransform(stage.GetPrimAtPath(path))
        return math.atan2(matrix[1][2], matrix[1][1])

    assert [angle("/World/body_1", frame) for frame in range(4)] == pytest.approx(angles, abs=1e-7)
    assert angle("/World/held", 0) == pytest.approx(angles[3], abs=1e-7)


def test_a_package_does_not_depend_on_the_time_of_day(tmp_path: Path) -> None:
    stage, _ = stage_of(tmp_path, SceneGraph(NODES), suffix=".usdz")
    assert stage.GetPrimAtPath("/World/ball")
    with zipfile.ZipFile(tmp_path / "a.usdz") as package:
        assert {entry.date_time for entry in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_package_that_is_cut_off_is_an_error() -> None:
    file = io.BytesIO()
    write_usd(file, ".usdz", SceneGraph(NODES), MOTION, 30, {})
    with largest_file(len(file.getvalue()) - 20), pytest.raises(FileError, match="cannot be written"):
        write_usd(io.BytesIO(), ".usdz", SceneGraph(NODES), MOTION, 30, {})


def test_what_comes_and_goes_is_invisible_meanwhile_and_does_not_glide(tmp_path: Path) -> None:
    from pxr import UsdGeom

    blinking = Track(
        3, np.array([0, 1, 3]), np.eye(3), np.eye(4)[[0, 0, 0]], np.array([[0] * 3, [2] * 3, [0] * 3]), False
    )
    stage, _ = stage_of(tmp_path, SceneGraph(NODES), replace(MOTION, tracks=[blinking]))
    shown = UsdGeom.Imageable(stage.GetPrimAtPath("/World/ball"))
    assert [shown.ComputeVisibility(frame) for frame in range(4)] == [
        "invisible",
        "inherited",
        "inherited",
        "invisible",
    ]
    assert np.allclose(place(stage, "/World/ball", 2)[:3, 3], (0, 1, 0))


def test_vertices_that_move_have_samples_and_skins_are_left_out(tmp_path: Path) -> None:
    from pxr import UsdGeom

    grown = np.stack([BALL.positions, 2 * BALL.positions])
    normals = np.stack([np.asarray(BALL.normals)] * 2)
    motion = replace(MOTION, deformations=[Deformation(3, np.array([0, 3]), grown, normals)])
    count = len(BALL.positions)
    skin = Skin([1], np.eye(4)[None], np.zeros((count, 4), int), np.eye(4)[np.zeros(count, int)])
    nodes = [*NODES, Node("fur", "skin", 0, 0, mesh=BALL, skin=skin)]
    stage, remarks = stage_of(tmp_path, SceneGraph(nodes), motion)
    ball = UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
    assert np.allclose(ball.GetPointsAttr().Get(1.5), 1.5 * BALL.positions, atol=1e-6)
    for frame in (0.0, 1.5, 3.0):
        around = UsdGeom.Boundable.ComputeExtentFromPlugins(ball, frame)
        assert np.allclose(ball.GetExtentAttr().Get(frame), around, atol=1e-6)
    assert [remark for remark in remarks if "fur" in remark]


def test_lines_are_left_out_with_a_remark(tmp_path: Path) -> None:
    rays = [Node(f"ray {number}", "decoration", -1, 0, mesh=meshes.line(), material=RED) for number in range(2)]
    _, remarks = stage_of(tmp_path, SceneGraph([*NODES, *rays]))
    assert [".glb" in remark for remark in remarks] == [True]


@pytest.mark.parametrize("name", ['"}\n<script>', "x" * 300, "1st/../body", "ÄÖ", ""])
def test_any_name_is_a_name(tmp_path: Path, name: str) -> None:
    stage, _ = stage_of(
        tmp_path, SceneGraph([*NODES, Node(name, "body", 2, 0), Node(name, "body", 3, 0)]), suffix=".usda"
    )
    assert [prim.GetDisplayName() for prim in stage.Traverse()].count(name) >= 2


def test_siblings_with_one_identifier_are_numbered_from_2(tmp_path: Path) -> None:
    names = ["a b", "a_b", "a-b", "Looks"]
    nodes = [NODES[0], *(Node(name, "body", i, 0) for i, name in enumerate(names, 1))]
    stage, _ = stage_of(tmp_path, SceneGraph(nodes))
    paths = {str(prim.GetPath()): prim.GetDisplayName() for prim in stage.GetPrimAtPath("/World").GetChildren()}
    assert paths == {"/World/a_b": "a b", "/World/a_b_2": "a_b", "/World/a_b_3": "a-b", "/World/Looks_2": "Looks"}


def test_a_camera_with_intrinsics_sees_points_where_mujocos_camera_does(tmp_path: Path) -> None:
    from pxr import Gf, Usd, UsdGeom

    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom size=".1"/><camera name="eye" pos="0 -2 1" xyaxes="1 0 0 0 .4 .9"
        resolution="320 240" focalpixel="250 300" principalpixel="20 -10" sensorsize=".032 .024"/></worldbody>
        </mujoco>"""
    )
    data = mujoco.MjData(model)
    compute_poses(model, data)
    stage, _ = stage_of(tmp_path, *record_scene(model, [data], [0.0], SceneContentSettings(mujoco.MjvOption())))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/World/eye")).GetCamera(Usd.TimeCode(0)).frustum
    seen = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    for point in np.eye(3) * 0.3:
        across, down, _ = seen.Transform(Gf.Vec3d(*point.tolist())) * 0.5
        x, y, z = (point - data.cam_xpos[0]) @ data.cam_xmat[0].reshape(3, 3) * [1, -1, -1]
        expected = (160 - 20 + 250 * x / z, 120 + 10 + 300 * y / z)  # pixels, by MuJoCo's definition
        assert (320 * (0.5 + across), 240 * (0.5 - down)) == pytest.approx(expected, abs=1e-3)
