"""USD files of scenes, with the motion of their nodes: https://openusd.org.

The axes are MuJoCo's, z up, and lengths are in metres. Time code k is frame k, at any rate.
"""

import json
import math
import os
import shutil
import time
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils, Vt

from mjrun.errors import FileError, clean
from mjrun.formats.glb import linear, xyzw
from mjrun.formats.image_encoding import ImageData, png
from mjrun.formats.temporary_output import scratch_folder, temporary_file_errors
from mjrun.scene_graph.graph import (
    CameraLens,
    Deformation,
    Material,
    Mesh,
    Node,
    SceneGraph,
    SceneLight,
    SceneMotion,
    Texture,
)

PACKAGE = ".usdz"
ROOT, MESHES, LOOKS = "/World", "/Meshes", "/World/Looks"
FOCAL_LENGTH = 24.0  # of cameras with perspective, in tenths of a unit; only its ratio to the aperture matters
TENTHS = 10.0  # units of the aperture of orthographic cameras in a metre
LAMP = 0.01  # radius of lights with a place [m]
UNIMPORTANT = "Unable to set permissions"  # a warning about temporary files of confined processes
MODIFIED = (1980, 1, 1, 0, 0, 0, 0, 0, -1)  # local time of the files in a package: the same bytes at any time
LINES_LEFT_OUT = "lines, such as the rays of rangefinders, are left out; .glb holds them"
JUST_BEFORE = 1e-3  # frames before a change at which a value that does not move linearly is repeated


def write_usd(
    file: BinaryIO,
    suffix: str,
    graph: SceneGraph,
    motion: SceneMotion,
    fps: float,
    facts: Mapping[str, object],
) -> list[str]:
    """Writes a scene with its motion; returns remarks about what is left out.

    Args:
      suffix: `.usda` for text, `.usdc` or `.usd` for binary files, `.usdz` for a package with textures.
      fps: frames per second.
      facts: additional information about the file, for programs that read it.
    """
    with scratch_folder() as folder:
        messages = UsdUtils.CoalescingDiagnosticDelegate()  # which OpenUSD would print
        with temporary_file_errors():
            writer = _Writer(folder, graph, motion, fps, has_textures=suffix == PACKAGE)
        writer.stage.GetRootLayer().customLayerData = {"mjrun": json.dumps(facts, default=str)}
        whole = folder / f"scene{'.usdc' if suffix == PACKAGE else suffix}"
        try:
            writer.stage.GetRootLayer().Export(str(whole))
            if suffix == PACKAGE:
                whole = _package([whole, *sorted(folder.glob("*.png"))], folder / f"scene{PACKAGE}")
        except Tf.ErrorException as error:
            raise FileError(whole, f"cannot be written: {clean(error.args[0].commentary)}") from error
        with whole.open("rb") as source:
            shutil.copyfileobj(source, file)
        texts = [clean(each.commentary) for each in messages.TakeUncoalescedDiagnostics()]
        return [*writer.remarks, *(text for text in texts if UNIMPORTANT not in text)]


