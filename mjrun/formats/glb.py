"""Binary glTF files of scenes, with the motion of their nodes.

The format: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html. Its y axis points up, so that the node of the
world is turned; all nodes below have MuJoCo's axes.
"""

import json
import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from mjrun.errors import UsageError
from mjrun.formats.image_encoding import UINT16_MAX, ImageData, png
from mjrun.scene_graph.graph import (
    CameraLens,
    Deformation,
    Material,
    Mesh,
    Node,
    SceneGraph,
    SceneLight,
    SceneMotion,
    Skin,
    Texture,
)

MAGIC, VERSION, JSON, BIN = b"glTF", 2, 0x4E4F534A, 0x004E4942
FLOAT, UINT16, UINT32 = 5126, 5123, 5125
VERTICES, INDICES = 34962, 34963  # uses of a buffer
LIGHTS = "KHR_lights_punctual"
Z_UP = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # turns z up into y up
UNITS = {"length": "m", "mass": "kg", "time": "s", "angle": "rad"}
LARGEST = 2**32 - 1  # bytes of a file
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
LINES = 1  # mode of a primitive


def write_glb(
    file: BinaryIO,
    graph: SceneGraph,
    motion: SceneMotion | None = None,
    facts: Mapping[str, object] | None = None,
    generator: str = "mjrun",
) -> list[str]:
    """Writes a scene, and its motion as one animation; returns remarks about what is left out.

    Numbers are rounded to float32, by at most 6e-8 of their size.

    Args:
      facts: additional information about the file, for programs that read it.

    Raises:
      UsageError: the file would be too large, or frames too close together for float32.
    """
    document = _Document(graph, motion)
    document.json["asset"] = {
        "version": "2.0",
        "generator": generator,
        "extras": {"units": UNITS, **(facts or {})},
    }
    text = json.dumps(document.json, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    binary = document.size
    whole = 12 + 8 + len(text) + ((8 + binary) if binary else 0)
    if whole > LARGEST:
        raise UsageError(
            f"the file would have {whole / 1e9:.1f} GB, and binary glTF is limited to {LARGEST / 1e9:.1f} GB\n"
            "export fewer frames per second, or a part of the simulation"
        )
    file.write(struct.pack("<4sII", MAGIC, VERSION, whole))
    file.write(struct.pack("<II", len(text), JSON) + text)
    if binary:
        file.write(struct.pack("<II", binary, BIN))
        for content in document.contents():
            file.write(content)
    shifted = [node.name for node in graph.nodes if node.lens is not None and any(node.lens.shift)]
    return [f"camera {name} is centred, since glTF has no principal points; USD has" for name in shifted]


class _Document:
    """The JSON of a file, and the contents of its buffer in order.

    Attributes:
      size: bytes of the buffer.
    """

    def __init__(self, graph: SceneGraph, motion: SceneMotion | None) -> None:
        self.json: dict[str, Any] = {}
        self.size = 0
        self._contents = list[Callable[[], bytes]]()
        self._indices: dict[tuple[str, object], int] = {}
        self._primitives: dict[Mesh, dict[str, Any]] = {}
        self._inputs: dict[bytes, int] = {}
        self._times = np.asarray(motion.times if motion else (), np.float32)
        self._samplers, self._channels = list[dict[str, Any]](), list[dict[str, Any]]()
        children: dict[int, list[int]] = {}
        roots = [index for index, node in enumerate(graph.nodes) if node.parent < 0 or node.skin is not None]
        for index, node in enumerate(graph.nodes):
            if node.skin is None:  # bodies move its vertices, and nothing moves its node
                children.setdefault(node.parent, []).append(index)
        shapes = {each.node: each for each in motion.deformations} if motion else {}
        self.json["nodes"] = [
            self._node(node, children.get(index, ()), shapes.get(index)) for index, node in enumerate(graph.nodes)
        ]
        self.json |= {"scene": 0, "scenes": [{"nodes": roots, **({"extras": {**graph.facts}} if graph.facts else {})}]}
        if motion is not None and len(motion.times):
            self._animate(motion)
        if "extensions" in self.json:
            self.json["extensionsUsed"] = sorted(self.json["extensions"])
        if self.size:
            self.json["buffers"] = [{"byteLength": self.size}]

    def contents(self) -> Iterator[bytes]:
        """Yields the contents of the buffer, each padded to 4 bytes."""
        for content in self._contents:
            part = content()
            yield part + bytes(-len(part) % 4)

    def _node(self, node: Node, children: Sequence[int], shapes: Deformation | None) -> dict[str, Any]:
        w, x, y, z = node.quaternion
        written: dict[str, Any] = {"name": node.name}
        if children:
            written["children"] = [*children]
        if node.kind == "world":
            written["rotation"] = Z_UP
        else:
            written |= _unless({"translation": [*node.position]}, [0.0, 0.0, 0.0])
            written |= _unless({"rotation": [x, y, z, w]}, [0.0, 0.0, 0.0, 1.0])
            written |= _unless({"scale": [*node.scale]}, [1.0, 1.0, 1.0])
        if node.mesh is not None:
            written["mesh"] = self._mesh(node.mesh, node.material, node.skin, shapes)
        if node.skin is not None:
            written["skin"] = self._skin(node.skin, node.name)
        if node.lens is not None:
            written["camera"] = self._add("cameras", _camera(node.lens, node.name))
        if node.light is not None:
            lights = self.json.setdefault("extensions", {}).setdefault(LIGHTS, {"lights": []})["lights"]
            lights.append(_light(node.light, node.name))
            written["extensions"] = {LIGHTS: {"light": len(lights) - 1}}
        extras: dict[str, Any] = {"kind": node.kind, "id": node.id}
        if node.layer:
            extras["layer"] = node.layer
        if not node.visible:
            extras["visible"] = False
        written["extras"] = {**extras, **node.facts}
        return written

    def _mesh(self, mesh: Mesh, material: Material | None, skin: Skin | None, shapes: Deformation | None) -> int:
        """Returns the index of a mesh with a material; meshes with several materials share their vertices."""

        def whole() -> dict[str, Any]:
            if mesh not in self._primitives:
                self._primitives[mesh] = self._primitive(mesh)
            primitive = {**self._primitives[mesh]}
            if material is not None:
                primitive["material"] = self._material(material)
            if skin is not None:
                joints = self._array(np.ascontiguousarray(skin.joints, np.uint16), VERTICES)
                weights = self._array(np.ascontiguousarray(skin.weights, np.float32), VERTICES)
                primitive["attributes"] = {**primitive["attributes"], "JOINTS_0": joints, "WEIGHTS_0": weights}
            if shapes is not None and len(shapes.frames) > 1:
                primitive["targets"] = [self._target(shapes, number) for number in range(1, len(shapes.frames))]
            return {"name": mesh.name, "primitives": [primitive]}

        return self._index("meshes", (mesh, material, skin, shapes), whole)

    def _primitive(self, mesh: Mesh) -> dict[str, Any]:
        vertices = {"POSITION": self._array(mesh.positions, VERTICES, limits=True)}
        if mesh.normals is not None:
            vertices["NORMAL"] = self._array(mesh.normals, VERTICES)
        if mesh.uv is not None:
            vertices["TEXCOORD_0"] = self._array(mesh.uv, VERTICES)
        index_type = np.uint16 if len(mesh.positions) < UINT16_MAX else np.uint32
        made = {"attributes": vertices, "indices": self._array(mesh.faces.ravel().astype(index_type), INDICES)}
        return made if mesh.faces.shape[1] == 3 else {**made, "mode": LINES}

    def _skin(self, skin: Skin, name: str) -> int:
        columns = skin.binds.transpose(0, 2, 1).reshape(-1, 16)  # in column-major order
        binds = self._array(np.ascontiguousarray(columns, np.float32))
        return self._add("skins", {"name": name, "joints": [*skin.nodes], "inverseBindMatrices": binds})

    def _target(self, shapes: Deformation, number: int) -> dict[str, int]:
        """Returns the difference of a shape from the first one."""
        positions = shapes.positions[number] - shapes.positions[0]
        normals = shapes.normals[number] - shapes.normals[0]
        return {"POSITION": self._array(positions, VERTICES, limits=True), "NORMAL": self._array(normals, VERTICES)}

    def _material(self, material: Material) -> int:
        def whole() -> dict[str, Any]:
            red, green, blue = (linear(part) for part in material.rgba[:3])
            alpha = min(max(material.rgba[3], 0.0), 1.0)
            surface: dict[str, Any] = {
                "baseColorFactor": [red, green, blue, alpha],
                "metallicFactor": min(max(material.metallic, 0.0), 1.0),
                "roughnessFactor": min(max(material.roughness, 0.0), 1.0),
            }
            made: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": surface}
            opaque = alpha >= 1
            if material.texture is not None:
                surface["baseColorTexture"] = {"index": self._texture(material.texture)}
                opaque = opaque and material.texture.pixels.shape[2] == 3
            if not opaque:
                made["alphaMode"] = "BLEND"
            if material.two_sided:
                made["doubleSided"] = True
            if material.emission > 0:
                made["emissiveFactor"] = [min(material.emission * part, 1.0) for part in (red, green, blue)]
                if material.texture is not None:
                    made["emissiveTexture"] = surface["baseColorTexture"]
            return made

        return self._index("materials", material, whole)

    def _texture(self, texture: Texture) -> int:
        def image() -> dict[str, Any]:
            content = png(ImageData(texture.pixels, 0, None, {}))
            return {"name": texture.name, "mimeType": "image/png", "bufferView": self._view(content)}

        def whole() -> dict[str, Any]:
            return {"source": self._index("images", texture, image), "sampler": self._index("samplers", "repeat", dict)}

        return self._index("textures", texture, whole)

    def _animate(self, motion: SceneMotion) -> None:
        """Adds an animation of everything that moves; its samplers share the times of the frames."""
        if np.any(np.diff(self._times) <= 0):
            last = float(motion.times[-1])
            raise UsageError(f"the frames up to {last:g} s are too close together for the times of binary glTF")
        every = np.arange(len(self._times))
        for column, node in enumerate(motion.nodes):
            parts = {"translation": motion.positions[:, column], "rotation": motion.quaternions[:, column]}
            self._add_channels(node, parts, every)
        for track in motion.tracks:
            parts = {"translation": track.positions, "rotation": track.quaternions, "scale": track.scales}
            self._add_channels(track.node, parts, track.frames, "LINEAR" if track.smooth else "STEP")
        for shapes in motion.deformations:
            if len(shapes.frames) > 1:
                weights = np.eye(len(shapes.frames), dtype=np.float32)[:, 1:]
                output = self._array(np.ascontiguousarray(weights).ravel())
                self._add_channel(shapes.node, "weights", shapes.frames, output, "LINEAR")
        if self._channels:
            self.json["animations"] = [{"name": "simulation", "samplers": self._samplers, "channels": self._channels}]

    def _add_channels(
        self, node: int, parts: Mapping[str, np.ndarray], frames: np.ndarray, interpolation: str = "LINEAR"
    ) -> None:
        """Adds the properties of a node that change."""
        for path, values in parts.items():
            if len(values) > 1 and np.any(values != values[0]):
                content = partial(_rotations if path == "rotation" else _float32, values)
                view = self._later(content, 4 * values.size)
                output = self._accessor(view, len(values), values.shape[1], FLOAT)
                self._add_channel(node, path, frames, output, interpolation)

    def _add_channel(self, node: int, path: str, frames: np.ndarray, output: int, interpolation: str) -> None:
        """Adds a property of a node, given the accessor of its values at some frames."""
        key = frames.tobytes()
        if key not in self._inputs:
            self._inputs[key] = self._array(self._times[frames], limits=True)
        sampler: dict[str, Any] = {"input": self._inputs[key], "output": output}
        sampler["interpolation"] = interpolation
        if len(frames) < len(self._times):
            sampler["extras"] = {"frames": frames.tolist()}  # for viewers that play by frame
        self._channels.append({"sampler": len(self._samplers), "target": {"node": node, "path": path}})
        self._samplers.append(sampler)

    def _array(self, values: np.ndarray, target: int | None = None, limits: bool = False) -> int:
        """Adds an array; returns the index of its accessor."""
        kinds = {np.dtype(np.float32): FLOAT, np.dtype(np.uint16): UINT16, np.dtype(np.uint32): UINT32}
        width = 1 if values.ndim == 1 else values.shape[1]
        view = self._view(np.ascontiguousarray(values).tobytes(), target)
        accessor = self._accessor(view, len(values), width, kinds[values.dtype])
        if limits:
            low, high = values.min(axis=0), values.max(axis=0)
            self.json["accessors"][accessor] |= {"min": np.ravel(low).tolist(), "max": np.ravel(high).tolist()}
        return accessor

    def _accessor(self, view: int, count: int, width: int, component: int) -> int:
        return self._add(
            "accessors", {"bufferView": view, "componentType": component, "count": count, "type": WIDTHS[width]}
        )

    def _view(self, content: bytes, target: int | None = None) -> int:
        return self._later(lambda: content, len(content), target)

    def _later(self, content: Callable[[], bytes], size: int, target: int | None = None) -> int:
        """Adds bytes that are made when they are written; returns the index of their part of the buffer."""
        view = {"buffer": 0, "byteOffset": self.size, "byteLength": size}
        self._contents.append(content)
        self.size += size + -size % 4
        return self._add("bufferViews", view if target is None else {**view, "target": target})

    def _add(self, name: str, value: dict[str, Any]) -> int:
        values = self.json.setdefault(name, [])
        values.append(value)
        return len(values) - 1

    def _index(self, name: str, key: object, make: Callable[[], dict[str, Any]]) -> int:
        """Returns the index of the object `key` in a list, which is made the first time."""
        if (name, key) not in self._indices:
            self._indices[name, key] = self._add(name, make())
        return self._indices[name, key]


def xyzw(quaternions: np.ndarray) -> np.ndarray:
    """Returns quaternions `(n, 4)` in the order of glTF, of length 1, without jumps to the opposite sign."""
    turned = quaternions[:, [1, 2, 3, 0]] / np.linalg.norm(quaternions, axis=1, keepdims=True)
    jumps = np.sum(turned[1:] * turned[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(jumps, -1.0, 1.0)]).cumprod()
    return turned * signs[:, None]


def linear(value: float) -> float:
    """Returns the light of an sRGB value, both from 0 to 1. https://www.w3.org/TR/css-color-4/#color-conversion-code"""
    value = min(max(value, 0.0), 1.0)
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def _rotations(quaternions: np.ndarray) -> bytes:
    return _float32(xyzw(quaternions))


def _float32(values: np.ndarray) -> bytes:
    return np.ascontiguousarray(values, np.float32).tobytes()


def _unless(written: dict[str, Any], default: Sequence[float]) -> dict[str, Any]:
    """Returns a property of a node, unless it has its default."""
    return {name: value for name, value in written.items() if value != default}


def _camera(lens: CameraLens, name: str) -> dict[str, Any]:
    if lens.orthographic:
        half = lens.fovy / 2
        shape = {"xmag": half * lens.aspect, "ymag": half, "znear": lens.near, "zfar": lens.far}
        return {"name": name, "type": "orthographic", "orthographic": shape}
    shape = {"yfov": lens.fovy, "aspectRatio": lens.aspect, "znear": lens.near, "zfar": lens.far}
    return {"name": name, "type": "perspective", "perspective": shape}


def _light(light: SceneLight, name: str) -> dict[str, Any]:
    color = [linear(part) for part in light.color]
    made: dict[str, Any] = {"name": name, "type": light.kind, "color": color, "intensity": light.intensity}
    if light.range > 0 and light.kind != "directional":
        made["range"] = light.range
    if light.kind == "spot":
        made["spot"] = {"outerConeAngle": min(light.cutoff, math.pi / 2)}
    return made
