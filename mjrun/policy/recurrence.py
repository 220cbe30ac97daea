"""Which inputs and outputs of a network are its recurrent state: what one call gives, the next one gets."""

import re
from collections.abc import Sequence

from mjrun.policy.onnx_model import Tensor

# Words that tell the two ends of a state apart: h_in and h_out, state and next_state, h0 and hn.
ENDS = {"in", "out", "input", "output", "prev", "previous", "next", "new", "old", "initial", "final"}
ACTIONS = ("actions", "action", "continuous_actions", "deterministic_continuous_actions")


def state_pairs(inputs: Sequence[Tensor], outputs: Sequence[Tensor]) -> list[tuple[Tensor, Tensor]]:
    """Inputs, each with the output that it gets in the next call: alike in all but the end in their names."""
    ends = [tensor for tensor in outputs if tensor.name not in ACTIONS]
    pairs: list[tuple[Tensor, Tensor]] = []
    for start in inputs:
        fits = [end for end in ends if _stem(end.name) == _stem(start.name) and _agree(start, end)]
        rivals = [other for other in inputs if _stem(other.name) == _stem(start.name)]
        if len(fits) == len(rivals) == 1 and start.name != fits[0].name:
            pairs.append((start, fits[0]))
    return pairs


def _stem(name: str) -> str:
    """`name` without what tells the ends of a state apart."""
    words = re.split(r"[^0-9a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower())
    words = [re.sub(r"^([hc])[0n]$", r"\1", word) for word in words if word not in ENDS]
    if len(words) == 2 and words[0] in ("h", "c") and words[1] in ("0", "n"):
        words = words[:1]
    return "_".join(words)


def _agree(start: Tensor, end: Tensor) -> bool:
    sizes = zip(start.shape, end.shape, strict=False)
    return (
        start.type == end.type
        and len(start.shape) == len(end.shape)
        and all(one is None or other is None or one == other for one, other in sizes)
    )
