"""A LEAPP package of two networks, as leapp 0.7 writes them: one of features, and one of joints with memory."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from onnx import helper

from tests.policy.networks import value, write

INITIAL = np.array([[0.5, -0.5]], np.float32)
GAIN = np.array([[2.0, 0.0], [0.0, 3.0]], np.float32)
# The tensors as `yaml.dump` of leapp's writes them, but for the sums of the files.
PACKAGE = """
models:
  observer:
    inputs:
    - {{name: quaternion, dtype: float32, shape: [1, 4], type: tensor, kind: state/body/rotation, element_names: [[qx, qy, qz, qw]]}}
    outputs:
    - {{name: features, dtype: float32, shape: [1, 2], type: tensor}}
    parameters: {{model_path: observer.onnx, md5sum: '', sha256sum: {observer}, backend: onnx, warp_segments: 0}}
  policy:
    inputs:
    - {{name: joint_pos, dtype: float32, shape: [1, 2], type: tensor, kind: state/joint/position, element_names: [[hip, knee]]}}
    - {{name: features, dtype: float32, shape: [1, 2], type: tensor}}
    - {{name: memory_in, dtype: float32, shape: [1, 2], type: tensor}}
    outputs:
    - {{name: target, dtype: float32, shape: [1, 2], type: tensor, kind: target/joint/position, element_names: [[hip, knee]]}}
    - {{name: memory_out, dtype: float32, shape: [1, 2], type: tensor}}
    - {{name: kp, dtype: float32, shape: [1, 2], type: tensor, kind: kp, element_names: [[hip, knee]]}}
    - {{name: kd, dtype: float32, shape: [1, 2], type: tensor, kind: kd, element_names: [[hip, knee]]}}
    parameters: {{model_path: policy.onnx, md5sum: '', sha256sum: {policy}, backend: onnx, warp_segments: 0}}

pipeline:
  configs:
    frequency: 50.0
  data_flow:
    observer/features: [policy/features]
  feedback_flow:
    policy/memory_out: [policy/memory_in]
  initial_values: walk_initial_values.safetensors
  inputs:
    observer: [quaternion]
    policy: [joint_pos]
  outputs:
    policy: [target, kp, kd]

system information:
  leapp version: 0.7.2
"""  # noqa: E501


def tensors(path: Path, arrays: Mapping[str, np.ndarray]) -> Path:
    """A file of float32 in the format safetensors."""
    header, end = {}, 0
    for name, array in arrays.items():
        header[name] = {"dtype": "F32", "shape": array.shape, "data_offsets": [end, end + array.nbytes]}
        end += array.nbytes
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + b"".join(each.tobytes() for each in arrays.values()))
    return path


def package(folder: Path, change: Callable[[str], str] = str) -> Path:
    """A package; `change` alters the text of its description."""
    folder.mkdir(exist_ok=True)
    select = np.array([[1, 0], [0, 1], [0, 0], [0, 0]], np.float32)
    write(
        folder / "observer.onnx",
        [helper.make_node("MatMul", ["quaternion", "w"], ["features"])],
        [value("quaternion", [1, 4])],
        [value("features", [1, 2])],
        {"w": select},
    )
    nodes = [
        helper.make_node("MatMul", ["joint_pos", "w"], ["pulled"]),
        helper.make_node("Add", ["pulled", "features"], ["sum"]),
        helper.make_node("Add", ["sum", "memory_in"], ["target"]),
        helper.make_node("Identity", ["target"], ["memory_out"]),
        helper.make_node("Identity", ["gains"], ["kp"]),
        helper.make_node("Identity", ["brakes"], ["kd"]),
    ]
    weights = {"w": GAIN, "gains": np.array([[20, 30]], np.float32), "brakes": np.array([[1, 1.5]], np.float32)}
    inputs = [value(name, [1, 2]) for name in ("joint_pos", "features", "memory_in")]
    outputs = [value(name, [1, 2]) for name in ("target", "memory_out", "kp", "kd")]
    write(folder / "policy.onnx", nodes, inputs, outputs, weights)
    tensors(folder / "walk_initial_values.safetensors", {"policy/memory_in": INITIAL})
    sums = {name: hashlib.sha256((folder / f"{name}.onnx").read_bytes()).hexdigest() for name in ("observer", "policy")}
    path = folder / "walk.yaml"
    path.write_text(change(PACKAGE.format(**sums)))
    return path
