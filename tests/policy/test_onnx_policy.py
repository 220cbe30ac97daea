"""Networks as policies: the action of an observation, whatever the type and shape of the tensors, and memory."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from mjrun.errors import UsageError
from mjrun.policy.onnx_policy import OnnxPolicy
from tests.policy.networks import LEFT_RIGHT, Shape, integrator, linear, value, write

WEIGHTS = np.array([[1, 2, 3, 4], [0, 1, 0, -1]], np.float32)
OBSERVATION = np.array([0.5, -1, 2, 8])


def acted(path: Path, observations: Sequence[np.ndarray]) -> list[list[float]]:
    actor = OnnxPolicy(path, str(path)).episode(0, LEFT_RIGHT)
    return [actor.act(observation).tolist() for observation in observations]


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("shape", [[4], [1, 4], [1, 1, 4], ["batch", 4], ["batch", "n"], [None, None]])
def test_the_action_is_that_of_the_network(tmp_path: Path, kind: type[np.floating], shape: Shape) -> None:
    path = linear(tmp_path / "a.onnx", WEIGHTS.astype(kind), shape=shape)
    if shape != [1, 4]:  # what comes out has the shape of what goes in, not that which the file declares
        model = onnx.load(path)
        model.graph.output[0].type.tensor_type.ClearField("shape")
        path.write_bytes(model.SerializeToString())
    assert acted(path, [OBSERVATION]) == [(WEIGHTS @ OBSERVATION).tolist()]


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
        assert one.act(row).tolist() == sums.tolist()  # side by side, and the one does not see the other
        assert other.act(2 * row).tolist() == (2 * sums).tolist()
    assert policy.episode(0, LEFT_RIGHT).act(rows[1]).tolist() == rows[1].tolist()


def test_several_inputs_are_parts_of_the_observation_in_their_order(tmp_path: Path) -> None:
    nodes = [helper.make_node("Concat", ["goal", "proprio"], ["actions"], axis=1)]
    inputs = [value("proprio", [1, 1]), value("goal", [1, 1])]
    path = write(tmp_path / "a.onnx", nodes, inputs, [value("actions", [1, 2])])
    policy = OnnxPolicy(path, "a.onnx")
    assert policy.facts.observations is not None
    assert [(part.name, part.size) for part in policy.facts.observations] == [("proprio", 1), ("goal", 1)]
    assert acted(path, [np.array([1.0, 2.0])]) == [[2.0, 1.0]]


def test_of_several_outputs_the_action_is_the_one_of_that_name(tmp_path: Path) -> None:
    nodes = [helper.make_node("Neg", ["obs"], ["value"]), helper.make_node("Abs", ["obs"], ["actions"])]
    outputs = [value("value", [1, 2]), value("actions", [1, 2])]
    path = write(tmp_path / "a.onnx", nodes, [value("obs", [1, 2])], outputs)
    assert acted(path, [np.array([1.0, -2.0])]) == [[1.0, 2.0]]
    model = onnx.load(path)
    model.graph.node[1].output[0] = model.graph.output[1].name = "std"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(UsageError, match=r"several outputs, and none says that it is the action: value \(1, 2\), std"):
        OnnxPolicy(path, "a.onnx")


@pytest.mark.parametrize(
    ("shape", "kind", "message"),
    [
        (None, TensorProto.FLOAT, "its input obs is a single number, or of a shape that is not said"),
        ([], TensorProto.FLOAT, "its input obs is a single number"),
        ([4096, 2], TensorProto.FLOAT, r"the input obs \(4096, 2\) holds more than one observation"),
        ([1, 5, 2], TensorProto.FLOAT, r"the input obs \(1, 5, 2\) holds more than one observation"),
        ([1, 2], TensorProto.INT64, r"obs is a tensor\(int64\), and policies take and give real"),
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
    with pytest.raises(UsageError, match=r"a.onnx observes 4 numbers, and the task gives 3: obs \(1, 4\)"):
        acted(path, [OBSERVATION[:3]])
    wide = linear(tmp_path / "b.onnx", np.ones((3, 4), np.float32))
    with pytest.raises(UsageError, match=r"b.onnx answers 3 numbers, and the task takes 2 actions: left, right"):
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
