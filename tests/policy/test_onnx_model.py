"""What onnxruntime may open, what it must refuse, and in which words."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper

from mjrun.errors import FileError, MissingExtraError, UsageError
from mjrun.policy.onnx_model import OnnxModel
from tests.policy.networks import linear, value, write

WEIGHTS = np.array([[1, 2, 3, 4], [0, 1, 0, -1]], np.float32)


def test_a_model_is_opened_and_run(tmp_path: Path) -> None:
    model = OnnxModel(linear(tmp_path / "a.onnx", WEIGHTS, metadata={"key": "text"}))
    assert [str(tensor) for tensor in (*model.inputs, *model.outputs)] == ["obs (1, 4)", "actions (1, 2)"]
    assert model.metadata == {"key": "text"}
    (action,) = model.run({"obs": np.ones((1, 4), np.float32)}, ["actions"])
    assert action.tolist() == [[10, 0]]


def test_onnxruntime_leaves_nothing_in_the_temporary_folder(tmp_path: Path) -> None:
    """Its telemetry, which is off, would leave a file there."""
    policy, temporary = linear(tmp_path / "a.onnx", WEIGHTS), tmp_path / "temporary"
    temporary.mkdir()
    code = "import sys; from pathlib import Path; from mjrun.policy.onnx_model import OnnxModel; "
    environment = {name: text for name, text in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    command = [sys.executable, "-c", code + "OnnxModel(Path(sys.argv[1]))", str(policy)]
    subprocess.run(command, env={**environment, "TMPDIR": str(temporary)}, check=True)
    assert list(temporary.iterdir()) == []


def damaged(content: bytes) -> bytes:
    return content[: len(content) // 2]


def misnamed(content: bytes) -> bytes:
    return content.replace(b"obs", b"\xff\xfe\xfd")  # no UTF-8


@pytest.mark.parametrize(
    "make", [damaged, misnamed, lambda _: b"", lambda _: b"no network" * 20, lambda c: b"PK\3\4" + c]
)
def test_what_is_no_model_or_a_damaged_one_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], make: Callable[[bytes], bytes]
) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS)
    path.write_bytes(make(path.read_bytes()))
    with pytest.raises(FileError, match="is no ONNX model, or a damaged one"):
        OnnxModel(path)
    assert capfd.readouterr() == ("", "")


def operator(model: onnx.ModelProto) -> None:
    model.graph.node[0].op_type = "Bad\x1b[31m"


def domain(model: onnx.ModelProto) -> None:
    model.graph.node[0].domain = "com.example"
    model.opset_import.append(helper.make_opsetid("com.example", 1))


def opset(model: onnx.ModelProto) -> None:
    model.opset_import[0].version = 99


def version(model: onnx.ModelProto) -> None:
    model.ir_version = 99


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (operator, r"it uses an operator that onnxruntime lacks: 'Bad\\x1b\[31m'"),
        (domain, "it uses an operator that onnxruntime lacks: 'com.example:MatMul'"),
        (opset, "it is written for a newer onnxruntime"),
        (version, "it is written for a newer onnxruntime"),
    ],
)
def test_what_onnxruntime_does_not_know_is_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], change: Callable[[onnx.ModelProto], None], message: str
) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS)
    model = onnx.load(path)
    change(model)
    path.write_bytes(model.SerializeToString())
    with pytest.raises(FileError, match=message) as error:
        OnnxModel(path)
    assert f"onnxruntime {onnxruntime.__version__}: " in str(error.value)
    assert "\x1b" not in str(error.value)
    assert "onnxruntime_src" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def elsewhere(location: str) -> TensorProto:
    """Weights in another file."""
    tensor = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[4, 2], data_location=TensorProto.EXTERNAL)
    entry = tensor.external_data.add()
    entry.key, entry.value = "location", location
    return tensor


def initialized(location: str) -> tuple[list[onnx.NodeProto], list[TensorProto]]:
    return [helper.make_node("MatMul", ["obs", "w"], ["actions"])], [elsewhere(location)]


def constant(location: str) -> tuple[list[onnx.NodeProto], list[TensorProto]]:
    node = helper.make_node("Constant", [], ["w"], value=elsewhere(location))
    return [node, helper.make_node("MatMul", ["obs", "w"], ["actions"])], []


def branch(location: str) -> tuple[list[onnx.NodeProto], list[TensorProto]]:
    nodes, weights = initialized(location)
    nodes[0].output[0] = "y"
    inner = helper.make_graph(nodes, "branch", [], [value("y", [1, 2])], weights)
    condition = helper.make_node("Constant", [], ["c"], value=helper.make_tensor("c", TensorProto.BOOL, [], [True]))
    return [condition, helper.make_node("If", ["c"], ["actions"], then_branch=inner, else_branch=inner)], []


@pytest.mark.parametrize("place", [initialized, constant, branch])
@pytest.mark.parametrize("location", ["../secret.bin", "ABSOLUTE", "link.bin", "inside/../../secret.bin"])
def test_weights_outside_of_the_folder_are_not_read(
    tmp_path: Path, place: Callable[[str], tuple[list[onnx.NodeProto], list[TensorProto]]], location: str
) -> None:
    secret, folder = tmp_path / "secret.bin", tmp_path / "policy"
    (folder / "inside").mkdir(parents=True)
    secret.write_bytes(WEIGHTS.T.tobytes())
    (folder / "link.bin").symlink_to("../secret.bin")
    nodes, weights = place(str(secret) if location == "ABSOLUTE" else location)
    path = write(folder / "a.onnx", nodes, [value("obs", [1, 4])], [value("actions", [1, 2])])
    model = onnx.load(path, load_external_data=False)
    model.graph.initializer.extend(weights)
    path.write_bytes(model.SerializeToString())
    with pytest.raises(FileError, match="its weights are in a file outside of its folder"):
        OnnxModel(path)


def test_weights_beside_it_are_read_and_missing_ones_are_told(tmp_path: Path) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS)
    model = onnx.load(path)
    onnx.save(model, path, save_as_external_data=True, location="a.bin", size_threshold=0)
    assert len(OnnxModel(path).inputs) == 1
    (tmp_path / "a.bin").unlink()
    with pytest.raises(FileError, match="the file with its weights is missing"):
        OnnxModel(path)


def test_a_pipe_or_a_folder_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.onnx")
    (tmp_path / "folder.onnx").mkdir()
    for name, reason in (("pipe", "not a regular file"), ("folder", "is a folder"), ("none", "no such file")):
        with pytest.raises(FileError, match=reason):
            OnnxModel(tmp_path / f"{name}.onnx")


def test_without_onnxruntime_the_error_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError, match=r"onnxruntime, which is not installed\npip install 'mjrun\[policy\]'"):
        OnnxModel(path)


def test_a_fault_while_computing_is_an_error_of_the_policy(tmp_path: Path) -> None:
    node = helper.make_node("Reshape", ["obs", "shape"], ["actions"])
    path = write(
        tmp_path / "a.onnx", [node], [value("obs", [1, "n"])], [value("actions", [1, 2])], {"shape": np.array([1, 2])}
    )
    with pytest.raises(UsageError, match=r"a\.onnx cannot be computed: .*Reshape"):
        OnnxModel(path).run({"obs": np.ones((1, 3), np.float32)}, ["actions"])
