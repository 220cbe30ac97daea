"""Which tensors are recurrent state."""

import pytest

from mjrun.policy.onnx_model import Tensor
from mjrun.policy.recurrence import state_pairs


def tensors(*names: str, shape: tuple[int | None, ...] = (1, 1, 8)) -> list[Tensor]:
    return [Tensor(name, "tensor(float)", shape) for name in names]


def pairs(inputs: list[Tensor], outputs: list[Tensor]) -> list[tuple[str, str]]:
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
    assert pairs(tensors("h_in"), [Tensor("h_out", "tensor(double)", (1, 1, 8))]) == []


def test_where_several_could_be_meant_none_is() -> None:
    assert pairs(tensors("h_in", "h_prev"), tensors("h_out")) == []
    assert pairs(tensors("h_in"), tensors("h_out", "h_next")) == []
