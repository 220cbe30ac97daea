"""ONNX: networks are opened with care, and play with recurrent state, the same bits from the same inputs."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper

from mjrun.errors import FileError, MissingExtraError, UsageError
from mjrun.policy.loaders.onnx import OnnxModel, OnnxPolicy, TensorSpec, state_pairs, weight_files
from tests.policy.networks import LEFT_RIGHT, Shape, integrator, linear, value, write

WEIGHTS = np.array([[1, 2, 3, 4], [0, 1, 0, -1]], np.float32)
OBSERVATION = np.array([0.5, -1, 2, 8])


def acted(path: Path, observations: Sequence[np.ndarray]) -> list[list[float]]:
    actor = OnnxPolicy(path, str(path)).episode(0, LEFT_RIGHT)
    return [actor(observation).tolist() for observation in observations]


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("shape", [[4], [1, 4], [1, 1, 4], ["batch", 4], ["batch", "n"], [None, None]])
def test_the_action_is_that_of_the_network(tmp_path: Path, kind: type[np.floating], shape: Shape) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS.astype(kind), shape=shape)
    if shape != [1, 4]:  # what comes out has the shape of what goes in, not that which the file declares
        model = onnx.load(path)
        model.graph.output[0].type.tensor_type.ClearField("shape")
        path.write_bytes(model.SerializeToString())
    rows = [factor * OBSERVATION for factor in (1, -2, 0.5)]
    assert acted(path, rows) == [(WEIGHTS @ row).tolist() for row in rows]


@pytest.mark.parametrize(
    "names", [("obs", "actions"), ("obs", "continuous_actions"), ("observation", "mu"), ("x", "action")]
)
def test_one_input_and_one_output_need_no_names(tmp_path: Path, names: tuple[str, str]) -> None:
    policy = OnnxPolicy(linear(tmp_path / "a.onnx", WEIGHTS, names=names), "a.onnx")
    assert (policy.facts.observation_size, policy.facts.action_size) == (4, 2)
    assert policy.facts.observations is None
    assert policy.facts.control_dt is None


@pytest.mark.parametrize(
    "ends",
    [("h_in", "h_out"), ("state", "next_state"), ("h0", "hn"), ("recurrent_in", "recurrent_out"), ("c_0", "c_n"),
     ("stateIn", "stateOut"), ("state_in_0", "state_out_0")],
)  # fmt: skip
def test_memory_lasts_for_an_episode_and_no_longer(tmp_path: Path, ends: tuple[str, str]) -> None:
    policy = OnnxPolicy(integrator(tmp_path / "a.onnx", ends=ends), "a.onnx")
    assert policy.facts.observation_size == 2
    one, other = policy.episode(0, LEFT_RIGHT), policy.episode(1, LEFT_RIGHT)
    rows = np.arange(8.0).reshape(4, 2)
    for sums, row in zip(np.cumsum(rows, axis=0), rows, strict=True):
        assert one(row).tolist() == sums.tolist()  # side by side, and the one does not see the other
        assert other(2 * row).tolist() == (2 * sums).tolist()
    assert policy.episode(0, LEFT_RIGHT)(rows[1]).tolist() == rows[1].tolist()


def test_a_memory_that_fills_that_of_the_machine_is_refused(tmp_path: Path) -> None:
    ends = [value(name, [1, 2**45]) for name in ("h_in", "h_out")]
    nodes = [helper.make_node("Identity", pair[:1], pair[1:]) for pair in (["obs", "actions"], ["h_in", "h_out"])]
    inputs, outputs = [value("obs", [1, 2]), ends[0]], [value("actions", [1, 2]), ends[1]]
    path = write(tmp_path / "a.onnx", nodes, inputs, outputs)
    with pytest.raises(FileError, match="would expand to"):
        OnnxPolicy(path, "a.onnx").episode(0, LEFT_RIGHT)


def test_several_inputs_are_parts_of_the_observation_in_their_order(tmp_path: Path) -> None:
    nodes = [helper.make_node("Concat", ["goal", "proprio"], ["actions"], axis=1)]
    inputs = [value("proprio", [1, 1]), value("goal", [1, 1])]
    path = write(tmp_path / "a.onnx", nodes, inputs, [value("actions", [1, 2])])
    policy = OnnxPolicy(path, "a.onnx")
    assert policy.facts.observations is not None
    assert [(part.name, part.size) for part in policy.facts.observations] == [("proprio", 1), ("goal", 1)]
    assert acted(path, [np.array([1.0, 2.0]), np.array([3.0, 4.0])]) == [[2.0, 1.0], [4.0, 3.0]]


def test_all_actions_of_an_episode_are_bit_for_bit_those_of_onnxruntime(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    weights = generator.normal(size=(2, 4)).astype(np.float32)
    path = linear(tmp_path / "a.onnx", weights, shape=[1, 4])
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (feed,), (fetch,) = session.get_inputs(), session.get_outputs()
    rows = generator.normal(size=(20, 4))
    inputs = [{feed.name: row.astype(np.float32)[None]} for row in rows]
    expected = [np.concatenate(np.asarray(session.run([fetch.name], each)[0])) for each in inputs]
    actor = OnnxPolicy(path, "a.onnx").episode(0, LEFT_RIGHT)
    actions = [actor(row) for row in rows]
    assert np.array_equal(actions, expected)


def test_episodes_of_a_network_of_any_size_are_independent_in_any_thread(tmp_path: Path) -> None:
    nodes = [helper.make_node("Neg", ["obs"], ["actions"])]
    path = write(tmp_path / "a.onnx", nodes, [value("obs", [1, "n"])], [value("actions", [1, "n"])])
    policy = OnnxPolicy(path, "a.onnx")
    with ThreadPoolExecutor(4) as pool:
        actors = [policy.start(seed, LEFT_RIGHT) for seed in range(4)]
        rows = [np.full(1 + index % 3, index) for index in range(400)]
        actions = pool.map(lambda index: actors[index % 4](rows[index]), range(400))
        assert [action.tolist() for action in actions] == [(-row).tolist() for row in rows]


def test_an_action_whose_shape_changes_within_an_episode_is_reported(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("NonZero", ["obs"], ["places"]),
        helper.make_node("Cast", ["places"], ["actions"], to=TensorProto.FLOAT),
    ]
    path = write(tmp_path / "a.onnx", nodes, [value("obs", [2])], [value("actions", ["n", "m"])])
    actor = OnnxPolicy(path, "a.onnx").episode(0, LEFT_RIGHT)
    for _ in range(2):
        assert actor(np.array([1.0, 2.0])).tolist() == [0.0, 1.0]
        with pytest.raises(UsageError, match="returned 1 number"):
            actor(np.array([0.0, 3.0]))


def test_of_several_outputs_the_action_is_the_one_of_that_name(tmp_path: Path) -> None:
    nodes = [helper.make_node("Neg", ["obs"], ["value"]), helper.make_node("Abs", ["obs"], ["actions"])]
    outputs = [value("value", [1, 2]), value("actions", [1, 2])]
    path = write(tmp_path / "a.onnx", nodes, [value("obs", [1, 2])], outputs)
    assert acted(path, [np.array([1.0, -2.0])]) == [[1.0, 2.0]]
    model = onnx.load(path)
    model.graph.node[1].output[0] = model.graph.output[1].name = "std"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(UsageError, match=r"several outputs that could be the action: value \(1, 2\), std"):
        OnnxPolicy(path, "a.onnx")


@pytest.mark.parametrize(
    ("shape", "kind", "message"),
    [
        (None, TensorProto.FLOAT, "its input obs is a single number, or has no specified shape"),
        ([], TensorProto.FLOAT, "its input obs is a single number"),
        ([4096, 2], TensorProto.FLOAT, r"the input obs \(4096, 2\) contains more than one observation"),
        ([1, 5, 2], TensorProto.FLOAT, r"the input obs \(1, 5, 2\) contains more than one observation"),
        ([1, 2], TensorProto.INT64, r"obs is a tensor\(int64\); a policy requires floating-point"),
        ([1, 2], TensorProto.BOOL, r"obs is a tensor\(bool\)"),
    ],
)
def test_inputs_that_are_no_observation_are_refused(
    tmp_path: Path, shape: Shape | None, kind: int, message: str
) -> None:
    nodes = [helper.make_node("Cast", ["obs"], ["actions"], to=TensorProto.FLOAT)]
    path = write(tmp_path / "a.onnx", nodes, [value("obs", shape, kind)], [value("actions", None)])
    with pytest.raises(UsageError, match=message) as error:
        OnnxPolicy(path, "a.onnx")
    assert error.value.path == ("policy",)


def test_sizes_that_do_not_fit_show_both_sides(tmp_path: Path) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS)
    with pytest.raises(UsageError, match=r"a.onnx observes 4 numbers, and the task has 3: obs \(1, 4\)"):
        acted(path, [OBSERVATION[:3]])
    wide = linear(tmp_path / "b.onnx", np.ones((3, 4), np.float32))
    with pytest.raises(UsageError, match=r"b.onnx returned 3 numbers, and the task takes 2 actions: left, right"):
        acted(wide, [OBSERVATION])


def test_metadata_of_mjlab_are_its_facts(tmp_path: Path) -> None:
    metadata = {
        "joint_names": "hip,knee",
        "joint_stiffness": "20.000,30.000",
        "joint_damping": "1.000,1.500",
        "default_joint_pos": "0.100,-0.200",
        "observation_names": "joint_pos,joint_vel",
        "observation_terms_scale": "1.000,0.050",
        "action_scale": "0.25",
    }
    facts = OnnxPolicy(linear(tmp_path / "a.onnx", WEIGHTS, metadata=metadata), "a.onnx").facts
    assert (facts.joints, facts.action_joints) == (("hip", "knee"), ("hip", "knee"))
    assert (facts.default_position, facts.action_scale) == ((0.1, -0.2), (0.25,))
    assert (facts.observation_size, facts.action_size, facts.control_dt) == (4, 2, None)
    assert Fraction(facts.stiffness[0] if facts.stiffness else 0) == 20


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
    code = "import sys; from pathlib import Path; from mjrun.policy.loaders.onnx import OnnxModel; "
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
    with pytest.raises(FileError, match="is not an ONNX model, or is damaged"):
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
        (opset, "it requires a newer onnxruntime"),
        (version, "it requires a newer onnxruntime"),
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
    with pytest.raises(FileError, match="its weights are in a file outside its folder"):
        OnnxModel(path)
    assert weight_files(path) == []  # which would be copied


def test_weights_beside_it_are_read_and_missing_ones_are_told(tmp_path: Path) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS)
    model = onnx.load(path)
    onnx.save(model, path, save_as_external_data=True, location="a.bin", size_threshold=0)
    assert len(OnnxModel(path).inputs) == 1
    assert weight_files(path) == [tmp_path / "a.bin"]
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


def tensors(*names: str, shape: tuple[int | None, ...] = (1, 1, 8)) -> list[TensorSpec]:
    return [TensorSpec(name, "tensor(float)", shape) for name in names]


def pairs(inputs: list[TensorSpec], outputs: list[TensorSpec]) -> list[tuple[str, str]]:
    return [(start.name, end.name) for start, end in state_pairs(inputs, outputs)]


@pytest.mark.parametrize(
    ("inputs", "outputs", "expected"),
    [
        (["obs", "h_in", "c_in"], ["actions", "h_out", "c_out"], [("h_in", "h_out"), ("c_in", "c_out")]),
        (["obs", "h0", "c0"], ["actions", "hn", "cn"], [("h0", "hn"), ("c0", "cn")]),
        (["obs", "state_in_0", "state_in_1"], ["actions", "state_out_0", "state_out_1"],
         [("state_in_0", "state_out_0"), ("state_in_1", "state_out_1")]),
        (["obs", "previous_actions"], ["actions"], []),
        (["obs"], ["actions", "h_out"], []),
        (["obs", "h_in"], ["actions", "c_out"], []),
    ],
)  # fmt: skip
def test_pairs_are_alike_but_for_their_ends(
    inputs: list[str], outputs: list[str], expected: list[tuple[str, str]]
) -> None:
    assert pairs(tensors(*inputs), tensors(*outputs)) == expected


def test_pairs_agree_in_shape_and_type() -> None:
    assert pairs(tensors("h_in"), tensors("h_out", shape=(1, 1, 9))) == []
    assert pairs(tensors("h_in"), tensors("h_out", shape=(1, 8))) == []
    assert pairs(tensors("h_in"), tensors("h_out", shape=(1, None, 8))) == [("h_in", "h_out")]
    assert pairs(tensors("h_in"), [TensorSpec("h_out", "tensor(double)", (1, 1, 8))]) == []


def test_where_several_could_be_meant_none_is() -> None:
    assert pairs(tensors("h_in", "h_prev"), tensors("h_out")) == []
    assert pairs(tensors("h_in"), tensors("h_out", "h_next")) == []