class _Writer:
    """The stage of a scene.

    Attributes:
      stage: the stage.
      remarks: sentences about what is left out.
    """

    def __init__(self, folder: Path, graph: SceneGraph, motion: SceneMotion, fps: float, *, has_textures: bool) -> None:
        self.remarks = list[str]()
        self._folder, self._has_textures = folder, has_textures
        self.stage = stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(fps)
        stage.SetFramesPerSecond(fps)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(len(motion.times) - 1)
        self._meshes: dict[Mesh, Any] = {}
        self._looks: dict[Material, Any] = {}
        self._textures: dict[Texture, str] = {}
        self._names: dict[str, set[str]] = {}

        self._paths = list[str]()
        deformed = {shapes.node: shapes for shapes in motion.deformations}
        for index, node in enumerate(graph.nodes):
            self._paths.append(self._add(index, node, deformed.get(index)))
        stage.SetDefaultPrim(stage.GetPrimAtPath(ROOT))
        self._animate(graph, motion)

    def _add(self, index: int, node: Node, shapes: Deformation | None) -> str:
        """Adds a node; returns its path."""
        above = "" if node.parent < 0 else self._paths[node.parent]
        path = ROOT if node.parent < 0 else self._unique(above, node.name)
        if node.lens is not None:
            prim = _camera(UsdGeom.Camera.Define(self.stage, path), node.lens)
        elif node.light is not None:
            prim = self._light(path, node.light)
        elif node.skin is not None:
            self.remarks.append(f"skin {node.name} is left out; .glb holds skins")
            prim = UsdGeom.Xform.Define(self.stage, path)
        elif node.mesh is not None and node.mesh.normals is not None:
            prim = UsdGeom.Mesh.Define(self.stage, path)
            self._set_mesh(prim, node, shapes)
        else:
            if node.mesh is not None and LINES_LEFT_OUT not in self.remarks:
                self.remarks.append(LINES_LEFT_OUT)
            prim = UsdGeom.Xform.Define(self.stage, path)
        _pose(prim, node)
        if not node.visible:
            prim.CreateVisibilityAttr(UsdGeom.Tokens.invisible)
        described = prim.GetPrim()
        described.SetDisplayName(node.name)
        described.SetCustomDataByKey("mjrun", {"kind": node.kind, "id": node.id})
        return path

    def _set_mesh(self, prim: Any, node: Node, shapes: Deformation | None) -> None:
        """Lets a mesh refer to the vertices that it shares with others, or gives it separate vertices."""
        mesh = node.mesh
        assert mesh is not None
        if shapes is not None:
            _set_vertices(prim, mesh)
            points, normals, extent = prim.GetPointsAttr(), prim.GetNormalsAttr(), prim.GetExtentAttr()
            for frame, positions, turned in zip(shapes.frames, shapes.positions, shapes.normals, strict=True):
                points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(positions)), float(frame))
                normals.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(turned)), float(frame))
                extent.Set(_extent(positions), float(frame))
        else:
            if mesh not in self._meshes:
                place = self._unique(MESHES, mesh.name)
                self.stage.CreateClassPrim(MESHES)
                self._meshes[mesh] = UsdGeom.Mesh(self.stage.DefinePrim(place, "Mesh"))
                _set_vertices(self._meshes[mesh], mesh)
            prim.GetPrim().GetReferences().AddInternalReference(self._meshes[mesh].GetPath())
        if node.material is not None:
            prim.CreateDoubleSidedAttr(node.material.two_sided)
            UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(self._look(node.material))

    def _look(self, material: Material) -> Any:
        """Returns a material, made the first time."""
        if material in self._looks:
            return self._looks[material]
        look = UsdShade.Material.Define(self.stage, self._unique(LOOKS, material.name))
        shader = UsdShade.Shader.Define(self.stage, look.GetPath().AppendChild("surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        color, texture = np.array([linear(part) for part in material.rgba[:3]]), material.texture
        opacity = float(np.clip(material.rgba[3], 0, 1))
        inputs = {"opacity": opacity, "metallic": material.metallic, "roughness": material.roughness}
        for name, value in inputs.items():
            shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(float(np.clip(value, 0, 1)))
        if texture is not None and texture.pixels.shape[2] == 4:
            made = shader.GetInput("opacity")
            if self._has_textures:
                image = self._image(look, texture, "diffuseColorImage", np.array([*color, opacity]))
                made.ConnectToSource(image.CreateOutput("a", Sdf.ValueTypeNames.Float))
            else:
                made.Set(opacity * float(texture.pixels[..., 3].mean()) / 255)
        colors = {"diffuseColor": color}
        if material.emission > 0:
            colors["emissiveColor"] = np.clip(material.emission * color, 0, 1)
        for name, factor in colors.items():
            made = shader.CreateInput(name, Sdf.ValueTypeNames.Color3f)
            if texture is not None and self._has_textures:
                image = self._image(look, texture, f"{name}Image", np.array([*factor, opacity]))
                made.ConnectToSource(image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
            else:
                mean = np.ones(3) if texture is None else _mean_light(texture)
                made.Set(Gf.Vec3f(*(factor * mean).tolist()))
        if texture and not self._has_textures and not any("textures" in remark for remark in self.remarks):
            self.remarks.append(f"textures are replaced by their mean colours; {PACKAGE} holds them")
        look.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        self._looks[material] = look
        return look

    def _image(self, look: Any, texture: Texture, name: str, factors: np.ndarray) -> Any:
        """Returns the colours of a texture at the coordinates of a mesh, times factors of red, green, blue, opacity."""
        if texture not in self._textures:
            file = f"texture_{len(self._textures)}.png"
            (self._folder / file).write_bytes(png(ImageData(texture.pixels, 0, None, {})))
            self._textures[texture] = file
        reader = UsdShade.Shader.Define(self.stage, look.GetPath().AppendChild("coordinates"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        image = UsdShade.Shader.Define(self.stage, look.GetPath().AppendChild(name))
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(self._textures[texture]))
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        for side in ("wrapS", "wrapT"):
            image.CreateInput(side, Sdf.ValueTypeNames.Token).Set("repeat")
        image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*factors.tolist()))
        coordinates = image.CreateInput("st", Sdf.ValueTypeNames.Float2)
        coordinates.ConnectToSource(reader.CreateOutput("result", Sdf.ValueTypeNames.Float2))
        return image

    def _light(self, path: str, light: SceneLight) -> Any:
        """Returns a light; intensities are those of UsdLux, whose lights with a place are spheres."""
        if light.kind == "directional":
            made = UsdLux.DistantLight.Define(self.stage, path)
            made.CreateIntensityAttr(light.intensity)  # its illuminance, since it is normalized
        else:
            made = UsdLux.SphereLight.Define(self.stage, path)
            made.CreateRadiusAttr(LAMP)
            made.CreateTreatAsPointAttr(True)
            made.CreateIntensityAttr(4 * light.intensity)  # divided by its surface, it is seen as a disk
            if light.kind == "spot":
                shaping = UsdLux.ShapingAPI.Apply(made.GetPrim())
                shaping.CreateShapingConeAngleAttr(math.degrees(light.cutoff))
        made.CreateNormalizeAttr(True)
        made.CreateColorAttr(Gf.Vec3f(*(linear(part) for part in light.color)))
        return made

    def _animate(self, graph: SceneGraph, motion: SceneMotion) -> None:
        frames = range(len(motion.times))
        for column, node in enumerate(motion.nodes):
            self._move(node, frames, motion.positions[:, column], motion.quaternions[:, column])
        for track in motion.tracks:
            chosen, is_present = track.frames.tolist(), np.asarray(track.scales.any(axis=1))
            self._move(track.node, chosen, track.positions, track.quaternions, smooth=track.smooth)
            scales = np.where(is_present[:, None], track.scales, 1.0).tolist()
            self._sample(track.node, 2, chosen, [Gf.Vec3f(*each) for each in scales], track.smooth)
            if not is_present.all():
                shown = UsdGeom.Imageable(self.stage.GetPrimAtPath(self._paths[track.node])).CreateVisibilityAttr()
                for frame, present in zip(chosen, is_present.tolist(), strict=True):
                    shown.Set(UsdGeom.Tokens.inherited if present else UsdGeom.Tokens.invisible, frame)

    def _move(
        self, node: int, frames: Sequence[int], positions: np.ndarray, quaternions: np.ndarray, *, smooth: bool = True
    ) -> None:
        """Adds the poses of a node at some frames."""
        self._sample(node, 0, frames, [Gf.Vec3d(*each) for each in positions.tolist()], smooth)
        turns = [Gf.Quatd(w, x, y, z) for x, y, z, w in xyzw(quaternions).tolist()]
        self._sample(node, 1, frames, turns, smooth)

    def _sample(self, node: int, operation: int, frames: Sequence[int], values: Sequence[object], smooth: bool) -> None:
        """Sets the values of a transformation of a node at some frames, if they change."""
        if all(value == values[0] for value in values):
            return
        target = UsdGeom.Xformable(self.stage.GetPrimAtPath(self._paths[node])).GetOrderedXformOps()[operation]
        for number, (frame, value) in enumerate(zip(frames, values, strict=True)):
            if number and not smooth:
                target.Set(values[number - 1], frame - JUST_BEFORE)
            target.Set(value, float(frame))

    def _unique(self, above: str, name: str) -> str:
        """Returns the path of a new prim, whose name is made of letters, digits and underscores."""
        valid = Tf.MakeValidIdentifier(name) if name.isascii() else Tf.MakeValidIdentifier(ascii(name)[1:-1])
        used = self._names.setdefault(above, {"Looks"} if above == ROOT else set())
        chosen, number = valid, 1
        while chosen in used:
            number += 1
            chosen = f"{valid}_{number}"
        used.add(chosen)
        return f"{above}/{chosen}"


def _package(files: Sequence[Path], target: Path) -> Path:
    """Writes a package of files, of which the first is the scene; returns its path."""
    writer = Sdf.ZipFileWriter.CreateNew(str(target))
    modified = time.mktime(MODIFIED)
    for file in files:
        os.utime(file, (modified, modified))  # which the package stores
        writer.AddFile(str(file), file.name)
    if not (writer.Save() and _is_whole(target)):
        raise FileError(target, "the package cannot be written")
    return target


def _is_whole(package: Path) -> bool:
    """Returns whether a package can be read; OpenUSD ignores failed writes."""
    try:
        with zipfile.ZipFile(package) as archive:
            return archive.testzip() is None
    except (zipfile.BadZipFile, EOFError):
        return False


def _set_vertices(prim: Any, mesh: Mesh) -> None:
    """Sets the triangles of a mesh."""
    assert mesh.normals is not None
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.positions)))
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.normals)))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(mesh.faces)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray(mesh.faces.ravel().tolist()))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(_extent(mesh.positions))
    if mesh.uv is not None:  # counted from the last row of the texture
        st = np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]]).astype(np.float32)
        primvars = UsdGeom.PrimvarsAPI(prim)
        made = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
        made.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(st)))


