"""What holds for every policy: its answers are checked before they are actions."""

import numpy as np
import pytest

from mjrun.errors import ControllerError, UsageError
from mjrun.policy.policy import ActionSpace, Actor, Policy
from tests.policy.action_spaces import unbounded

NAMES = unbounded(["left", "ri\x1bght"])


class Constant(Policy):
    def __init__(self, answer: object) -> None:
        super().__init__("con\x1bstant")
        self._answer = answer

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return self  # type: ignore[return-value]

    def act(self, observation: np.ndarray) -> object:
        return self._answer


@pytest.mark.parametrize("answer", [[1, 2], (1.0, 2.0), np.array([[1, 2]], np.float16), np.array([[1], [2]])])
def test_an_answer_is_a_vector_of_doubles(answer: object) -> None:
    action = Constant(answer).episode(0, NAMES).act(np.zeros(3))
    assert action.tolist() == [1, 2]
    assert action.dtype == np.float64


@pytest.mark.parametrize("answer", [[1], 3.0, np.zeros((2, 2)), []])
def test_another_number_of_numbers_shows_both_sides(answer: object) -> None:
    with pytest.raises(
        UsageError, match=r"^policy con\\x1bstant answers \d numbers?, and the task takes 2 actions: left"
    ):
        Constant(answer).episode(0, NAMES).act(np.zeros(3))


@pytest.mark.parametrize("answer", ["left", None, {"a": 1}, [[1], [2, 3]]])
def test_what_is_no_number_is_refused(answer: object) -> None:
    with pytest.raises(ControllerError, match=r"^policy con\\x1bstant raised (Type|Value)Error"):
        Constant(answer).episode(0, NAMES).act(np.zeros(3))
