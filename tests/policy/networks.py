"""Small networks in ONNX."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from tests.policy.action_spaces import unbounded

OPSET, IR = 18, 9
TYPES = {np.float16: TensorProto.FLOAT16, np.float32: TensorProto.FLOAT, np.float64: TensorProto.DOUBLE}
LEFT_RIGHT = unbounded(["left", "right"])

Shape = Sequence[int | str | None]


def value(name: str, shape: Shape | None, kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


def write(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    inputs: Sequence[onnx.ValueInfoProto],
    outputs: Sequence[onnx.ValueInfoProto],
    weights: Mapping[str, np.ndarray] = {},
    metadata: Mapping[str, str] = {},
) -> Path:
    """A file with a network of `nodes`."""
    initializers = [numpy_helper.from_array(array, name) for name, array in weights.items()]
    graph = helper.make_graph(nodes, "policy", inputs, outputs, initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR)
    helper.set_model_props(model, dict(metadata))
    path.write_bytes(model.SerializeToString())
    return path


def linear(
    path: Path,
    weights: np.ndarray,
    *,
    names: tuple[str, str] = ("obs", "actions"),
    shape: Shape | None = None,
    bias: float = 0.0,
    metadata: Mapping[str, str] = {},
) -> Path:
    """A network whose action is `weights @ observation + bias`; `weights` is `(nact, nobs)`, of its tensors' type."""
    kind = TYPES[weights.dtype.type]
    count, size = weights.shape
    inputs = [value(names[0], [1, size] if shape is None else shape, kind)]
    nodes = [
        helper.make_node("MatMul", [names[0], "w"], ["product"]),
        helper.make_node("Add", ["product", "b"], [names[1]]),
    ]
    tensors = {"w": weights.T.copy(), "b": np.full(count, bias, weights.dtype)}
    return write(path, nodes, inputs, [value(names[1], [1, count], kind)], tensors, metadata)


def integrator(path: Path, *, ends: tuple[str, str] = ("h_in", "h_out"), size: int = 2) -> Path:
    """A recurrent network whose action is the sum of all observations so far."""
    nodes = [helper.make_node("Add", ["obs", ends[0]], [ends[1]]), helper.make_node("Identity", [ends[1]], ["actions"])]
    tensors = [value(name, [1, size]) for name in ("obs", ends[0], "actions", ends[1])]
    return write(path, nodes, tensors[:2], tensors[2:])