def _extent(positions: np.ndarray) -> list[Any]:
    """Returns the lowest and the highest corner of the box around points `(n, 3)`."""
    return [Gf.Vec3f(*corner(positions, axis=0).tolist()) for corner in (np.min, np.max)]


def _pose(prim: Any, node: Node) -> None:
    """Sets translation, rotation and scale, in this order, so that motion can change each of them."""
    if node.parent < 0:
        return
    w, x, y, z = node.quaternion
    length = math.sqrt(w * w + x * x + y * y + z * z)
    prim.AddTranslateOp().Set(Gf.Vec3d(*node.position))
    turned = prim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)  # in float32, readers lose up to 4e-4 rad
    turned.Set(Gf.Quatd(w / length, x / length, y / length, z / length))
    prim.AddScaleOp().Set(Gf.Vec3f(*(node.scale if any(node.scale) else (1.0, 1.0, 1.0))))


def _camera(prim: Any, lens: CameraLens) -> Any:
    """Returns a camera with a lens."""
    if lens.orthographic:
        prim.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
        height = TENTHS * lens.fovy
    else:
        height = 2 * FOCAL_LENGTH * math.tan(lens.fovy / 2)
    prim.CreateFocalLengthAttr(FOCAL_LENGTH)
    prim.CreateVerticalApertureAttr(height)
    prim.CreateHorizontalApertureAttr(height * lens.aspect)
    prim.CreateHorizontalApertureOffsetAttr(height * lens.shift[0])
    prim.CreateVerticalApertureOffsetAttr(height * lens.shift[1])
    prim.CreateClippingRangeAttr(Gf.Vec2f(lens.near, lens.far))
    return prim


def _mean_light(texture: Texture) -> np.ndarray:
    """Returns the mean colour of a texture, as light from 0 to 1."""
    values = np.array([linear(value / 255) for value in range(256)])
    return values[texture.pixels[..., :3]].mean(axis=(0, 1))
