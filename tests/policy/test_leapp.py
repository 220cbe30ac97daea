"""LEAPP packages: what describes them, what is refused, and how their networks play."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.policy.load import load_policy
from mjrun.policy.loaders.leapp import LeappPolicy, find_package, read_package, read_safetensors
from tests.cases import cases
from tests.policy.action_spaces import unbounded
from tests.policy.leapp_packages import GAIN, INITIAL, package, tensors

JOINTS = unbounded(["hip", "knee"])


def test_networks_run_in_order_and_feed_back(tmp_path: Path) -> None:
    policy = LeappPolicy(package(tmp_path / "walk"), "walk")
    observations = np.random.default_rng(0).normal(size=(4, 6)).astype(np.float32)  # the quaternion, the joints
    one, other = policy.episode(0, JOINTS), policy.episode(1, JOINTS)
    memory = INITIAL[0]
    for observation in observations:
        memory = observation[4:] @ GAIN + observation[:2] + memory
        assert np.allclose(one(observation.astype(float)), memory, atol=1e-6)
        assert np.allclose(other(observation.astype(float)), memory, atol=1e-6)
    first = policy.episode(0, JOINTS)(np.zeros(6))
    assert first.tolist() == INITIAL[0].tolist()


def test_a_package_says_much_of_itself(tmp_path: Path) -> None:
    facts = load_policy(str(package(tmp_path / "walk").parent)).facts  # by its folder
    assert (facts.observation_size, facts.action_size, facts.control_dt) == (6, 2, Fraction(1, 50))
    assert facts.quaternion_order == "xyzw"
    assert (facts.action_joints, facts.stiffness, facts.damping) == (("hip", "knee"), (20, 30), (1, 1.5))
    assert (facts.action_target, facts.action_scale, facts.action_offset) == ("position", (1,), (0,))
    assert facts.observations is not None
    assert [(part.offset, part.scale) for part in facts.observations] == [(None, None), ((0,), (1,))]
    assert [(part.name, part.kind, part.elements) for part in facts.observations] == [
        ("quaternion", "state/body/rotation", ("qx", "qy", "qz", "qw")),
        ("joint_pos", "state/joint/position", ("hip", "knee")),
    ]


def test_an_observation_of_another_size_shows_both_sides(tmp_path: Path) -> None:
    actor = LeappPolicy(package(tmp_path / "walk"), "walk").episode(0, JOINTS)
    with pytest.raises(UsageError, match=r"walk observes 6 numbers, and the task has 5: quaternion \(4\), joint_pos"):
        actor(np.zeros(5))


def test_gains_that_change_are_refused(tmp_path: Path) -> None:
    memory = "{name: memory_out, dtype: float32, shape: [1, 2], type: tensor"
    path = package(tmp_path, lambda text: text.replace(memory, f"{memory}, kind: kd").replace("kp, kd]", "memory_out]"))
    with pytest.raises(UsageError, match="its gains kd depend on the observation"):
        LeappPolicy(path, "walk")


def test_what_is_no_policy_of_numbers_is_refused(tmp_path: Path) -> None:
    gains = package(tmp_path / "gains", lambda text: text.replace("kind: target/joint/position", "kind: kp"))
    with pytest.raises(UsageError, match="it has no inputs or outputs"):
        LeappPolicy(gains, "walk")
    joint_pos = "{name: joint_pos, dtype: float32"
    integer = package(tmp_path / "integer", lambda text: text.replace(joint_pos, joint_pos.replace("float32", "int64")))
    with pytest.raises(UsageError, match="policy/joint_pos is not a tensor of floating-point numbers"):
        LeappPolicy(integer, "walk")


def test_a_network_with_other_tensors_than_described_is_refused(tmp_path: Path) -> None:
    described = (
        "    - {name: kd, dtype: float32, shape: [1, 2], type: tensor, kind: kd, element_names: [[hip, knee]]}\n"
    )
    path = package(tmp_path, lambda text: text.replace(described, "").replace("kp, kd]", "kp]"))
    with pytest.raises(
        FileError, match="tensors are target, memory_out, kp, kd, and the package describes target, mem"
    ):
        LeappPolicy(path, "walk")


def test_a_package_is_its_networks_flows_and_files(tmp_path: Path) -> None:
    read = read_package(package(tmp_path))
    assert [network.name for network in read.networks] == ["observer", "policy"]
    assert read.flows == {"observer/features": ("policy/features",), "policy/memory_out": ("policy/memory_in",)}
    assert [tensor.place for tensor in read.outputs] == ["policy/target", "policy/kp", "policy/kd"]
    assert read.initial["policy/memory_in"].tolist() == INITIAL.tolist()
    assert read.inputs[0].size == 4


def test_axes_name_the_numbers_that_they_span(tmp_path: Path) -> None:
    bodies = "element_names: [[left, right], [x, y]]"
    read = read_package(package(tmp_path, lambda text: text.replace("element_names: [[qx, qy, qz, qw]]", bodies)))
    assert read.inputs[0].elements == ("left/x", "left/y", "right/x", "right/y")
    for names in ("[[__temporal_axis__, a]]", "[[a]]", "a", "[]"):
        read = read_package(package(tmp_path, lambda text, names=names: text.replace("[[qx, qy, qz, qw]]", names)))
        assert read.inputs[0].elements is None


def test_a_folder_is_a_package_if_it_holds_one_description(tmp_path: Path) -> None:
    path = package(tmp_path)
    assert find_package(tmp_path) == find_package(path) == path
    (tmp_path / "other.yml").touch()
    with pytest.raises(UsageError, match=r"several .yaml files: other.yml, walk.yaml"):
        find_package(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=r"is not a LEAPP package: it contains no .yaml file"):
        find_package(tmp_path / "empty")


@cases("old, new, message")
def test_what_does_not_fit_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = package(tmp_path, lambda text: text.replace(old, new, 1) if old != "sha256sum: " else text.replace(old, new))
    before = sorted(each.name for each in tmp_path.iterdir())
    with pytest.raises(FileError, match=message):
        read_package(path)
    assert sorted(each.name for each in tmp_path.iterdir()) == before


def test_networks_of_other_kinds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="its network observer has the format 'jit'; export it as onnx"):
        read_package(package(tmp_path, lambda text: text.replace("backend: onnx", "backend: jit")))


LAUGHS = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}]\n" for i in range(1, 30))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{LAUGHS}models: {{p: {{parameters: {{backend: *a29}}}}}}\npipeline: {{}}\n", "its aliases"),
        ("&a {models: *a, pipeline: *a}\n", "contains itself"),
        ("models: " + "[" * 10_000, "cannot be read as YAML"),
    ],
)
def test_a_description_that_means_more_than_memory_holds_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "walk.yaml").write_text(text)
    with pytest.raises(FileError, match=message):
        read_package(tmp_path / "walk.yaml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("model_path: policy.onnx", 'model_path: "a\\0b"', "not a path"),
        ("model_path: policy.onnx", "model_path: 5", "not a path"),
        ("model_path: policy.onnx", "model_path: ''", "not a path"),
        ("dtype: float32", "dtype: [1]", "the dtype of"),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = package(tmp_path, lambda text: text.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_package(path)


def test_names_of_more_combinations_than_numbers_are_none(tmp_path: Path) -> None:
    axes = ", ".join(f"[{', '.join(f'n{i}' for i in range(10))}]" for _ in range(12))
    path = package(tmp_path, lambda text: text.replace("[[hip, knee]]", f"[{axes}]"))
    assert {tensor.elements for network in read_package(path).networks for tensor in network.outputs} == {None}


def test_tensors_have_names_shapes_and_values(tmp_path: Path) -> None:
    arrays = {"a/b": np.arange(6, dtype=np.float32).reshape(1, 2, 3), "c": np.ones((0, 2), np.float32)}
    read = read_safetensors(tensors(tmp_path / "a.safetensors", arrays))
    assert {name: array.tolist() for name, array in read.items()} == {"a/b": arrays["a/b"].tolist(), "c": []}


def file(header: object, content: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + content


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff" * 8,
        file([1]),
        file({"a": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}, b"1234"),
        file({"a": {"dtype": "F32", "shape": [3], "data_offsets": [0, 8]}}, b"12345678"),
        file({"a": {"dtype": "F8", "shape": [8], "data_offsets": [0, 8]}}, b"12345678"),
        file({"a": {"dtype": "F32", "shape": [1]}}),
        file({"a": {"dtype": "F32", "shape": [-1], "data_offsets": [8, 0]}}, b"12345678"),
    ],
)
def test_what_is_damaged_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.safetensors").write_bytes(content)
    with pytest.raises(FileError, match="cannot be read as safetensors"):
        read_safetensors(tmp_path / "a.safetensors")
