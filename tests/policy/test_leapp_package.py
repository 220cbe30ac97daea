"""The descriptions of LEAPP packages: read, and refused wherever they do not fit."""

from pathlib import Path

import pytest

from mjrun.errors import FileError, UsageError
from mjrun.policy.leapp_package import find_package, read_package
from tests.policy.leapp_packages import INITIAL, package


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
    with pytest.raises(UsageError, match=r"is no LEAPP package: it holds no .yaml file"):
        find_package(tmp_path / "empty")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("models:", "networks:", "is no LEAPP package: models is no mapping"),
        ("pipeline:", "pipes:", "pipeline is no mapping"),
        ("model_path: policy.onnx", "model_path: ../secret.onnx", "'../secret.onnx', which is outside of its folder"),
        ("model_path: policy.onnx", "model_path: /etc/passwd", "'/etc/passwd', which is outside of its folder"),
        ("walk_initial_values", "../walk", "initial_values is '../walk.safetensors', which is outside"),
        ("walk_initial_values", "none", "no such file"),
        ("sha256sum: ", "sha256sum: a", "is not the file that walk.yaml describes: its SHA-256 differs"),
        ("dtype: float32", "dtype: bfloat16", "the dtype of quaternion is none of float16, float32"),
        ("shape: [1, 4]", "shape: [1, n]", "the shape of quaternion is no list of sizes"),
        ("shape: [1, 4]", "shape: 4", "the shape of quaternion is no list"),
        ("{name: quaternion, ", "{", "a tensor in inputs of observer has no name"),
        ("[policy/features]", "[policy/nothing]", "data_flow names 'policy/nothing', and there is no such tensor"),
        ("[policy/features]", "[observer/quaternion]", "observer/features and observer/quaternion differ in shape"),
        ("policy: [joint_pos]", 'policy: ["jo\\x1bint"]', r"inputs of the pipeline name 'policy/jo\\\\?x1bint'"),
        ("frequency: 50.0", "frequency: -1", "the frequency is '-1', and no positive number"),
        ("frequency: 50.0", "frequency: .nan", "the frequency is 'nan'"),
        ("models:", "models: !!python/object/apply:os.mkdir [made]\nx:", "cannot be read as YAML"),
        ("models:", "models: [", "cannot be read as YAML"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = package(tmp_path, lambda text: text.replace(old, new, 1) if old != "sha256sum: " else text.replace(old, new))
    before = sorted(each.name for each in tmp_path.iterdir())
    with pytest.raises(FileError, match=message):
        read_package(path)
    assert sorted(each.name for each in tmp_path.iterdir()) == before


def test_networks_of_other_kinds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="its network observer is of the kind 'jit'; export it with onnx"):
        read_package(package(tmp_path, lambda text: text.replace("backend: onnx", "backend: jit")))


LAUGHS = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}]\n" for i in range(1, 30))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{LAUGHS}models: {{p: {{parameters: {{backend: *a29}}}}}}\npipeline: {{}}\n", "its aliases"),
        ("&a {models: *a, pipeline: *a}\n", "stands in itself"),
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
        ("model_path: policy.onnx", 'model_path: "a\\0b"', "no path"),
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
