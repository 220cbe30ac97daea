"""Binary glTF files as pygltflib reads them."""

from typing import Any

import numpy as np
import pygltflib

COMPONENTS = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def read_gltf(content: bytes) -> Any:
    """Returns a file as pygltflib reads it; `Any`, since its types say that everything may be missing."""
    return pygltflib.GLTF2.load_from_bytes(content)


def accessor(gltf: Any, index: int) -> np.ndarray:
    """Returns the numbers of an accessor, `(count, width)`."""
    described = gltf.accessors[index]
    width = WIDTHS[described.type]
    content = gltf.binary_blob()[gltf.bufferViews[described.bufferView].byteOffset :]
    numbers = np.frombuffer(content, COMPONENTS[described.componentType], described.count * width)
    return numbers.reshape(described.count, width)


def animated(gltf: Any, name: str) -> dict[str, np.ndarray]:
    """Returns the animated properties of a node, `{"translation": (frames, 3), …}`."""
    node = [each.name for each in gltf.nodes].index(name)
    (animation,) = gltf.animations
    channels = (channel for channel in animation.channels if channel.target.node == node)
    return {each.target.path: accessor(gltf, animation.samplers[each.sampler].output) for each in channels}
