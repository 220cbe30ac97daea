"""What a policy may be written as, and what of it is code."""

from pathlib import Path

import pytest

from mjrun.errors import BadValueError
from mjrun.options.policy import PolicyOptions, is_code, is_policy_file


@pytest.mark.parametrize(
    "text", ["policy.py:act", "dir/my policy.py:Agent", "package.module:Policy", "m:a.b", "größe:f"]
)
def test_a_place_and_a_name_are_code(text: str) -> None:
    assert is_code(text)
    assert not is_policy_file(text)


@pytest.mark.parametrize(
    "text", ["walk.onnx", "runs/walk.zip", "C:/walk.onnx", "C:\\walk.onnx", "leapp/", "a-b:c", "a:"]
)
def test_what_is_neither_code_nor_built_in_is_a_file(text: str) -> None:
    assert not is_code(text)
    assert is_policy_file(text)


@pytest.mark.parametrize("text", ["random", "zero"])
def test_the_policies_that_are_built_in_are_neither(text: str) -> None:
    assert not is_code(text)
    assert not is_policy_file(text)


def test_python_may_give_paths_and_policies() -> None:
    assert PolicyOptions().policy is None
    assert PolicyOptions(policy=Path("a.onnx"), normalize=Path("b.pkl")) == PolicyOptions(
        policy="a.onnx", normalize="b.pkl"
    )
    assert PolicyOptions(policy=print).policy is print
    with pytest.raises(BadValueError, match=r"^policy: '' is not a policy"):
        PolicyOptions(policy="")
